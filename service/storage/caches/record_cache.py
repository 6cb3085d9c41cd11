"""Metadata of documents that were looked up lately, for a database that one process has alone."""

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

from service.storage.caches.recent import Recent

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
