"""Memory of processes, as the system tells it."""

import os

_PAGE = os.sysconf("SC_PAGE_SIZE")
#: A line of statm is shorter [byte].
_LINE_BYTES = 128


class MemoryMeter:
    """The memory of a process, looked at again and again.

    After every job of a worker: to open the file each time takes five times as long as to read it.

    Args:
        pid: Of the process.
    """

    def __init__(self, pid: int) -> None:
        try:
            self._file: int | None = os.open(f"/proc/{pid}/statm", os.O_RDONLY)
        except OSError:
            self._file = None

    @property
    def size(self) -> int:
        """Its address space [byte]; 0 if it has ended."""
        return self._pages(0) * _PAGE

    @property
    def resident(self) -> int:
        """The memory that it has in use [byte]; 0 if it has ended."""
        return self._pages(1) * _PAGE

    def close(self) -> None:
        """Look no more."""
        file, self._file = self._file, None
        if file is not None:
            os.close(file)

    def _pages(self, field: int) -> int:
        if self._file is None:
            return 0
        try:
            return int(os.pread(self._file, _LINE_BYTES, 0).split(None, field + 1)[field])
        except (OSError, ValueError, IndexError):
            return 0
