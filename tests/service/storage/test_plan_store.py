"""Kept plans in the database: what comes back, whose it is, and what is forgotten when."""

from dataclasses import replace

import pytest

from service.problem import ProblemError
from service.storage.caches.prepared_files import document_hash
from service.storage.store import Store
from service.storage.stores.plan_store import (
    PlanContent,
    PlanRecord,
    PlanStore,
    Retention,
)

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


def test_documents_are_bounded_together(store: Store) -> None:
    for number in range(1, 5):
        document = bytes([number]) * 100
        digest = document_hash(document)
        store.plans.add(record(number, robot_hash=digest), CONTENT, {digest: document})
    store.plans.purge(9.0, replace(PLENTY, storage=250))
    assert ids(store.plans) == [4, 3]
    assert store.plans.document(document_hash(b"\x02" * 100), "default") is None
    assert store.plans.document(document_hash(b"\x03" * 100), "default") == b"\x03" * 100
