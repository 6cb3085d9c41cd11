"""The schema: migrations lead to the tables of this version, from every version of before."""

import sqlite3
import zipfile
from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import create_engine, inspect, text

import service.storage.migrations as migrations_module
import service.storage.stores.idempotency_store as idempotency_store_module
from service.problem import ProblemError
from service.storage.database import Database, StoreError
from service.storage.migrations import MIGRATIONS
from service.storage.store import open_store
from service.storage.stores.idempotency_store import IdempotencyKey
from service.storage.stores.job_store import StoredRequest
from service.storage.tables import METADATA, REVISIONS
from tests.service.postgresql import PostgreSQL

DATA = Path(__file__).parent / "data"


def test_the_list_of_revisions_is_that_of_the_migrations() -> None:
    assert tuple(MIGRATIONS) == REVISIONS


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
