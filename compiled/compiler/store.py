"""Machine code on disk, by names that say what it was made from.

A wheel has every package below ``armwright._src``. Machine code, and the digests that it is kept
under, hold the names of modules as a checkout has them, so that both share what is compiled.
"""

import io
import logging
import os
import pickle
import re
from collections.abc import Container, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import platformdirs

from compiled.kept_file import is_kept, read_kept, write_kept

_log = logging.getLogger(__name__)
#: Ending of the files; those of before had none.
_ENDING = ".kernel"
#: Names of files: of a kernel, and a digest of what it is made from.
_NAME = re.compile(r"[\w.]+-[0-9a-f]{32}(\.door\d*(-locked)?)?(\.kernel)?")
#: Package of a wheel that holds the others.
WHEEL = "armwright._src."
#: Packages that a wheel moves.
PACKAGES = frozenset(
    {"command_line", "compiled", "dynamics", "kinematics", "obstacles", "planning", "service"}
    | {"studio", "tracking"}
)
#: Names of the packages here begin with this: nothing in a checkout.
HERE = __name__.partition("compiled.")[0]


def read(name: str) -> bytes | None:
    """The entry of a name; None where there is none that can be trusted."""
    found = (read_from(folder, name) for folder in layers())
    return next((content for content in found if content is not None), None)


def read_from(folder: Path, name: str) -> bytes | None:
    """The entry of a name in one folder; None where there is none that can be trusted."""
    return read_kept(file_of(folder, name))


def file_of(folder: Path, name: str) -> Path:
    """Path of the entry of a name in a folder, whether it is there or not."""
    return folder / f"{name}{_ENDING}"


def names(folder: Path) -> Iterator[str]:
    """Names of the entries of a folder."""
    return (file.name.removesuffix(_ENDING) for file in folder.glob(f"[!.]*{_ENDING}"))


def has(name: str) -> bool:
    """Whether a name has an entry that only this user can have written, whole or damaged."""
    return any(is_kept(file_of(folder, name)) for folder in layers())


def prune(wanted: Container[str]) -> int:
    """Remove the entries of the user's folder that are not wanted, and say how many they were."""
    removed = 0
    for path in user_folder().iterdir() if user_folder().is_dir() else ():
        name = path.name.removesuffix(_ENDING)
        if _NAME.fullmatch(path.name) and (name == path.name or name not in wanted):
            path.unlink(missing_ok=True)
            removed += 1
    return removed


def write(name: str, content: bytes) -> None:
    """Keep machine code in the user's folder; of processes that do so at once, any may be last."""
    folder = user_folder()
    try:
        write_kept(file_of(folder, name), content, public=True)
    except OSError as error:
        _warn_once(folder, str(error))


def user_folder() -> Path:
    """Folder of what this process compiles: NUMBA_CACHE_DIR, or the user's cache folder."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    return Path(chosen) if chosen else platformdirs.user_cache_path("armwright") / "kernels"


def shipped_folder() -> Path:
    """Folder of machine code made beforehand: ARMWRIGHT_KERNELS, or beside this package."""
    chosen = os.environ.get("ARMWRIGHT_KERNELS")
    return Path(chosen) if chosen else Path(__file__).parents[1] / "kernels"


def layers() -> tuple[Path, ...]:
    """The folders that are searched, in order."""
    return shipped_folder(), user_folder()


@cache
def _warn_once(folder: Path, error: str) -> None:
    _log.warning(
        "Kernels can't be kept in %s (%s) and are compiled anew in each process. "
        "Set NUMBA_CACHE_DIR to a folder that can be written.",
        folder,
        error,
    )


def plain(module: str | None) -> str:
    """Name of a module as a checkout has it; "None" of a function that has none."""
    return str(module).removeprefix(WHEEL)


def here(module: str) -> str:
    """Name by which a module can be imported in this installation."""
    name = plain(module)
    return HERE + name if name.partition(".")[0] in PACKAGES else module


def loads(content: bytes) -> Any:
    """The value of a pickle that a checkout or a wheel has made."""
    moved = HERE or WHEEL.encode() in content
    return _Unpickler(io.BytesIO(content)).load() if moved else pickle.loads(content)


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        """The class or function of a name, in this installation."""
        return super().find_class(here(module), name)
