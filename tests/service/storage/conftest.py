"""A database of each kind for the tests of the storage."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from service.storage.store import Store, open_store
from tests.service.postgresql import PostgreSQL


@pytest.fixture(params=["sqlite", "postgresql"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    """The URL of an empty database."""
    if request.param == "sqlite":
        yield f"sqlite:///{tmp_path / 'deep' / 'er' / 'armwright.db'}"
        return
    server: PostgreSQL = request.getfixturevalue("postgresql")
    with server.lent_database() as lent:
        yield lent


@pytest.fixture
def store(url: str) -> Iterator[Store]:
    """A store in an empty database."""
    opened = open_store(url)
    yield opened
    opened.close()
