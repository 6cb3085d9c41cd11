"""Machine code on disk, by names that say what it was made from."""

import hashlib
import logging
import os
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import platformdirs

_log = logging.getLogger(__name__)
#: How a file of machine code begins; a digest of the rest follows.
_MAGIC = b"armwright kernel 1\n"
_DIGEST = 32


def read(name: str) -> bytes | None:
    """The entry of a name; None where there is none, or a damaged one."""
    for folder in _layers():
        try:
            content = (folder / name).read_bytes()
        except OSError:
            continue
        start = len(_MAGIC) + _DIGEST
        if content[:start] == _MAGIC + hashlib.sha256(content[start:]).digest():
            return content[start:]
    return None


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


def _layers() -> Iterator[Path]:
    yield shipped_folder()
    yield user_folder()


@cache
def _warn_once(folder: Path, error: str) -> None:
    _log.warning(
        "Kernels can't be kept in %s (%s) and are compiled anew in each process. "
        "Set NUMBA_CACHE_DIR to a folder that can be written.",
        folder,
        error,
    )
