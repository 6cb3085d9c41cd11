import sqlite3
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from service.http.errors import status_of
from service.problem import ProblemError
from service.storage.database import StoreError
from service.storage.document_store import Recorded, SqliteStore, Store, open_store


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "deep" / "er" / "armwright.db"


@pytest.fixture
def store(path: Path) -> Iterator[Store]:
    opened = open_store(f"sqlite:///{path}")
    yield opened
    opened.close()


def code_of(error: pytest.ExceptionInfo[ProblemError]) -> tuple[str, int]:
    return error.value.code, status_of(error.value)


def test_documents_are_created_replaced_and_deleted(store: Store) -> None:
    first = store.create("scene", "a", b"one")
    assert (first.name, first.version, first.size) == ("a", 1, 3)
    assert first.hash == "7692c3ad3540bb803c020b3aee66cd8887123234ea0c6e7143c0add73ff431ed"
    assert store.get("scene", "a").content == b"one"
    with pytest.raises(ProblemError) as conflict:
        store.create("scene", "a", b"other")
    assert code_of(conflict) == ("CONFLICT", 409)
    second = store.replace("scene", "a", b"\x00two\xff")
    assert (second.version, second.created) == (2, first.created)
    assert second.updated >= first.updated
    assert store.get("scene", "a").content == b"\x00two\xff"
    assert store.replace("scene", "new", b"").version == 1
    store.delete("scene", "a")
    for refused in (store.get, store.delete):
        with pytest.raises(ProblemError) as missing:
            refused("scene", "a")
        assert code_of(missing) == ("NOT_FOUND", 404)


def test_kinds_do_not_see_each_other(store: Store) -> None:
    store.create("scene", "a", b"scene")
    store.create("robot", "a", b"robot")
    store.delete("scene", "a")
    assert store.get("robot", "a").content == b"robot"


def test_lists_are_in_pages_by_name(store: Store) -> None:
    names = [f"scene_{number:03d}" for number in range(25)]
    for name in reversed(names):
        store.create("scene", name, name.encode())
    listed: list[str] = []
    while page := store.list("scene", listed[-1] if listed else "", 10):
        listed += [record.name for record in page]
    assert listed == names


def test_everything_survives_a_restart_but_claims(path: Path) -> None:
    first = open_store(f"sqlite:///{path}")
    record = first.create("robot", "a", b"content")
    answer = Recorded(201, {"location": "/x"}, b"body")
    assert first.begin("done", "POST /x", "h") is None
    first.finish("done", "POST /x", answer)
    assert first.begin("claimed", "POST /x", "h") is None
    first.close()
    second = open_store(f"sqlite:///{path}")
    assert second.get("robot", "a").record == record
    assert second.begin("done", "POST /x", "h") == answer
    assert second.begin("claimed", "POST /x", "h") is None, "whoever claimed it is gone"
    second.close()


def test_what_was_committed_survives_without_closing(path: Path) -> None:
    first = open_store(f"sqlite:///{path}")
    first.create("robot", "a", b"content")
    second = open_store(f"sqlite:///{path}")
    assert second.get("robot", "a").content == b"content"
    second.close()
    first.close()


def test_idempotency_keys(store: Store) -> None:
    assert store.begin("k", "POST /x", "hash") is None
    with pytest.raises(ProblemError) as in_flight:
        store.begin("k", "POST /x", "hash")
    assert code_of(in_flight) == ("CONFLICT", 409)
    store.finish("k", "POST /x", Recorded(201, {"location": "/y"}, b"{}"))
    assert store.begin("k", "POST /x", "hash") == Recorded(201, {"location": "/y"}, b"{}")
    with pytest.raises(ProblemError) as reused:
        store.begin("k", "POST /x", "other")
    assert code_of(reused) == ("IDEMPOTENCY_KEY_REUSED", 422)
    assert store.begin("k", "POST /elsewhere", "other") is None
    store.forget("k", "POST /elsewhere")
    assert store.begin("k", "POST /elsewhere", "third") is None


def test_keys_are_forgotten_after_a_day(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    now = 1_000_000.0
    monkeypatch.setattr("service.storage.document_store.time.time", lambda: now)
    store.begin("k", "POST /x", "hash")
    store.finish("k", "POST /x", Recorded(201, {}, b""))
    now += 23 * 3600.0
    assert store.begin("k", "POST /x", "hash") is not None
    now += 2 * 3600.0
    assert store.begin("k", "POST /x", "other") is None


def test_threads_do_not_get_in_each_others_way(store: Store) -> None:
    conflicts: list[str] = []

    def work(own: int) -> None:
        for number in range(20):
            store.replace("scene", f"{own}_{number}", b"x")
            try:
                store.create("scene", f"shared_{number}", b"x")
            except ProblemError as error:
                conflicts.append(error.code)
            store.list("scene", "", 5)

    threads = [threading.Thread(target=work, args=(own,)) for own in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(store.list("scene", "", 1000)) == 6 * 20 + 20
    assert conflicts == ["CONFLICT"] * 100


def test_write_ahead_log_is_on(path: Path, store: Store) -> None:
    with sqlite3.connect(path) as database:
        assert database.execute("PRAGMA journal_mode").fetchone() == ("wal",)
    database.close()


def test_start_up_errors_are_sentences(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="only sqlite"):
        open_store("postgresql://x/y")
    file = tmp_path / "file"
    file.write_text("x")
    with pytest.raises(StoreError, match="--data-dir"):
        SqliteStore(file / "armwright.db")
    with pytest.raises(StoreError, match="can't be used"):
        SqliteStore(Path("/proc/armwright/armwright.db"))
    garbage = tmp_path / "garbage.db"
    garbage.write_bytes(b"no database at all " * 1000)
    with pytest.raises(StoreError, match="damaged"):
        SqliteStore(garbage)


def test_a_damaged_database_is_noticed(path: Path) -> None:
    store = open_store(f"sqlite:///{path}")
    for number in range(200):
        store.create("scene", f"s{number}", bytes(500))
    store.close()
    content = bytearray(path.read_bytes())
    content[4096 : 4096 * 10] = b"\xa5" * (4096 * 9)
    path.write_bytes(content)
    with pytest.raises(StoreError, match="restore"):
        open_store(f"sqlite:///{path}")


def test_a_database_of_a_later_version_is_left_alone(path: Path) -> None:
    open_store(f"sqlite:///{path}").close()
    with sqlite3.connect(path) as database:
        database.execute("PRAGMA user_version = 99")
    database.close()
    with pytest.raises(StoreError, match="another version"):
        open_store(f"sqlite:///{path}")
