"""Servers that share a database: alive by its clock, dead after a silence."""

import time

import pytest
from sqlalchemy import select, text

from service.storage.store import Store, open_store
from service.storage.stores.server_store import HEARTBEAT, LIFETIME, now


def age(store: Store, server: str, seconds: float) -> None:
    """Let a server have been silent for some time [s]."""
    with store.database.transaction() as connection:
        silent = text("UPDATE servers SET seen = seen - :seconds WHERE id = :id")
        connection.execute(silent, {"seconds": seconds, "id": server})


def test_the_clock_is_that_of_the_database(store: Store) -> None:
    with store.database.reading() as connection:
        assert connection.execute(select(now(store.database))).scalar_one() == pytest.approx(
            time.time(), abs=2.0
        )


def test_a_silent_server_is_dead_and_learns_it(store: Store) -> None:
    store.servers.register("a")
    age(store, "a", LIFETIME - 2.0)
    assert store.servers.beat("a")
    age(store, "a", LIFETIME - 2.0)
    assert store.servers.beat("a"), "the last beat counts"
    age(store, "a", LIFETIME + 1.0)
    assert not store.servers.beat("a"), "others may have taken over what it worked on"
    store.servers.register("b")
    assert not store.servers.beat("a")
    assert store.servers.beat("b")
    assert HEARTBEAT < LIFETIME / 3


def test_a_server_that_ends_is_forgotten(store: Store) -> None:
    store.servers.register("a")
    store.servers.remove("a")
    assert not store.servers.beat("a")


def test_the_server_of_a_file_is_alone(url: str) -> None:
    first, second = open_store(url), open_store(url)
    first.servers.register(first.server)
    second.servers.register(second.server)
    assert first.servers.beat(first.server) == (not first.database.is_file)
    assert second.servers.beat(second.server)
    first.close()
    second.close()
