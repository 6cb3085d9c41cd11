"""The store as a whole: what is committed is seen by others at once, and outlives all of them."""

from service.storage.store import open_store
from service.storage.stores.idempotency_store import IdempotencyKey, Recorded
from tests.service.jobs.stored import REQUEST, record

KEY = IdempotencyKey("k", "POST /x")
ANSWER = Recorded(201, {"location": "/y"}, b"{}")


def test_everything_is_seen_at_once_and_survives_a_restart(url: str) -> None:
    first, other = open_store(url), open_store(url)
    kept = first.documents.create("robot", "a", b"content")
    first.jobs.add(record(), REQUEST)
    assert first.answers.begin(KEY, "hash") is None
    first.answers.finish(KEY, ANSWER)
    first.close()
    for store in (other, open_store(url)):
        found = store.documents.get("robot", "a")
        assert (found.record, found.content) == (kept, b"content")
        assert store.jobs.get(record().id) == (record(), None)
        assert store.jobs.request(record().id) == REQUEST
        assert store.answers.begin(KEY, "hash") == ANSWER
        store.close()
