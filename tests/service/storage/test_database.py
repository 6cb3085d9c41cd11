"""The database file: transactions, claims of a process that is gone, files that are not ours."""

import sqlite3
import threading
from pathlib import Path

import pytest

from service.storage.database import Database, StoreError


def count(database: Database) -> int:
    with database.reading() as connection:
        (rows,) = connection.execute("SELECT COUNT(*) FROM answers").fetchone()
    return int(rows)


def insert(connection: sqlite3.Connection, key: str, status: int | None = 200) -> None:
    connection.execute(
        "INSERT INTO answers (key, endpoint, request_hash, status, created) "
        "VALUES (?, '', '', ?, 0)",
        (key, status),
    )


def interrupt(database: Database, error: type[BaseException]) -> None:
    with database.transaction() as connection:
        insert(connection, "first")
        raise error


@pytest.mark.parametrize("error", [KeyError, KeyboardInterrupt])
def test_a_transaction_that_fails_leaves_nothing_behind(
    tmp_path: Path, error: type[BaseException]
) -> None:
    database = Database(tmp_path / "a.db")
    with pytest.raises(error):
        interrupt(database, error)
    assert count(database) == 0
    with database.transaction() as connection:
        insert(connection, "second")
    assert count(database) == 1
    database.close()


def test_transactions_of_threads_follow_each_other(tmp_path: Path) -> None:
    database = Database(tmp_path / "a.db")
    inside, most = [0], [0]

    def work(number: int) -> None:
        for step in range(10):
            with database.transaction() as connection:
                inside[0] += 1
                most[0] = max(most[0], inside[0])
                insert(connection, f"{number}-{step}")
                inside[0] -= 1

    threads = [threading.Thread(target=work, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert count(database) == 40
    assert most == [1]
    database.close()


def test_claims_of_a_process_that_is_gone_are_forgotten_at_the_start(tmp_path: Path) -> None:
    first = Database(tmp_path / "a.db")
    with first.transaction() as connection:
        insert(connection, "claimed", None)
        insert(connection, "answered", 201)
    first.close()
    second = Database(tmp_path / "a.db")
    with second.reading() as connection:
        assert connection.execute("SELECT key FROM answers").fetchall() == [("answered",)]
    second.close()


def test_folders_of_the_file_are_made(tmp_path: Path) -> None:
    path = tmp_path / "one" / "two" / "a.db"
    Database(path).close()
    assert path.is_file()


def foreign(path: Path) -> None:
    path.write_bytes(b"this is a text, and a rather long one at that" * 100)


def a_folder(path: Path) -> None:
    path.mkdir()


def of_another_version(path: Path) -> None:
    with sqlite3.connect(path) as connection:
        connection.execute("PRAGMA user_version = 99")
    connection.close()


@pytest.mark.parametrize(
    ("prepare", "words"),
    [
        (foreign, "can't be used: file is not a database"),
        (a_folder, "can't be used: unable to open"),
        (of_another_version, r"written by another version of Armwright \(schema 99"),
    ],
)
def test_a_file_that_is_not_ours_is_left_alone(tmp_path: Path, prepare: object, words: str) -> None:
    path = tmp_path / "a.db"
    assert callable(prepare)
    prepare(path)
    before = path.read_bytes() if path.is_file() else None
    with pytest.raises(StoreError, match=words) as error:
        Database(path)
    assert str(path) in str(error.value)
    assert before == (path.read_bytes() if path.is_file() else None)


def test_a_folder_that_is_a_file_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(StoreError, match=r"--data-dir or ARMWRIGHT_DATA_DIR"):
        Database(tmp_path / "file" / "a.db")
