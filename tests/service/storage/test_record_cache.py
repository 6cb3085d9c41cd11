"""Records that are remembered: never older than what was written last."""

from service.storage.caches.record_cache import RecordCache
from service.storage.store import Store
from service.storage.stores.document_store import DocumentStore


def test_what_was_looked_up_is_known_until_something_is_written() -> None:
    cache: RecordCache[str] = RecordCache()
    assert cache.recall("a") is None
    assert cache.read("a", lambda: "first") == "first"
    assert cache.recall("a") == cache.read("a", lambda: "second") == "first"
    cache.forget()
    assert cache.recall("a") is None
    assert cache.read("a", lambda: "second") == cache.recall("a") == "second"


def test_what_was_read_before_a_write_is_not_kept_after_it() -> None:
    cache: RecordCache[str] = RecordCache()

    def read_slowly() -> str:
        cache.forget()  # another thread writes while this one has the old record in its hands
        return "old"

    assert cache.read("a", read_slowly) == "old"
    assert cache.recall("a") is None


def test_records_are_bounded_by_their_bytes() -> None:
    cache: RecordCache[str] = RecordCache()
    long = "x" * 2**20
    for number in range(8):
        cache.read(number, lambda: long)
    assert [cache.recall(number) is None for number in range(8)] == [True] * 5 + [False] * 3


def test_documents_are_known_as_they_were_written_last(store: Store) -> None:
    documents = DocumentStore(store.database, cache=RecordCache())
    first = documents.create("scene", "a", b"one")
    assert documents.recall("scene", "a") is None
    assert documents.record("scene", "a") == documents.recall("scene", "a") == first
    second = documents.replace("scene", "a", b"two")
    assert documents.recall("scene", "a") is None
    assert documents.record("scene", "a") == documents.recall("scene", "a") == second
    assert documents.recall("robot", "a") is None
    documents.delete("scene", "a")
    assert documents.recall("scene", "a") is None


def test_a_store_that_others_share_remembers_nothing(store: Store) -> None:
    assert store.records is None
    store.documents.create("scene", "a", b"one")
    store.documents.record("scene", "a")
    assert store.documents.recall("scene", "a") is None
