"""Files of what takes long to compute from a robot's or a scene's solids, for all processes.

Their names are digests of all that they were computed from. They are written while something is
prepared to be kept, or in place of files that can't be read, and read whenever there is a folder
for them. What is prepared has a note of
all files that it needs, also of those that others wrote: they stay as long as one of them does.
"""

import contextlib
import io
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO

import numpy as np

from compiled.kept_file import read_kept, write_kept
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


def read_file(name: str) -> IO[bytes] | None:
    """The content of a file; None where there is none that can be trusted."""
    content = None if _directory is None else read_kept(_directory / name)
    return None if content is None else io.BytesIO(content)


def write_file(name: str, write: Callable[[IO[bytes]], None]) -> None:
    """Have a file written where something is prepared to be kept or one can't be read.

    Args:
        name: Name of the file.
        write: Writes its content.
    """
    if _directory is None or (_written is None and not (_directory / name).exists()):
        return
    content = io.BytesIO()
    write(content)
    with contextlib.suppress(OSError):  # it is computed again where it could not be kept
        write_kept(_directory / name, content.getvalue())
        _note(name)


def keep_file(name: str, write: Callable[[IO[bytes]], None]) -> None:
    """Have a file of what is in memory, where something is prepared to be kept.

    Args:
        name: Name of the file.
        write: Writes its content where the file is not there.
    """
    if read_file(name) is not None:
        _note(name)
    else:
        write_file(name, write)


def _note(name: str) -> None:
    file = None if _directory is None else _directory / name
    if _written is not None and file is not None and file not in _written:
        _written.append(file)


def kept_array(digest: str, shape: tuple[int, ...], make: Callable[[], Array]) -> Array:
    """The array of a digest from its file, or made.

    Args:
        digest: Digest of all that it is made from, and of how.
        shape: Lengths of the array, -1 for one that may be any; a file with another one is not
            read.
        make: Makes it.
    """
    name = f"{digest}.npy"
    if (stored := _read(name, shape)) is not None:
        _note(name)
        return stored
    made = make()
    write_file(name, lambda stream: np.save(stream, made, allow_pickle=False))
    return made


def _read(name: str, shape: tuple[int, ...]) -> Array | None:
    file = read_file(name)
    try:
        stored = None if file is None else np.load(file, allow_pickle=False)
    except (OSError, ValueError, EOFError):
        return None
    if not isinstance(stored, np.ndarray) or stored.dtype != np.float64:
        return None
    fits = len(shape) == stored.ndim and all(
        length in (-1, own) for length, own in zip(shape, stored.shape, strict=True)
    )
    return stored if fits else None
