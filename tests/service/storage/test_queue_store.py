"""Servers and agents that share a database: who lives, and which jobs and chunks they claim."""

import dataclasses
import time
from collections.abc import Iterator

import pytest
from sqlalchemy import select, text

from service.jobs.engine import engine_schema, require_engine
from service.storage import messages
from service.storage.database import StoreError
from service.storage.store import Store, open_store
from service.storage.stores.job_store import JobAnswer, JobRecord
from service.storage.stores.queue_store import AGENTS, Chunk, ChunkAnswer, batch_of
from service.storage.stores.server_store import HEARTBEAT, LIFETIME, now
from tests.service.jobs.stored import REQUEST, record
from tests.service.postgresql import PostgreSQL

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


def test_agents_add_up(stores: tuple[Store, Store]) -> None:
    one, other = stores
    assert one.servers.capacity() == 4
    other.servers.remove(other.server)
    assert one.servers.capacity() == 2


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


def test_the_clock_is_that_of_the_database(store: Store) -> None:
    with store.database.reading() as connection:
        assert connection.execute(select(now(store.database))).scalar_one() == pytest.approx(
            time.time(), abs=2.0
        )


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


def test_a_server_that_ends_is_forgotten(store: Store) -> None:
    store.servers.register("a")
    store.servers.remove("a")
    assert not store.servers.beat("a")


def test_the_server_of_a_file_is_alone(url: str) -> None:
    first, second = open_store(url), open_store(url)
    first.servers.register(first.server)
    second.servers.register(second.server)
    assert first.servers.beat(first.server) == (not first.database.is_file)
    assert second.servers.beat(second.server)
    first.close()
    second.close()
