"""Jobs in the database, and the servers and agents that claim them."""

import dataclasses
import time
from collections.abc import Iterator
from dataclasses import replace

import pytest
from sqlalchemy import text
from sqlalchemy.exc import IntegrityError

from service.jobs.engine import engine_schema, require_engine
from service.storage import messages
from service.storage.database import StoreError
from service.storage.store import Store, open_store
from service.storage.stores.idempotency_store import IdempotencyKey, KeptAnswer, Recorded
from service.storage.stores.job_store import (
    AGENTS,
    ENDED,
    STATUSES,
    Chunk,
    ChunkAnswer,
    JobAnswer,
    JobRecord,
    JobStore,
    Status,
    batch_of,
)
from service.storage.stores.server_store import HEARTBEAT, LIFETIME
from service.validation import ProblemError
from tests.service.jobs.stored import REQUEST, record
from tests.service.postgresql import PostgreSQL

ANSWER = JobAnswer("application/json", b'{"b": 2}')


@pytest.fixture
def jobs(store: Store) -> JobStore:
    return store.jobs


def add(
    jobs: JobStore,
    number: int,
    status: Status,
    ended: float | None = None,
    size: int = 8,
    tenant: str = "default",
) -> str:
    """Keep a job that has come to a status; its answer has a size [byte]."""
    first = record(number, tenant=tenant)
    jobs.add(first, REQUEST)
    answer = JobAnswer("text/plain", b"x" * size) if status == "succeeded" else None
    jobs.update(replace(first, status=status, ended=ended), answer)
    return first.id


def kept(jobs: JobStore) -> list[str]:
    return [item.id for item in jobs.list(None, "", 100)]


def test_a_job_comes_back_as_it_was_kept(jobs: JobStore) -> None:
    whole = record(
        progress=0.25, stage="rrt_connect", event=7, created=1.5, started=2.5, ended=None,
        location="/v1/robots/x",
    )  # fmt: skip
    jobs.add(whole, REQUEST)
    assert jobs.get(whole.id) == (whole, None)
    assert jobs.request(whole.id) == REQUEST


@pytest.mark.parametrize("status", STATUSES)
def test_the_request_is_forgotten_when_the_job_has_ended(jobs: JobStore, status: Status) -> None:
    job = add(jobs, 1, status, ended=5.0)
    if status in ENDED:
        with pytest.raises(ProblemError) as missing:
            jobs.request(job)
        assert missing.value.code == "NOT_FOUND"
    else:
        assert jobs.request(job) == REQUEST


@pytest.mark.parametrize("name", ["", "nobody", "'; DROP TABLE jobs; --", "x" * 1000])
def test_a_job_that_is_not_there_is_not_found(jobs: JobStore, name: str) -> None:
    for ask in (jobs.get, jobs.request):
        with pytest.raises(ProblemError) as missing:
            ask(name)
        assert missing.value.code == "NOT_FOUND"
        assert len(missing.value.detail) < 200
    assert jobs.list(None, "", 10) == []


def test_jobs_are_listed_newest_first_in_pages(jobs: JobStore) -> None:
    numbers = [3, 1, 5, 2, 4]
    for number in numbers:
        jobs.add(record(number), REQUEST)
    everything = [record(n).id for n in (5, 4, 3, 2, 1)]
    assert kept(jobs) == everything
    first = jobs.list(None, "", 2)
    assert [item.id for item in first] == everything[:2]
    second = jobs.list(None, first[-1].id, 2)
    assert [item.id for item in second] == everything[2:4]
    assert jobs.list(None, everything[-1], 2) == []


def test_a_list_may_be_of_one_status(jobs: JobStore) -> None:
    for number, status in enumerate(STATUSES * 2):
        add(jobs, number, status, ended=5.0)
    for index, status in enumerate(STATUSES):
        found = [item.id for item in jobs.list(status, "", 10)]
        assert found == [record(index + 5).id, record(index).id]
    assert jobs.counts() == dict.fromkeys(STATUSES, 2)


# ------------------------------------------------------------------------------- forgetting

MANY, HUGE = 100, 10**9


@pytest.mark.parametrize("status", STATUSES)
def test_only_what_has_ended_grows_old(jobs: JobStore, status: Status) -> None:
    job = add(jobs, 1, status, ended=10.0)
    jobs.purge(10.0, MANY, HUGE)
    assert kept(jobs) == [job], "a job at the very end of its lifetime is kept"
    jobs.purge(10.001, MANY, HUGE)
    assert kept(jobs) == ([] if status in ENDED else [job])


def test_the_oldest_of_too_many_are_forgotten(jobs: JobStore) -> None:
    # Not in the order of their ids: what ended last is what somebody is about to ask for.
    ends = {1: 50.0, 2: 40.0, 3: 30.0, 4: 20.0, 5: 10.0}
    for number, end in ends.items():
        add(jobs, number, "succeeded", ended=end)
    waiting = [add(jobs, 6, "queued"), add(jobs, 7, "running")]
    jobs.purge(0.0, 3, HUGE)
    assert set(kept(jobs)) == {record(n).id for n in (1, 2, 3)} | set(waiting)
    jobs.purge(0.0, 3, HUGE)
    assert len(kept(jobs)) == 5


def test_the_oldest_of_too_large_answers_are_forgotten(jobs: JobStore) -> None:
    for number in range(1, 6):
        add(jobs, number, "succeeded", ended=float(number), size=100)
    jobs.purge(0.0, MANY, 300)
    assert kept(jobs) == [record(n).id for n in (5, 4, 3)]
    jobs.purge(0.0, MANY, 299)
    assert kept(jobs) == [record(n).id for n in (5, 4)]
    jobs.purge(0.0, MANY, 1)
    assert kept(jobs) == [record(5).id], "the newest stays however large it is"


def test_the_bounds_are_of_each_tenant(jobs: JobStore) -> None:
    quiet = add(jobs, 1, "succeeded", ended=1.0, size=100, tenant="quiet")
    for number in range(2, 8):
        add(jobs, number, "succeeded", ended=float(number), size=100, tenant="busy")
    jobs.purge(0.0, 3, HUGE)
    assert kept(jobs) == [*(record(n).id for n in (7, 6, 5)), quiet]
    jobs.purge(0.0, MANY, 200)
    assert kept(jobs) == [*(record(n).id for n in (7, 6)), quiet]
    assert jobs.counts("quiet")["succeeded"] == 1
    assert jobs.counts("busy")["succeeded"] == 2
    assert jobs.counts()["succeeded"] == 3


def test_an_answer_is_kept_with_the_job_or_not_at_all(store: Store) -> None:
    key = IdempotencyKey("k", "POST /v1/plan")
    answer = Recorded(202, {"location": "/v1/jobs/x"}, b"{}")
    assert store.answers.begin(key, "hash") is None
    store.jobs.add(record(1), REQUEST, KeptAnswer(key, lambda _: answer))
    assert store.answers.begin(key, "hash") == answer
    other = IdempotencyKey("other", "POST /v1/plan")
    assert store.answers.begin(other, "hash") is None
    with pytest.raises(IntegrityError):  # there is a job of that id already
        store.jobs.add(record(1), REQUEST, KeptAnswer(other, lambda _: answer))
    with pytest.raises(ProblemError, match="still being worked on"):
        store.answers.begin(other, "hash")


# ---------------------------------------------------------------------------- other servers


def test_jobs_of_a_dead_server_are_adopted_by_one_other(url: str) -> None:
    first, second, third = (open_store(url) for _ in range(3))
    first.servers.register(first.server)
    for number in (1, 2, 3):
        first.jobs.add(record(number), REQUEST)
    first.jobs.update(record(2, status="running", started=5.0))
    first.jobs.update(record(3, status="succeeded", ended=5.0), ANSWER)
    assert second.jobs.adopt(10) == [], "it lives"
    first.servers.remove(first.server)
    assert [job.id for job in second.jobs.adopt(1)] == [record(1).id], "the oldest first"
    second.servers.register(second.server)
    (running,) = third.jobs.adopt(10)
    assert (running.id, running.status) == (record(2).id, "running")
    assert first.jobs.taken_away([record(1).id, record(2).id]) == {record(1).id, record(2).id}
    assert not first.jobs.update(record(1, status="succeeded", ended=6.0), ANSWER)
    assert second.jobs.get(record(1).id) == (record(1), None), "a late answer is refused"
    assert second.jobs.update(record(1, status="succeeded", ended=7.0), ANSWER)
    for store in (first, second, third):
        store.close()


def test_a_job_is_cancelled_whoever_works_on_it(url: str) -> None:
    first, second = open_store(url), open_store(url)
    first.jobs.add(record(event=4), REQUEST)
    cancelled = second.jobs.cancel(record().id, 9.0)
    assert cancelled is not None
    assert (cancelled.status, cancelled.ended, cancelled.event) == ("cancelled", 9.0, 5)
    assert second.jobs.cancel(record().id, 10.0) is None
    assert first.jobs.taken_away([record().id]) == {record().id}
    assert not first.jobs.update(record(status="succeeded", ended=10.0), ANSWER)
    assert first.jobs.get(record().id) == (cancelled, None)
    first.close()
    second.close()


def test_a_job_that_is_given_back_is_anybodys(url: str) -> None:
    first, second = open_store(url), open_store(url)
    first.servers.register(first.server)
    first.jobs.add(record(), REQUEST)
    first.jobs.release(record(event=9))
    assert second.jobs.adopt(10) == [record(event=9)]
    assert second.jobs.request(record().id) == REQUEST
    first.close()
    second.close()


CHUNKS: list[Chunk] = [(0, 2, b"[0, 1]"), (2, 1, b"[2]")]
DONE = JobAnswer("application/json", b"{}")


@pytest.fixture
def stores(postgresql: PostgreSQL) -> Iterator[tuple[Store, Store]]:
    """Stores of two agents on one database, with a job in it."""
    with postgresql.lent_database() as url:
        one, other = open_store(url), open_store(url)
        for store in (one, other):
            messages.install(store.database, engine_schema())  # the second time it changes nothing
            store.servers.register(store.server, 2)
        one.jobs.add(record(1, carrier=AGENTS), REQUEST)
        yield one, other
        one.close()
        other.close()


def job() -> str:
    return record(1).id


def test_a_job_is_claimed_by_one_living_agent(stores: tuple[Store, Store]) -> None:
    one, other = stores
    assert messages.waiting_messages(one.database) == 1
    claimed = one.queue.claim(job())
    assert claimed is not None
    assert one.queue.claim(job()) == claimed, "its own again"
    assert other.queue.claim(job()) is None
    assert other.queue.is_open(job())
    assert other.jobs.adopt(10) == [], "servers leave it alone"
    one.servers.remove(one.server)
    assert other.queue.claim(job()) == claimed
    ended = dataclasses.replace(claimed, status="succeeded", ended=2000.0)
    assert not one.jobs.update(ended, DONE), "a late answer"
    assert other.jobs.update(ended, DONE)
    assert not one.queue.is_open(job())
    assert one.queue.claim(job()) is None


def test_a_batch_that_was_cut_is_worked_on_as_chunks(stores: tuple[Store, Store]) -> None:
    one, other = stores
    batch = one.queue.claim(job())
    assert batch is not None
    assert not other.queue.cut(batch, CHUNKS), "it is not its own"
    assert one.queue.cut(batch, CHUNKS)
    assert not one.queue.cut(batch, CHUNKS)
    assert one.queue.claim(job()) is None
    assert not one.queue.is_open(job()), "nothing of it is left but its chunks"
    parts = [other.queue.claim(f"{job()}-{number}") for number in range(3)]
    assert [part and (part.parent, part.first, part.size, part.status) for part in parts] == [
        (job(), 0, 2, "queued"), (job(), 2, 1, "queued"), None,
    ]  # fmt: skip
    bodies = [other.jobs.request(f"{job()}-{n}").body for n in range(2)]
    assert bodies == [body for _, _, body in CHUNKS]
    assert batch_of(f"{job()}-1") == job()
    assert batch_of(job()) is None
    assert messages.waiting_messages(one.database) == 3
    assert one.jobs.counts()["running"] == 1, "chunks are not counted"
    one.jobs.purge(0.0, 0, 0)
    assert other.queue.is_open(f"{job()}-0")


def test_chunks_tell_their_progress_and_are_joined_once(stores: tuple[Store, Store]) -> None:
    one, other = stores
    batch = one.queue.claim(job())
    assert batch is not None
    one.queue.cut(batch, CHUNKS)
    parts = [other.queue.claim(f"{job()}-{number}") for number in range(2)]

    def end(part: JobRecord | None, status: str, content: bytes) -> None:
        assert part is not None
        ended = dataclasses.replace(part, status=status, progress=1.0, ended=2000.0)  # type: ignore[arg-type]
        assert other.jobs.update(ended, JobAnswer("application/json", content))

    end(parts[1], "failed", b"late")
    assert not one.queue.join(job())
    one.queue.report(job())
    standing = one.jobs.get(job())[0]
    assert (standing.status, standing.stage) == ("running", "1 of 3 problems")
    assert standing.progress == pytest.approx(1.0 / 3.0)
    one.queue.report(job())
    assert one.jobs.get(job())[0] == standing, "no event without news"
    end(parts[0], "succeeded", b"early")
    assert other.queue.join(job())
    ended, own = one.jobs.get(job())
    assert (ended.status, ended.progress, own) == ("succeeded", 1.0, None)
    assert ended.is_answered_in_chunks
    assert one.queue.join(job()), "again"
    assert one.jobs.cancel(job(), 3000.0) is None, "it has ended"
    assert one.jobs.get(job())[0] == ended
    assert one.queue.claim(f"{job()}-0") is None
    assert not other.jobs.update(dataclasses.replace(parts[0] or ended, status="failed"), DONE)
    answers = [ChunkAnswer(0, 2, True, b"early"), ChunkAnswer(2, 1, False, b"late")]
    assert one.queue.chunk_answers(job()) == answers
    assert [stored.id for stored in one.jobs.list(None, "", 10)] == [job()]


def test_chunks_are_forgotten_with_their_batch(stores: tuple[Store, Store]) -> None:
    one, other = stores
    batch = one.queue.claim(job())
    assert batch is not None
    one.queue.cut(batch, CHUNKS)
    for number in range(2):
        part = other.queue.claim(f"{job()}-{number}")
        assert part is not None
        ended = dataclasses.replace(part, status="succeeded", ended=2000.0)
        assert other.jobs.update(ended, JobAnswer("application/json", b"x" * 600))
    assert one.queue.join(job())
    newer = record(2, status="succeeded", ended=time.time() + 60.0)
    one.jobs.add(newer, JobAnswer("application/json", b"y" * 600))
    one.jobs.purge(0.0, 10, 1800)
    assert len(one.queue.chunk_answers(job())) == 2
    one.jobs.purge(0.0, 10, 1799)
    assert one.queue.chunk_answers(job()) == []
    assert [stored.id for stored in one.jobs.list(None, "", 10)] == [newer.id]


def test_a_batch_that_was_cancelled_has_no_chunks(stores: tuple[Store, Store]) -> None:
    one, other = stores
    batch = one.queue.claim(job())
    assert batch is not None
    one.queue.cut(batch, CHUNKS)
    assert other.queue.claim(f"{job()}-0") is not None
    assert one.jobs.cancel(job(), 3000.0) is not None
    assert other.jobs.taken_away([f"{job()}-0"]) == {f"{job()}-0"}
    assert other.queue.claim(f"{job()}-1") is None
    assert other.queue.join(job())
    assert one.jobs.get(job())[0].status == "cancelled"


def test_the_load_is_that_of_all_servers(stores: tuple[Store, Store]) -> None:
    one, other = stores
    other.jobs.add(record(2, carrier=AGENTS, api_key="cell"), REQUEST)
    other.jobs.add(record(3), REQUEST)
    size = len(REQUEST.body)
    load = one.queue.load("cell")
    assert (load.count, load.of_key, load.size) == (2, 1, 2 * size)
    assert one.queue.load(None).of_key == 1


def test_agents_need_postgresql(monkeypatch: pytest.MonkeyPatch) -> None:
    require_engine("postgresql+psycopg://x@/y")
    with pytest.raises(StoreError, match="need a PostgreSQL database"):
        require_engine("sqlite:///x.db")
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(StoreError, match="armwright\\[agents\\]"):
        require_engine("postgresql+psycopg://x@/y")


def age(store: Store, server: str, seconds: float) -> None:
    """Let a server have been silent for some time [s]."""
    with store.database.transaction() as connection:
        silent = text("UPDATE servers SET seen = seen - :seconds WHERE id = :id")
        connection.execute(silent, {"seconds": seconds, "id": server})


def test_a_silent_server_is_dead_and_learns_it(store: Store) -> None:
    store.servers.register("a")
    age(store, "a", LIFETIME - 2.0)
    assert store.servers.beat("a")
    age(store, "a", LIFETIME - 2.0)
    assert store.servers.beat("a"), "the last beat counts"
    age(store, "a", LIFETIME + 1.0)
    assert not store.servers.beat("a"), "others may have taken over what it worked on"
    store.servers.register("b")
    assert not store.servers.beat("a")
    assert store.servers.beat("b")
    assert HEARTBEAT < LIFETIME / 3


def test_the_server_of_a_file_is_alone(url: str) -> None:
    first, second = open_store(url), open_store(url)
    first.servers.register(first.server)
    second.servers.register(second.server)
    assert first.servers.beat(first.server) == (not first.database.is_file)
    assert second.servers.beat(second.server)
    first.close()
    second.close()
