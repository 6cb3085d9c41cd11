"""Files of what takes long to compute from a robot's or a scene's solids, for all processes.

Their names are digests of all that they were computed from. They are written while something is
prepared to be kept, and read whenever there is a folder for them. What is prepared has a note of
all files that it needs, also of those that others wrote: they stay as long as one of them does.
"""

import contextlib
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO

import numpy as np

from kinematics.arrays import Array

_directory: Path | None = None
_written: list[Path] | None = None


def keep_files_in(directory: Path | None) -> None:
    """Look for files in ``directory``, and write them there, see `written_files`."""
    global _directory  # noqa: PLW0603  one folder a process, like its caches in memory
    _directory = directory


@contextlib.contextmanager
def written_files() -> Iterator[list[Path]]:
    """Write files of what is used meanwhile, for other processes and later ones.

    Yields:
        The files of what was used, that were there or were written; whoever has them kept removes
        them in the end.
    """
    global _written  # noqa: PLW0603
    before, _written = _written, list[Path]()
    try:
        yield _written
    finally:
        _written = before


def is_written() -> bool:
    """Whether something is prepared to be kept."""
    return _written is not None and _directory is not None


def kept_file(name: str) -> Path | None:
    """Where the file of a name is, or would be; None where nothing is kept."""
    return _directory / name if _directory is not None else None


def write_file(name: str, write: Callable[[IO[bytes]], None]) -> None:
    """Have a file written where something is prepared to be kept, else do nothing.

    Args:
        name: Of the file.
        write: Writes its content.
    """
    file = kept_file(name)
    if file is None or _written is None:
        return
    with contextlib.suppress(OSError):  # it is computed again where it could not be kept
        _replace(file, write)
        _note(file)


def keep_file(name: str, write: Callable[[IO[bytes]], None]) -> None:
    """Have a file of what is in memory, where something is prepared to be kept.

    Args:
        name: Of the file.
        write: Writes its content where the file is not there.
    """
    file = kept_file(name)
    if file is not None and file.is_file():
        _note(file)
    else:
        write_file(name, write)


def _note(file: Path) -> None:
    if _written is not None and file not in _written:
        _written.append(file)


def kept_array(digest: str, shape: tuple[int, ...], make: Callable[[], Array]) -> Array:
    """The array of a digest from its file, or made.

    Args:
        digest: Of all that it is made from, and of how.
        shape: Its lengths, -1 for one that may be any; a file with another one is not read.
        make: Makes it.
    """
    name = f"{digest}.npy"
    file = kept_file(name)
    if file is not None and (stored := _read(file, shape)) is not None:
        _note(file)
        return stored
    made = make()
    write_file(name, lambda stream: np.save(stream, made, allow_pickle=False))
    return made


def _read(file: Path, shape: tuple[int, ...]) -> Array | None:
    try:
        stored = np.load(file, allow_pickle=False)
    except (OSError, ValueError, EOFError):
        return None
    if not isinstance(stored, np.ndarray) or stored.dtype != np.float64:
        return None
    fits = len(shape) == stored.ndim and all(
        length in (-1, own) for length, own in zip(shape, stored.shape, strict=True)
    )
    return stored if fits else None


def _replace(file: Path, write: Callable[[IO[bytes]], None]) -> None:
    """Write a file aside and rename it: another process sees all of it or nothing."""
    file.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile(dir=file.parent, suffix=file.suffix, delete=False) as stream:
        part = Path(stream.name)
        try:
            write(stream)
            stream.flush()
            part.replace(file)
        except OSError:
            part.unlink(missing_ok=True)
            raise
