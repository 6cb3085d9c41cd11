"""Times that tests judge on machines which do other things meanwhile."""

from collections.abc import Callable

#: How often a time is taken that was too long.
_ATTEMPTS = 5


def quickest(attempt: Callable[[], float], enough: float) -> float:
    """The shortest of up to five times, as soon as one of them is short enough [s].

    Tests share the processors with others: what takes too long every time does so by itself.

    Args:
        attempt: Does what is judged, and tells how long it took [s].
        enough: When no further attempt is made [s].
    """
    shortest = attempt()
    for _ in range(1, _ATTEMPTS):
        if shortest < enough:
            break
        shortest = min(shortest, attempt())
    return shortest
