"""A cache of the values that were asked for last."""

import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, TypeVar

_T = TypeVar("_T")


def _nothing(value: Any) -> int:  # noqa: ARG001
    return 0


class Recent:
    """The values that were asked for last, by key; any thread may ask.

    Args:
        size: How many are kept.
        limit: How many bytes they may have together; the last one is kept whatever it has.
        weigh: Gives the bytes of a value.
    """

    def __init__(
        self, size: int, limit: int | None = None, weigh: Callable[[Any], int] = _nothing
    ) -> None:
        self._size = size
        self._limit = limit
        self._weigh = weigh
        self._lock = threading.Lock()
        self._values: OrderedDict[Any, Any] = OrderedDict()
        self._weights: dict[Any, int] = {}
        self._weight = 0

    @property
    def weight(self) -> int:
        """The bytes of the values that are kept."""
        return self._weight

    def get(self, key: object, make: Callable[[], _T]) -> _T:
        """The value of a key, made if it is not among those kept."""
        with self._lock:
            if key in self._values:
                self._values.move_to_end(key)
                kept: _T = self._values[key]
                return kept
        value = make()
        self.put(key, value)
        return value

    def put(self, key: object, value: object) -> None:
        """Keep a value, and drop those that nobody has asked for longest."""
        weight = self._weigh(value)
        with self._lock:
            self._values[key] = value
            self._values.move_to_end(key)
            self._weight += weight - self._weights.get(key, 0)
            self._weights[key] = weight
            while len(self._values) > self._size or self._is_too_heavy():
                dropped, _ = self._values.popitem(last=False)
                self._weight -= self._weights.pop(dropped)

    def _is_too_heavy(self) -> bool:
        return self._limit is not None and len(self._values) > 1 and self.weight > self._limit

    def __contains__(self, key: object) -> bool:
        return key in self._values
