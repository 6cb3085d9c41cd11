"""API keys and the audit log in the database."""

import time
from dataclasses import replace

import pytest

from service.problem import ProblemError
from service.storage.store import Store
from service.storage.stores.audit_store import Actor, last_entries
from service.storage.stores.document_store import DocumentStore
from service.storage.stores.key_store import ApiKey

KEY = ApiKey(
    "0123456789ab", "of the cell", "d" * 64, "admin", "one", 1000.0, 2000.0, None, 600, 5, 10**10
)


def test_a_key_comes_back_as_it_was_kept(store: Store) -> None:
    assert not store.keys.are_there_any()
    store.keys.add(KEY)
    assert store.keys.find(KEY.id) == KEY
    assert store.keys.find("nobody") is None
    other = replace(KEY, id="later", created=3000.0, expires=None, rate=None)
    store.keys.add(other)
    assert store.keys.list() == [KEY, other]
    assert store.keys.are_there_any()


def test_a_revoked_key_stays_and_is_not_valid(store: Store) -> None:
    store.keys.add(KEY)
    assert KEY.is_valid(1999.9)
    assert not KEY.is_valid(2000.0)
    assert store.keys.revoke(KEY.id)
    assert not store.keys.revoke(KEY.id)
    assert not store.keys.revoke("nobody")
    revoked = store.keys.find(KEY.id)
    assert revoked is not None
    assert revoked.revoked == pytest.approx(time.time(), abs=5.0)
    assert not revoked.is_valid(1500.0)
    assert store.keys.are_there_any(), "revoking the last key opens nothing"


def test_every_change_is_in_the_audit_log(store: Store) -> None:
    store.keys.add(KEY)
    documents = DocumentStore(store.database, Actor("one", KEY.id))
    documents.create("robot", "arm", b"1")
    documents.replace("robot", "arm", b"2")
    documents.replace("scene", "table", b"1")
    with pytest.raises(ProblemError):
        documents.create("robot", "arm", b"3")
    with pytest.raises(ProblemError):
        documents.delete("robot", "none")
    documents.delete("robot", "arm")
    store.keys.revoke(KEY.id)
    entries = last_entries(store.database, 100)[::-1]
    assert [(entry.api_key, entry.action, entry.target) for entry in entries] == [
        (None, "create", f"key {KEY.id}"),
        (KEY.id, "create", "robot arm"),
        (KEY.id, "replace", "robot arm"),
        (KEY.id, "create", "scene table"),
        (KEY.id, "delete", "robot arm"),
        (None, "revoke", f"key {KEY.id}"),
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
