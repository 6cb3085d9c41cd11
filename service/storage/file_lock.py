"""A lock on a file, which the system takes back when the process ends, however it ends."""

import fcntl
import os
from pathlib import Path


class FileLocked(Exception):
    """Another process holds the lock, or this one holds it already."""


class FileLock:
    """A lock that is held until it is released or the process ends.

    Args:
        path: Of the file, which is made if it is not there, and stays.

    Raises:
        FileLocked: The lock is held already.
        OSError: The file can't be made.
    """

    def __init__(self, path: Path) -> None:
        self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(self._descriptor)
            raise FileLocked(path) from None

    def release(self) -> None:
        """Let the lock go; a second time changes nothing."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1
