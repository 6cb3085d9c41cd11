"""Idempotency keys in the database: claimed, answered, given back, forgotten."""

import time
from concurrent.futures import ThreadPoolExecutor
from typing import NoReturn

import pytest
from sqlalchemy import insert

from service.http.errors import status_of
from service.storage.database import StorageUnavailable
from service.storage.store import Store, open_store
from service.storage.stores.idempotency_store import IdempotencyKey, Recorded, keep_answer
from service.storage.tables import servers
from service.validation import ProblemError

KEY = IdempotencyKey("k", "POST /x")
ANSWER = Recorded(201, {"location": "/y"}, b"{}")


def refusal(store: Store, key: IdempotencyKey, request_hash: str) -> tuple[str, int]:
    with pytest.raises(ProblemError) as error:
        store.answers.begin(key, request_hash)
    return error.value.code, status_of(error.value)


def test_a_key_is_claimed_and_then_stands_for_its_answer(store: Store) -> None:
    assert store.answers.begin(KEY, "hash") is None
    assert refusal(store, KEY, "hash") == ("CONFLICT", 409)
    store.answers.finish(KEY, ANSWER)
    assert store.answers.begin(KEY, "hash") == ANSWER
    assert refusal(store, KEY, "other") == ("IDEMPOTENCY_KEY_REUSED", 422)


def test_a_key_that_is_given_back_may_be_claimed_again(store: Store) -> None:
    assert store.answers.begin(KEY, "hash") is None
    store.answers.forget(KEY)
    assert store.answers.begin(KEY, "other") is None


@pytest.mark.parametrize("end", ["forget", "finish"])
def test_a_key_is_free_again_after_a_fault_of_the_storage(
    store: Store, monkeypatch: pytest.MonkeyPatch, end: str
) -> None:
    assert store.answers.begin(KEY, "hash") is None

    def away(**_: object) -> NoReturn:
        raise StorageUnavailable("the disk is full")

    with monkeypatch.context() as fault:
        fault.setattr(store.database, "transaction", away)
        with pytest.raises(StorageUnavailable):
            store.answers.forget(KEY) if end == "forget" else store.answers.finish(KEY, ANSWER)
        with pytest.raises(StorageUnavailable):
            store.answers.begin(KEY, "hash")
    assert store.answers.begin(KEY, "hash") is None, "nobody works on it"
    assert refusal(store, KEY, "hash") == ("CONFLICT", 409)
    store.answers.finish(KEY, ANSWER)
    assert store.answers.begin(KEY, "hash") == ANSWER


def test_a_key_whose_answer_was_stored_with_what_it_made_is_released(store: Store) -> None:
    assert store.answers.begin(KEY, "hash") is None
    with store.database.transaction() as connection:
        keep_answer(connection, KEY, ANSWER)
    assert store.answers.begin(KEY, "hash") == ANSWER  # while its request is being answered
    store.answers.release(KEY)
    assert store.answers.begin(KEY, "hash") == ANSWER


def test_endpoints_and_tenants_have_keys_of_their_own(store: Store) -> None:
    assert store.answers.begin(KEY, "hash") is None
    assert store.answers.begin(IdempotencyKey("k", "POST /elsewhere"), "other") is None
    assert store.answers.begin(IdempotencyKey("k", "POST /x", "another tenant"), "other") is None
    assert store.answers.begin(IdempotencyKey("another", "POST /x"), "other") is None


def test_keys_are_forgotten_after_a_day(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    now = 1_000_000.0
    monkeypatch.setattr("service.storage.stores.idempotency_store.time.time", lambda: now)
    store.answers.begin(KEY, "hash")
    store.answers.finish(KEY, ANSWER)
    now += 23 * 3600.0
    assert store.answers.begin(KEY, "hash") == ANSWER
    now += 2 * 3600.0
    assert store.answers.begin(KEY, "other") is None


def test_of_many_that_claim_a_key_at_once_one_gets_it(url: str) -> None:
    stores = [open_store(url) for _ in range(3)]
    with stores[0].database.transaction() as connection:  # as servers that share it
        for store in stores:
            living = {"id": store.server, "started": time.time(), "seen": time.time()}
            connection.execute(insert(servers), living)
    results: list[str] = []

    def claim(store: Store, number: int) -> None:
        try:
            assert store.answers.begin(IdempotencyKey(f"k{number}", "POST /x"), "hash") is None
            results.append("claimed")
        except ProblemError as error:
            results.append(error.code)

    with ThreadPoolExecutor(30) as pool:
        list(pool.map(claim, stores * 10, sorted([*range(10)] * 3)))
    for store in stores:
        store.close()
    assert sorted(results) == ["CONFLICT"] * 20 + ["claimed"] * 10


def test_a_key_that_a_dead_server_claimed_is_free(url: str) -> None:
    first, second = open_store(url), open_store(url)
    first.servers.register(first.server)
    assert first.answers.begin(KEY, "hash") is None
    assert refusal(second, KEY, "hash") == ("CONFLICT", 409)
    first.servers.remove(first.server)
    assert second.answers.begin(KEY, "hash") is None
    assert refusal(second, KEY, "hash") == ("CONFLICT", 409)
    first.close()
    second.close()
