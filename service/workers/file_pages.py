"""Release of pages of program files that a process mapped while it loaded, and reads no more."""

import ctypes
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

_MAPPINGS = Path("/proc/self/smaps")
#: Advice of `man madvise`: the pages are not needed; those of a file are read again when used.
_MADV_DONTNEED = 4
#: First line of a mapping that is of a file, private and not writable: its bounds, then its path.
_HEADER = re.compile(r"([0-9a-f]+)-([0-9a-f]+) r-[-x]p \S+ \S+ \S+ +/")
_ANY_HEADER = re.compile(r"[0-9a-f]+-[0-9a-f]+ ")


class Mapping(NamedTuple):
    """A mapping of a file into the memory of a process.

    Attributes:
        start: address of its first byte.
        size: its length [bytes].
        resident: how much of it is in memory [bytes].
    """

    start: int
    size: int
    resident: int


def release_file_pages() -> int:
    """Give back the pages of libraries and other files that nothing has changed.

    The kernel keeps them in its cache as long as there is memory, and maps them again where they
    are used. A process that is forked starts without them either way.

    Returns:
        How much was released [bytes]; 0 where the system does not tell what is mapped.
    """
    try:
        lines = _MAPPINGS.read_text("utf-8", "replace").splitlines()
    except OSError:
        return 0
    madvise = ctypes.CDLL(None).madvise
    madvise.argtypes = (ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int)
    mappings = [one for one in unchanged_mappings(lines) if one.resident]
    return sum(
        one.resident for one in mappings if madvise(one.start, one.size, _MADV_DONTNEED) == 0
    )


def unchanged_mappings(lines: Iterable[str]) -> Iterator[Mapping]:
    """Mappings of files whose pages are as in the file, from the lines of `/proc/.../smaps`.

    A mapping with anonymous pages is left out, even if it can't be written to now: the loader has
    written addresses into it.
    """
    bounds: tuple[int, int] | None = None
    resident = 0
    for line in lines:
        if _ANY_HEADER.match(line):
            header = _HEADER.match(line)
            bounds = None if header is None else (int(header[1], 16), int(header[2], 16))
        elif line.startswith("Rss:"):
            resident = 1024 * int(line.split()[1])
        elif line.startswith("Anonymous:") and bounds is not None and line.split()[1] == "0":
            yield Mapping(bounds[0], bounds[1] - bounds[0], resident)
