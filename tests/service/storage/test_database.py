"""The database: transactions, locks, faults, migrations, and files that are not ours."""

import sqlite3
import subprocess
import sys
import threading
import time
import zipfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import Connection, create_engine, inspect, text

import service.storage.stores.idempotency_store as idempotency_store_module
import service.storage.tables as migrations_module
from service.http.errors import status_of
from service.storage.database import Database, FileLock, FileLocked, StorageUnavailable, StoreError
from service.storage.store import open_store
from service.storage.stores.idempotency_store import IdempotencyKey
from service.storage.stores.job_store import StoredRequest
from service.storage.tables import METADATA, REVISIONS
from service.validation import ProblemError
from tests.service.postgresql import PostgreSQL

INSERT = text(
    "INSERT INTO answers (tenant, key, endpoint, request_hash, created) "
    "VALUES ('', :key, '', '', 0)"
)


@pytest.fixture
def database(url: str) -> Iterator[Database]:
    opened = Database(url)
    yield opened
    opened.close()


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "a.db"


def count(database: Database) -> int:
    with database.reading() as connection:
        return int(connection.execute(text("SELECT COUNT(*) FROM answers")).scalar_one())


def insert(connection: Connection, key: str) -> None:
    connection.execute(INSERT, {"key": key})


def interrupt(database: Database, error: type[BaseException]) -> None:
    with database.transaction() as connection:
        insert(connection, "first")
        raise error


@pytest.mark.parametrize("error", [KeyError, KeyboardInterrupt])
def test_a_transaction_that_fails_leaves_nothing_behind(
    database: Database, error: type[BaseException]
) -> None:
    with pytest.raises(error):
        interrupt(database, error)
    assert count(database) == 0
    with database.transaction() as connection:
        insert(connection, "second")
    assert count(database) == 1


def test_transactions_of_threads_are_all_kept(database: Database) -> None:
    def work(number: int) -> None:
        for step in range(10):
            with database.transaction(durable=False) as connection:
                insert(connection, f"{number}-{step}")

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(work, range(8)))
    assert count(database) == 80


# ------------------------------------------------------------------------------ durability


@pytest.mark.parametrize(("durable", "level"), [(True, 2), (False, 1)])
def test_a_file_is_synchronised_for_what_is_acknowledged(
    path: Path, durable: bool, level: int
) -> None:
    database = Database(f"sqlite:///{path}")
    for _ in range(3):
        with database.transaction(durable=not durable):
            pass
        with database.transaction(durable=durable) as connection:
            assert connection.execute(text("PRAGMA synchronous")).scalar_one() == level
    database.close()


def test_a_file_has_a_write_ahead_log(path: Path) -> None:
    Database(f"sqlite:///{path}").close()
    with sqlite3.connect(path) as connection:
        assert connection.execute("PRAGMA journal_mode").fetchone() == ("wal",)
    connection.close()


def test_each_connection_keeps_few_pages_of_a_file(path: Path) -> None:
    database = Database(f"sqlite:///{path}")
    try:
        with database.reading() as first, database.reading() as second:
            for connection in (first, second):
                bound = connection.execute(text("PRAGMA cache_size")).scalar_one()
                assert bound == -512  # negative: KiB
    finally:
        database.close()


# ----------------------------------------------------------------------------------- locks


def test_a_file_has_one_server(path: Path) -> None:
    first = Database(f"sqlite:///{path}", exclusive=True)
    with pytest.raises(StoreError, match=r"another server uses .*a\.db\. .*ARMWRIGHT_DATABASE_URL"):
        Database(f"sqlite:///{path}", exclusive=True)
    Database(f"sqlite:///{path}").close()  # whoever makes keys is no server
    first.close()
    Database(f"sqlite:///{path}", exclusive=True).close()


def test_a_file_that_could_not_be_opened_is_not_locked(path: Path) -> None:
    path.write_bytes(b"no database" * 1000)
    with pytest.raises(StoreError, match="not a database"):
        Database(f"sqlite:///{path}", exclusive=True)
    path.unlink()
    Database(f"sqlite:///{path}", exclusive=True).close()


def test_servers_share_a_postgresql_database(postgresql: PostgreSQL) -> None:
    url = postgresql.database()
    with ThreadPoolExecutor(3) as pool:
        opened = list(pool.map(lambda _: Database(url, exclusive=True), range(3)))
    assert [count(database) for database in opened] == [0, 0, 0], "made once, by one of them"
    for database in opened:
        database.close()


def test_postgresql_compresses_large_answers_with_lz4(postgresql: PostgreSQL) -> None:
    database = Database(postgresql.database())
    content = b'{"joints":[0.1,0.2]}' * 10_000
    keep = text(
        "INSERT INTO answers (tenant, key, endpoint, request_hash, created, body)"
        " VALUES ('', 'k', '', '', 0, :body)"
    )
    with database.transaction() as connection:
        connection.execute(keep, {"body": content})
    with database.reading() as connection:
        kept = text("SELECT body, pg_column_compression(body) FROM answers")
        assert connection.execute(kept).one() == (content, "lz4")
    database.close()


# ---------------------------------------------------------------------------------- faults


def test_a_locked_file_is_told_and_works_again_once_it_is_free(path: Path) -> None:
    database = Database(f"sqlite:///{path}")
    other = sqlite3.connect(path, isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    with pytest.raises(StorageUnavailable, match="locked") as error:
        database.probe()
    assert (error.value.code, status_of(error.value)) == ("STORAGE_UNAVAILABLE", 503)
    assert error.value.retry_after
    assert "locked" in (database.fault or "")
    assert count(database) == 0, "reading goes on"
    assert database.fault, "that it can be read does not mean that it can be written"
    other.execute("ROLLBACK")
    database.probe()
    assert database.fault is None
    other.close()
    database.close()


def test_a_full_disk_is_told_and_what_was_begun_is_undone(path: Path) -> None:
    database = Database(f"sqlite:///{path}")

    def fill() -> None:
        with database.transaction() as connection:
            pages = connection.execute(text("PRAGMA page_count")).scalar_one()
            connection.execute(text(f"PRAGMA max_page_count = {pages}"))
            for number in range(100):
                insert(connection, f"{number}" * 1000)

    with pytest.raises(StorageUnavailable, match="full"):
        fill()
    assert "full" in (database.fault or "")
    assert count(database) == 0
    database.close()


def test_a_postgresql_that_is_stopped_is_told_and_found_again(postgresql: PostgreSQL) -> None:
    database = Database(postgresql.database())
    postgresql.stop()
    try:
        with pytest.raises(StorageUnavailable):
            database.probe()
        assert database.fault
    finally:
        postgresql.start()
    database.probe()
    assert database.fault is None
    database.close()


# ---------------------------------------------------------------------------- what is ours


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
        (of_another_version, r"written by a newer version of Armwright \(schema 99"),
    ],
)
def test_a_file_that_is_not_ours_is_left_alone(path: Path, prepare: object, words: str) -> None:
    assert callable(prepare)
    prepare(path)
    before = path.read_bytes() if path.is_file() else None
    with pytest.raises(StoreError, match=words) as error:
        Database(f"sqlite:///{path}")
    assert str(path) in str(error.value)
    assert before == (path.read_bytes() if path.is_file() else None)


def test_a_damaged_database_is_noticed(path: Path) -> None:
    database = Database(f"sqlite:///{path}")
    with database.transaction() as connection:
        for number in range(200):
            insert(connection, f"{number}" * 200)
    database.close()
    content = bytearray(path.read_bytes())
    content[4096 : 4096 * 10] = b"\xa5" * (4096 * 9)
    path.write_bytes(content)
    with pytest.raises(StoreError, match="restore"):
        Database(f"sqlite:///{path}")


def test_a_folder_that_is_a_file_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    for exclusive in (False, True):
        with pytest.raises(StoreError, match=r"--data-dir or ARMWRIGHT_DATA_DIR"):
            Database(f"sqlite:///{tmp_path / 'file' / 'a.db'}", exclusive=exclusive)


@pytest.mark.parametrize(
    "url",
    ["mysql://u:secret@h/x", "sqlite://", "no url", "postgresql+asyncpg://u:secret@h/x", "postgresql://h"],
)  # fmt: skip
def test_urls_of_other_kinds_are_refused(url: str) -> None:
    with pytest.raises(StoreError, match=r"sqlite:///<path> or postgresql\+psycopg://") as error:
        Database(url)
    assert "secret" not in str(error.value)


def test_a_postgresql_that_is_not_there_is_told_without_the_password() -> None:
    with pytest.raises(StoreError, match=r"Check that PostgreSQL runs") as error:
        Database("postgresql+psycopg://u:secret@127.0.0.1:1/x")
    assert "secret" not in str(error.value)


def test_a_missing_driver_is_told_with_the_extra_that_has_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "psycopg", None)
    with pytest.raises(
        StoreError, match=r"Install it: pip install 'armwright\[postgres\]'"
    ) as error:
        Database("postgresql+psycopg://u:secret@127.0.0.1:1/x")
    assert "secret" not in str(error.value)


def test_closing_waits_for_a_transaction_whose_caller_left(tmp_path: Path) -> None:
    database = Database(f"sqlite:///{tmp_path / 'a.sqlite'}")
    inside, leave = threading.Event(), threading.Event()

    def work() -> None:
        with database.transaction() as connection:
            inside.set()
            leave.wait(5.0)
            connection.execute(text("SELECT 1"))

    thread = threading.Thread(target=work)
    thread.start()
    assert inside.wait(5.0)
    threading.Timer(0.1, leave.set).start()
    began = time.monotonic()
    database.close()
    assert time.monotonic() - began >= 0.09
    thread.join()


DATA = Path(__file__).parent / "data"


def test_migrations_make_the_tables_of_this_version(url: str) -> None:
    Database(url).close()
    engine = create_engine(url)
    with engine.connect() as connection:
        context = MigrationContext.configure(connection, opts={"compare_type": True})
        assert compare_metadata(context, METADATA) == []
        for name, table in METADATA.tables.items():
            key = inspect(connection).get_pk_constraint(name)["constrained_columns"]
            assert key == [column.name for column in table.primary_key], name
    engine.dispose()


def test_a_folder_of_before_the_migrations_keeps_everything(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The folder grows old, and idempotency keys with it.
    monkeypatch.setattr(idempotency_store_module, "_KEY_LIFETIME", 1e10)
    # Written by a server of schema 1 that was killed: part of it is in the write-ahead log.
    with zipfile.ZipFile(DATA / "folder_of_schema_1.zip") as archive:
        archive.extractall(tmp_path)
    file = tmp_path / "armwright.db"
    store = open_store(f"sqlite:///{file}", exclusive=True)
    scene = store.documents.get("scene", "table")
    assert scene.record.version == 2
    assert scene.record.hash == "fdcdbc7ae2ecbdeb44cb30d991b2ba3c87b37a2aef2a262cc1dea5e4581be1c7"
    assert scene.content.startswith(b'{"name":"table"')
    assert [record.name for record in store.documents.list("robot", "", 10)] == ["arm"]
    (job,) = store.jobs.list(None, "", 10)
    assert (job.id, job.status, job.tenant) == (
        "01a2035519c93dc099ec0b714061d01b", "running", "default",
    )  # fmt: skip
    request = store.jobs.request(job.id)
    assert request == StoredRequest("POST", "/v1/check", "application/json", request.body)
    assert b'"scene":"table"' in request.body
    key = IdempotencyKey("robot-1", "POST /v1/robots")
    with pytest.raises(ProblemError, match="another body"):
        store.answers.begin(key, "of another body")
    store.close()
    with sqlite3.connect(file) as connection:
        tables = {row[0] for row in connection.execute("SELECT name FROM sqlite_master")}
        assert connection.execute("PRAGMA user_version").fetchone() == (2,), "refused by schema 1"
    connection.close()
    assert not {name for name in tables if name.startswith(("old_", "new_"))}


def test_a_database_of_a_newer_version_is_refused_and_left_alone(url: str) -> None:
    database = Database(url)
    with database.transaction() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '9999'"))
    with pytest.raises(StoreError, match=r"newer version of Armwright \(schema 9999, this one"):
        Database(url)
    with database.reading() as connection:
        left = connection.execute(text("SELECT version_num FROM alembic_version")).scalar_one()
    assert left == "9999"
    database.close()


def test_a_migration_that_fails_leaves_the_database_as_it_was(
    tmp_path: Path, postgresql: PostgreSQL, monkeypatch: pytest.MonkeyPatch
) -> None:
    for url in (f"sqlite:///{tmp_path / 'a.db'}", postgresql.database()):
        with monkeypatch.context() as patch:
            patch.setattr(migrations_module, "REVISIONS", (*REVISIONS, "not there"))
            with pytest.raises(Exception, match="not there"):
                Database(url)
        engine = create_engine(url)
        assert not set(METADATA.tables) & set(inspect(engine).get_table_names())
        engine.dispose()
        Database(url).close()


_HOLD = "import sys; from service.storage.database import FileLock; from pathlib import Path; \
lock = FileLock(Path(sys.argv[1])); print('locked', flush=True); sys.stdin.read()"


def test_a_process_that_is_killed_holds_nothing(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", _HOLD, str(tmp_path / "lock")],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == b"locked\n"
    with pytest.raises(FileLocked):
        FileLock(tmp_path / "lock")
    process.kill()
    process.communicate()
    FileLock(tmp_path / "lock").release()
