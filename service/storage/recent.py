"""A cache of the values that were asked for last."""

import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, TypeVar

_T = TypeVar("_T")


class Recent:
    """The values that were asked for last, by key; any thread may ask.

    Args:
        size: How many are kept.
    """

    def __init__(self, size: int) -> None:
        self._size = size
        self._lock = threading.Lock()
        self._values: OrderedDict[Any, Any] = OrderedDict()

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
        with self._lock:
            self._values[key] = value
            self._values.move_to_end(key)
            while len(self._values) > self._size:
                self._values.popitem(last=False)

    def __contains__(self, key: object) -> bool:
        return key in self._values
