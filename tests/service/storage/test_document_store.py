"""Documents, plans, keys and robots in the database, and the page about back-ups."""

import os
import re
import subprocess
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest
from sqlalchemy import text

from service.http.errors import status_of
from service.storage.caches.cache_key import Kind, Reference, builtin_reference
from service.storage.caches.prepared_files import document_hash
from service.storage.database import Database, StoreError
from service.storage.robot_repository import RobotRepository, is_built_in
from service.storage.store import Store, open_store
from service.storage.stores.audit_store import Actor, last_entries
from service.storage.stores.document_store import DocumentStore
from service.storage.stores.idempotency_store import IdempotencyKey, KeptAnswer, Recorded
from service.storage.stores.key_store import ApiKey
from service.storage.stores.plan_store import (
    PlanContent,
    PlanRecord,
    PlanStore,
    Retention,
)
from service.validation import ProblemError

KEY = IdempotencyKey("k", "POST /v1/scenes")


@pytest.fixture
def documents(store: Store) -> DocumentStore:
    return store.documents


def code_of(error: pytest.ExceptionInfo[ProblemError]) -> tuple[str, int]:
    return error.value.code, status_of(error.value)


def test_documents_are_created_replaced_and_deleted(documents: DocumentStore) -> None:
    first = documents.create("scene", "a", b"one")
    assert (first.name, first.version, first.size) == ("a", 1, 3)
    assert first.hash == "7692c3ad3540bb803c020b3aee66cd8887123234ea0c6e7143c0add73ff431ed"
    assert documents.get("scene", "a").content == b"one"
    with pytest.raises(ProblemError) as conflict:
        documents.create("scene", "a", b"other")
    assert code_of(conflict) == ("CONFLICT", 409)
    second = documents.replace("scene", "a", b"\x00two\xff")
    assert (second.version, second.created) == (2, first.created)
    assert second.updated >= first.updated
    assert documents.get("scene", "a").content == b"\x00two\xff"
    assert documents.get("scene", "a").record == documents.record("scene", "a") == second
    assert documents.replace("scene", "new", b"").version == 1
    documents.delete("scene", "a")
    for refused in (documents.get, documents.record, documents.delete):
        with pytest.raises(ProblemError) as missing:
            refused("scene", "a")
        assert code_of(missing) == ("NOT_FOUND", 404)


def test_lists_are_in_pages_by_name(documents: DocumentStore) -> None:
    names = [f"scene_{number:03d}" for number in range(25)]
    for name in reversed(names):
        documents.create("scene", name, name.encode())
    listed: list[str] = []
    while page := documents.list("scene", listed[-1] if listed else "", 10):
        listed += [record.name for record in page]
    assert listed == names


def test_names_sort_by_code_points_as_in_python(documents: DocumentStore) -> None:
    names = ["B", "a", "Z", "a_b", "a.b", "a-b", "ab", "A1", "aB", "1"]
    for name in names:
        documents.create("scene", name, b"")
    assert [record.name for record in documents.list("scene", "", 100)] == sorted(names)
    assert [r.name for r in documents.list("scene", "Z", 100)] == sorted(names)[4:]


def test_a_name_with_nul_is_of_no_document(documents: DocumentStore) -> None:
    documents.create("scene", "a", b"")
    documents.create("scene", "b", b"")
    with pytest.raises(ProblemError, match="no scene"):
        documents.get("scene", "a\0")
    assert [record.name for record in documents.list("scene", "a\0", 10)] == ["b"]


def test_an_answer_is_kept_with_the_document_or_not_at_all(store: Store) -> None:
    def of(record: object) -> Recorded:
        return Recorded(201, {"location": "/v1/scenes/a"}, repr(record).encode())

    assert store.answers.begin(KEY, "hash") is None
    record = store.documents.create("scene", "a", b"", KeptAnswer(KEY, of))
    assert store.answers.begin(KEY, "hash") == of(record)

    def fails(record: object) -> Recorded:
        raise KeyError

    other = IdempotencyKey("other", KEY.endpoint)
    assert store.answers.begin(other, "hash") is None
    with pytest.raises(KeyError):
        store.documents.create("scene", "b", b"", KeptAnswer(other, fails))
    with pytest.raises(ProblemError, match="no scene"):
        store.documents.get("scene", "b")
    with pytest.raises(ProblemError, match="still being worked on"):
        store.answers.begin(other, "hash")


def test_a_precondition_is_asked_in_the_transaction_that_stores(documents: DocumentStore) -> None:
    """Writers that each replace the version they have read lose no update between them."""
    documents.create("scene", "counter", b"0")
    writers, rounds = 4, 10

    class OtherVersionError(Exception):
        pass

    def count(_: int) -> None:
        done = 0
        while done < rounds:
            document = documents.get("scene", "counter")

            def unchanged(current: str | None, expected: str = document.record.hash) -> None:
                if current != expected:
                    raise OtherVersionError

            following = str(int(document.content) + 1).encode()
            try:
                documents.replace("scene", "counter", following, unchanged)
            except OtherVersionError:
                continue
            done += 1

    with ThreadPoolExecutor(writers) as pool:
        list(pool.map(count, range(writers)))
    counted = documents.get("scene", "counter")
    assert counted.content == str(writers * rounds).encode()
    assert counted.record.version == writers * rounds + 1


def test_a_precondition_that_fails_changes_nothing(documents: DocumentStore) -> None:
    seen: list[str | None] = []

    def refuse(current: str | None) -> None:
        seen.append(current)
        raise ProblemError("PRECONDITION_FAILED", "no", stage="storage", hint="-")

    with pytest.raises(ProblemError, match="no"):
        documents.replace("scene", "new", b"content", refuse)
    record = documents.create("scene", "a", b"one")
    with pytest.raises(ProblemError, match="no"):
        documents.replace("scene", "a", b"two", refuse)
    with pytest.raises(ProblemError, match="no"):
        documents.delete("scene", "a", refuse)
    with pytest.raises(ProblemError, match="there is no scene"):
        documents.delete("scene", "b", refuse)
    assert seen == [None, record.hash, record.hash]
    assert [document.name for document in documents.list("scene", "", 10)] == ["a"]
    assert documents.get("scene", "a").content == b"one"


CONTENT = PlanContent(b'{"robot": "arm"}', b'{"status": "success"}')
PLENTY = Retention(lifetime=1e9, count=1000, storage=10**9)


def record(number: int = 1, **changes: object) -> PlanRecord:
    first = PlanRecord(
        id=f"{number:032x}", method="POST", path="/v1/plan", status=200, code=None, robot="arm",
        robot_hash=None, scene=None, scene_hash=None, seed=2**32 - 1, version="0.1.0",
        digest="d" * 64, created=float(number),
    )  # fmt: skip
    return replace(first, **changes)  # type: ignore[arg-type]


def ids(plans: PlanStore, tenant: str = "default") -> list[int]:
    return [int(item.id, 16) for item in plans.list("", 100, tenant)]


def test_a_plan_comes_back_as_it_was_kept(store: Store) -> None:
    whole = record(code="TIMED_OUT", status=504, job="j", replay_of="r", api_key="k")
    store.plans.add(whole, CONTENT)
    assert store.plans.get(whole.id, "default") == (whole, CONTENT)


def test_plans_of_other_tenants_are_not_there(store: Store) -> None:
    store.plans.add(record(1, tenant="one"), CONTENT)
    assert ids(store.plans, "two") == []
    for ask in (store.plans.get, store.plans.delete):
        with pytest.raises(ProblemError) as missing:
            ask(record(1).id, "two")
        assert missing.value.code == "NOT_FOUND"
    assert ids(store.plans, "one") == [1]


@pytest.mark.parametrize("name", ["", "nobody", "'; DROP TABLE plans; --", "a\0b"])
def test_a_plan_that_is_not_there_is_not_found(store: Store, name: str) -> None:
    with pytest.raises(ProblemError) as missing:
        store.plans.get(name, "default")
    assert missing.value.code == "NOT_FOUND"


def test_plans_are_listed_page_by_page_newest_first(store: Store) -> None:
    for number in range(1, 6):
        store.plans.add(record(number, robot="arm" if number % 2 else "leg"), CONTENT)
    first = store.plans.list("", 2, "default")
    assert [int(item.id, 16) for item in first] == [5, 4]
    rest = store.plans.list(first[-1].id, 10, "default")
    assert [int(item.id, 16) for item in rest] == [3, 2, 1]
    arms = store.plans.list("", 10, "default", robot="arm")
    assert [int(item.id, 16) for item in arms] == [5, 3, 1]


def test_a_document_outlives_its_robot(store: Store) -> None:
    stored = store.documents.create("robot", "arm", b"first")
    store.plans.add(record(1, robot_hash=stored.hash), CONTENT)
    store.plans.add(record(2, robot_hash=stored.hash), CONTENT)
    store.documents.replace("robot", "arm", b"second")
    store.documents.delete("robot", "arm")
    assert store.plans.document(stored.hash, "default") == b"first"
    assert store.plans.document(stored.hash, "other") is None
    store.plans.delete(record(1).id, "default")
    assert store.plans.document(stored.hash, "default") == b"first"
    store.plans.delete(record(2).id, "default")
    assert store.plans.document(stored.hash, "default") is None


def test_a_document_that_was_replaced_meanwhile_is_not_mistaken(store: Store) -> None:
    stored = store.documents.create("scene", "table", b"first")
    store.documents.replace("scene", "table", b"second")
    store.plans.add(record(1, scene="table", scene_hash=stored.hash), CONTENT)
    assert store.plans.document(stored.hash, "default") is None


def test_plans_that_are_too_old_or_too_many_are_forgotten(store: Store) -> None:
    for number in range(1, 7):
        store.plans.add(record(number), CONTENT)
    store.plans.purge(7.0, PLENTY)
    assert ids(store.plans) == [6, 5, 4, 3, 2, 1]
    store.plans.purge(7.0, replace(PLENTY, lifetime=5.0))
    assert ids(store.plans) == [6, 5, 4, 3, 2]
    store.plans.purge(7.0, replace(PLENTY, count=3))
    assert ids(store.plans) == [6, 5, 4]
    size = len(CONTENT.request) + len(CONTENT.answer)
    store.plans.purge(7.0, replace(PLENTY, storage=2 * size))
    assert ids(store.plans) == [6, 5]
    store.plans.purge(7.0, replace(PLENTY, storage=1))
    assert ids(store.plans) == [6]


def test_the_bounds_are_of_each_tenant(store: Store) -> None:
    for number in range(1, 9):
        tenant = "quiet" if number == 1 else "busy"
        document = bytes([number]) * 100
        digest = document_hash(document)
        kept = record(number, tenant=tenant, robot_hash=digest)
        store.plans.add(kept, CONTENT, {digest: document})
    store.plans.purge(9.0, replace(PLENTY, count=4))
    assert (ids(store.plans, "quiet"), ids(store.plans, "busy")) == ([1], [8, 7, 6, 5])
    store.plans.purge(9.0, replace(PLENTY, storage=250))
    assert (ids(store.plans, "quiet"), ids(store.plans, "busy")) == ([1], [8, 7])
    store.plans.purge(9.0, replace(PLENTY, storage=1))
    assert (ids(store.plans, "quiet"), ids(store.plans, "busy")) == ([1], [8])


KEY_STORE_KEY = ApiKey(
    "0123456789ab", "of the cell", "d" * 64, "admin", "one", 1000.0, 2000.0, None, 600, 5, 10**10
)


def test_a_key_comes_back_as_it_was_kept(store: Store) -> None:
    assert not store.keys.are_there_any()
    store.keys.add(KEY_STORE_KEY)
    assert store.keys.find(KEY_STORE_KEY.id) == KEY_STORE_KEY
    assert store.keys.find("nobody") is None
    other = replace(KEY_STORE_KEY, id="later", created=3000.0, expires=None, rate=None)
    store.keys.add(other)
    assert store.keys.list() == [KEY_STORE_KEY, other]
    assert store.keys.are_there_any()


def test_a_revoked_key_stays_and_is_not_valid(store: Store) -> None:
    store.keys.add(KEY_STORE_KEY)
    assert KEY_STORE_KEY.is_valid(1999.9)
    assert not KEY_STORE_KEY.is_valid(2000.0)
    assert store.keys.revoke(KEY_STORE_KEY.id)
    assert not store.keys.revoke(KEY_STORE_KEY.id)
    assert not store.keys.revoke("nobody")
    revoked = store.keys.find(KEY_STORE_KEY.id)
    assert revoked is not None
    assert revoked.revoked == pytest.approx(time.time(), abs=5.0)
    assert not revoked.is_valid(1500.0)
    assert store.keys.are_there_any(), "revoking the last key opens nothing"


def test_every_change_is_in_the_audit_log(store: Store) -> None:
    store.keys.add(KEY_STORE_KEY)
    documents = DocumentStore(store.database, Actor("one", KEY_STORE_KEY.id))
    documents.create("robot", "arm", b"1")
    documents.replace("robot", "arm", b"2")
    documents.replace("scene", "table", b"1")
    with pytest.raises(ProblemError):
        documents.create("robot", "arm", b"3")
    with pytest.raises(ProblemError):
        documents.delete("robot", "none")
    documents.delete("robot", "arm")
    store.keys.revoke(KEY_STORE_KEY.id)
    entries = last_entries(store.database, 100)[::-1]
    assert [(entry.api_key, entry.action, entry.target) for entry in entries] == [
        (None, "create", f"key {KEY_STORE_KEY.id}"),
        (KEY_STORE_KEY.id, "create", "robot arm"),
        (KEY_STORE_KEY.id, "replace", "robot arm"),
        (KEY_STORE_KEY.id, "create", "scene table"),
        (KEY_STORE_KEY.id, "delete", "robot arm"),
        (None, "revoke", f"key {KEY_STORE_KEY.id}"),
    ]
    assert {entry.tenant for entry in entries} == {"one"}
    assert all(abs(entry.time - time.time()) < 60.0 for entry in entries)
    assert [entry.action for entry in last_entries(store.database, 2)] == ["revoke", "delete"]


def test_storage_of_a_tenant_is_bounded(store: Store) -> None:
    small = DocumentStore(store.database, Actor("small"), storage_limit=10)
    small.create("scene", "a", b"12345")
    small.create("robot", "b", b"1234")
    for method, name, content in (
        (small.create, "c", b"12"),
        (small.replace, "a", b"1234567"),
        (small.replace, "c", b"12"),
    ):
        with pytest.raises(ProblemError) as error:
            method("scene", name, content)
        assert error.value.code == "QUOTA_EXCEEDED"
        assert error.value.details["storage_limit"] == 10
    assert small.get("scene", "a").content == b"12345", "nothing of it was kept"
    small.replace("scene", "a", b"123456")
    small.delete("robot", "b")
    small.create("scene", "c", b"1234")
    DocumentStore(store.database, Actor("other"), storage_limit=10).create("scene", "a", b"x" * 10)


def found(repository: RobotRepository, kind: Kind, name: str) -> Reference:
    (reference,) = repository.look_up([(kind, name)])
    assert reference is not None
    return reference


def test_built_in_robots_need_no_store_and_go_first(store: Store) -> None:
    store.documents.create("robot", "panda", b"another one")
    repository = RobotRepository(store.documents, "folder")
    assert found(repository, "robot", "panda") == builtin_reference("panda", "folder")
    assert is_built_in("panda")
    assert not is_built_in("Panda")


def test_a_stored_robot_is_known_by_the_hash_of_its_document(store: Store) -> None:
    store.documents.create("robot", "mine", b"one")
    repository = RobotRepository(store.documents, "folder")
    before = found(repository, "robot", "mine")
    assert (before.kind, before.hash) == ("robot", document_hash(b"one"))
    assert (before.folder, before.built_in) == ("folder", False)
    assert repository.document(before) == (before, b"one")
    store.documents.replace("robot", "mine", b"two")
    after, content = repository.document(before)
    assert content == b"two"
    assert after == found(repository, "robot", "mine") != before


def test_scenes_and_robots_have_names_of_their_own(store: Store) -> None:
    store.documents.create("scene", "table", b"{}")
    repository = RobotRepository(store.documents, "folder")
    assert found(repository, "scene", "table").kind == "scene"
    with pytest.raises(ProblemError) as missing:
        found(repository, "robot", "table")
    assert missing.value.code == "NOT_FOUND"
    assert "panda" in (missing.value.hint or ""), "the hint lists the built-in ones"
    with pytest.raises(ProblemError):
        found(repository, "scene", "panda")


PAGE = (Path(__file__).parents[3] / "docs/how_to/back_up.md").read_text("utf-8")
BLOCKS = re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL)
COPY = {"sqlite": BLOCKS[0], "postgresql": BLOCKS[2]}
RESTORE = {"sqlite": BLOCKS[1], "postgresql": BLOCKS[3]}


def run(block: str, url: str, folder: Path) -> str:
    """Run commands of the page, as a person does."""
    data = url.removeprefix("sqlite:///").removesuffix("/armwright.db")
    more = {"ARMWRIGHT_DATA_DIR": data, "DATABASE": url.replace("+psycopg", "")}
    done = subprocess.run(
        ["sh", "-e", "-c", block],
        env={**os.environ, **more}, cwd=folder, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


def held(store: Store) -> tuple[list[str], list[str]]:
    """Names of the scenes and of the keys."""
    scenes = [item.name for item in store.documents.list("scene", "", 100)]
    return scenes, [key.name for key in store.keys.list()]


@pytest.fixture
def kind(url: str) -> str:
    return url.partition(":")[0].partition("+")[0]


def test_a_copy_of_a_running_service_is_restored(url: str, kind: str, tmp_path: Path) -> None:
    store = open_store(url)
    store.documents.create("scene", "before", b"{}")
    store.keys.add(ApiKey("a" * 12, "first", "0" * 64))
    said = run(COPY[kind], url, tmp_path)
    assert kind == "postgresql" or said == "ok\n"
    store.documents.create("scene", "after", b"{}")
    store.documents.delete("scene", "before")
    assert held(store) == (["after"], ["first"])
    store.close()
    run(RESTORE[kind], url, tmp_path)
    restored = open_store(url)
    assert held(restored) == (["before"], ["first"])
    assert restored.documents.get("scene", "before").content == b"{}"
    restored.documents.create("scene", "again", b"{}")
    restored.close()


def test_an_upgrade_is_taken_back(url: str, kind: str, tmp_path: Path) -> None:
    store = open_store(url)
    store.documents.create("scene", "before", b"{}")
    store.close()
    run(COPY[kind], url, tmp_path)
    newer = Database(url)
    with newer.transaction() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '9999'"))
        connection.execute(text("CREATE TABLE of_a_newer_version (id INTEGER)"))
    newer.close()
    with pytest.raises(StoreError, match="newer"):
        open_store(url)
    run(RESTORE[kind], url, tmp_path)
    restored = open_store(url)
    assert held(restored) == (["before"], [])
    restored.close()
