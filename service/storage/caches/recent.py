"""A cache of the values that were asked for last."""

import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, Generic, TypeVar

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

    def find(self, key: object) -> Any:
        """The value of a key; None if it is not among those kept."""
        with self._lock:
            if key not in self._values:
                return None
            self._values.move_to_end(key)
            return self._values[key]

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


_R = TypeVar("_R")
#: Records that are kept, and what they may take together [byte]; one is some hundred bytes.
_SIZE = 4096
_LIMIT = 4 * 2**20
#: Memory of a record without its texts, and of its key [byte].
_FRAME = 512


def _record_bytes(record: object) -> int:
    return _FRAME + len(str(record))


class RecordCache(Generic[_R]):
    """Records by key, forgotten whenever something is written.

    What was read before a write and arrives after it is not kept: it may be what was there before.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._records = Recent(_SIZE, _LIMIT, _record_bytes)
        self._writes = 0

    def recall(self, key: object) -> _R | None:
        """The record of a key, if it is kept; this never blocks for long."""
        with self._lock:
            kept: _R | None = self._records.find(key)
            return kept

    def read(self, key: object, look_up: Callable[[], _R]) -> _R:
        """The record of a key, looked up if it is not kept."""
        kept = self.recall(key)
        if kept is not None:
            return kept
        writes = self._writes
        record = look_up()
        with self._lock:
            if writes == self._writes:
                self._records.put(key, record)
        return record

    def forget(self) -> None:
        """Forget all records: something was written, or may have been."""
        with self._lock:
            self._writes += 1
            self._records = Recent(_SIZE, _LIMIT, _record_bytes)
