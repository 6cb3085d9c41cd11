"""Documents in the database: by name, in pages, and of one tenant."""

from concurrent.futures import ThreadPoolExecutor

import pytest

from service.http.errors import status_of
from service.problem import ProblemError
from service.storage.store import Store
from service.storage.stores.audit_store import Actor
from service.storage.stores.document_store import DocumentStore
from service.storage.stores.idempotency_store import IdempotencyKey, KeptAnswer, Recorded

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


def test_tenants_do_not_see_each_other(store: Store) -> None:
    one = DocumentStore(store.database, Actor("one"))
    other = DocumentStore(store.database, Actor("other"))
    one.create("scene", "a", b"of one")
    with pytest.raises(ProblemError, match="no scene"):
        other.get("scene", "a")
    with pytest.raises(ProblemError, match="no scene"):
        other.delete("scene", "a")
    assert other.list("scene", "", 10) == []
    other.create("scene", "a", b"of the other")
    assert other.replace("scene", "a", b"replaced").version == 2
    assert one.get("scene", "a").content == b"of one"
    assert [record.name for record in one.list("scene", "", 10)] == ["a"]


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


def test_threads_do_not_get_in_each_others_way(documents: DocumentStore) -> None:
    conflicts: list[str] = []

    def work(number_of_thread: int) -> None:
        for number in range(20):
            documents.replace("scene", f"{number_of_thread}_{number}", b"x")
            documents.replace("scene", "replaced_by_all", b"x")
            try:
                documents.create("scene", f"shared_{number}", b"x")
            except ProblemError as error:
                conflicts.append(error.code)
            documents.list("scene", "", 5)

    with ThreadPoolExecutor(6) as pool:
        list(pool.map(work, range(6)))
    assert len(documents.list("scene", "", 1000)) == 6 * 20 + 20 + 1
    assert documents.record("scene", "replaced_by_all").version == 6 * 20
    assert conflicts == ["CONFLICT"] * 100


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
