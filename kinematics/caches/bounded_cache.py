"""A cache of a function's last values that is bounded by the memory they take, not only by number.

Programs, trees and covers of large meshes take megabytes each; thousands of small ones take next to
nothing. What a value takes is measured: the growth of what was allocated while it was made.
"""

import ctypes
from collections.abc import Callable
from functools import _lru_cache_wrapper, cache, lru_cache, wraps
from typing import Any, TypeVar

import numpy as np

T = TypeVar("T")

_MEBIBYTE = 2**20
#: What the values of one cache may take together, where nothing else is said [byte].
DEFAULT_LIMIT = 32 * _MEBIBYTE


class _Allocations(ctypes.Structure):
    """``struct mallinfo2`` of the GNU C library."""

    _fields_ = [
        (name, ctypes.c_size_t)
        for name in (
            "arena", "ordblks", "smblks", "hblks", "hblkhd", "usmblks", "fsmblks", "uordblks",
            "fordblks", "keepcost",
        )
    ]  # fmt: skip


@cache
def _mallinfo() -> Callable[[], Any] | None:
    function = getattr(ctypes.CDLL(None), "mallinfo2", None)
    if function is not None:
        function.restype = _Allocations
    return function


def allocated_bytes() -> int:
    """Memory that this process has allocated and not freed [byte].

    Small objects of the interpreter are not counted. Where the C library can't tell, it is 0, and
    caches are bounded by number alone.
    """
    function = _mallinfo()
    if function is None:
        return 0
    found = function()
    return int(found.uordblks + found.hblkhd)


def array_bytes(value: object) -> int:
    """Memory of an array, or of all arrays in tuples [byte]: what else is in them is small."""
    if isinstance(value, np.ndarray):
        return value.nbytes
    if not isinstance(value, tuple):
        return 0
    total, waiting = 0, list(value)
    for item in waiting:
        if isinstance(item, np.ndarray):
            total += item.nbytes
        elif isinstance(item, tuple):
            waiting += item
    return total


def bounded_cache(
    maxsize: int, limit: int = DEFAULT_LIMIT, weigh: Callable[[Any], int] | None = None
) -> Callable[[Callable[..., T]], "_lru_cache_wrapper[T]"]:
    """Store the last values of a function, as `functools.lru_cache` does, within some memory.

    When a new value would take the cache beyond its limit, all older ones are dropped: a hit costs
    no more than it does there.

    Args:
        maxsize: Number of values that are stored.
        limit: Memory that all values may take [byte]; the last one is kept whatever it takes.
        weigh: Memory of a value [byte], where it is known without measuring, which takes 40 us.
    """

    def decorate(function: Callable[..., T]) -> "_lru_cache_wrapper[T]":
        taken = 0

        @wraps(function)
        def make(*args: Any, **named: Any) -> T:
            nonlocal taken
            before = allocated_bytes() if weigh is None else 0
            value = function(*args, **named)
            weight = max(allocated_bytes() - before, 0) if weigh is None else weigh(value)
            weight += sum(len(key) for key in args if isinstance(key, bytes))
            if taken + weight > limit:
                kept.cache_clear()
                taken = 0
            taken += weight
            return value

        kept = lru_cache(maxsize)(make)
        return kept

    return decorate
