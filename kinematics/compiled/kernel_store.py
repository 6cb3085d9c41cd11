"""Machine code on disk, by names that say what it was made from."""

import hashlib
import logging
import os
import re
import tempfile
from collections.abc import Container
from functools import cache
from pathlib import Path

import platformdirs

_log = logging.getLogger(__name__)
#: How a file of machine code begins; a digest of the rest follows.
_MAGIC = b"armwright kernel 1\n"
_DIGEST = 32
#: Names of entries: of a kernel, and a digest of what it is made from.
_NAME = re.compile(r"[\w.]+-[0-9a-f]{32}(\.door\d*(-locked)?)?")


def read(name: str) -> bytes | None:
    """The entry of a name; None where there is none, or a damaged one."""
    found = (read_from(folder, name) for folder in layers())
    return next((content for content in found if content is not None), None)


def read_from(folder: Path, name: str) -> bytes | None:
    """The entry of a name in one folder; None where there is none, or a damaged one."""
    try:
        content = (folder / name).read_bytes()
    except OSError:
        return None
    start = len(_MAGIC) + _DIGEST
    whole = content[:start] == _MAGIC + hashlib.sha256(content[start:]).digest()
    return content[start:] if whole else None


def has(name: str) -> bool:
    """Whether there is an entry of a name, whole or damaged."""
    return any((folder / name).is_file() for folder in layers())


def prune(wanted: Container[str]) -> int:
    """Remove the entries of the user's folder that are not wanted, and say how many they were."""
    removed = 0
    for path in user_folder().iterdir() if user_folder().is_dir() else ():
        if _NAME.fullmatch(path.name) and path.name not in wanted:
            path.unlink(missing_ok=True)
            removed += 1
    return removed


def write(name: str, content: bytes) -> None:
    """Keep machine code in the user's folder; of processes that do so at once, any may be last."""
    folder = user_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=folder, prefix=".", delete=False) as file:
            file.write(_MAGIC + hashlib.sha256(content).digest() + content)
        Path(file.name).replace(folder / name)
    except OSError as error:
        _warn_once(folder, str(error))


def user_folder() -> Path:
    """Where this process keeps what it compiles: NUMBA_CACHE_DIR, or the user's cache folder."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    return Path(chosen) if chosen else platformdirs.user_cache_path("armwright") / "kernels"


def shipped_folder() -> Path:
    """Where machine code made beforehand may lie: ARMWRIGHT_KERNELS, or beside this module."""
    chosen = os.environ.get("ARMWRIGHT_KERNELS")
    return Path(chosen) if chosen else Path(__file__).with_name("kernels")


def layers() -> tuple[Path, ...]:
    """The folders that are looked in, the first one first."""
    return shipped_folder(), user_folder()


@cache
def _warn_once(folder: Path, error: str) -> None:
    _log.warning(
        "Kernels can't be kept in %s (%s) and are compiled anew in each process. "
        "Set NUMBA_CACHE_DIR to a folder that can be written.",
        folder,
        error,
    )
