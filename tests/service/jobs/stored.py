"""A store in a file and requests to be kept in it, for tests without a service."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from service.storage.store import Store, open_store
from service.storage.stores.job_store import JobRecord, StoredRequest

REQUEST = StoredRequest("POST", "/v1/plan", "application/json", b'{"a": 1}')


@contextmanager
def opened(folder: Path) -> Iterator[Store]:
    """A store in a folder, closed afterwards."""
    store = open_store(f"sqlite:///{folder / 'armwright.db'}")
    try:
        yield store
    finally:
        store.close()


def record(number: int = 1, **changes: Any) -> JobRecord:
    """The record of a queued job; those of larger numbers are later."""
    fields: dict[str, Any] = {
        "id": f"{number:032x}", "method": REQUEST.method, "path": REQUEST.path, "status": "queued",
        "created": 1000.0 + number,
    }  # fmt: skip
    return JobRecord(**(fields | changes))
