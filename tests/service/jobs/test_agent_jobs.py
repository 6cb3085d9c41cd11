"""Jobs that a queue carries to agents: each is answered once, whatever becomes of an agent."""

import asyncio
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import psycopg
import pytest

from service.access.authentication import Caller
from service.http.state import JobContext
from service.jobs.execution import BATCH_PATH
from service.jobs.runner import AgentJobs
from service.storage.messages import waiting_messages
from service.storage.stores.job_store import JobAnswer, JobRecord, StoredRequest
from service.workers.state import JobsFull
from tests.service.jobs.agents import Machine, run
from tests.service.jobs.loop import until
from tests.service.jobs.stored import REQUEST
from tests.service.postgresql import PostgreSQL


@pytest.fixture(autouse=True)
def _short_periods(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("service.jobs.execution", "service.jobs.engine"):
        monkeypatch.setattr(f"{module}.HEARTBEAT", 0.1)
    monkeypatch.setattr("service.storage.stores.server_store.LIFETIME", 0.6)
    monkeypatch.setattr("service.jobs.engine.LIFETIME", 0.6)
    monkeypatch.setattr("service.jobs.runner.DRAIN", 0.2)
    monkeypatch.setattr("service.jobs.engine._POLLING", 0.05)
    monkeypatch.setattr("service.jobs.engine._RETRY", 0.1)
    monkeypatch.setattr("service.jobs.engine._RECONNECTION", 0.1)
    monkeypatch.setattr("service.jobs.execution._SHARING_PERIOD", 0.05)
    monkeypatch.setattr("service.jobs.execution._POLL_PERIOD", 0.05)


async def ends(jobs: AgentJobs, ids: Sequence[str]) -> list[tuple[JobRecord, JobAnswer | None]]:
    """Jobs once they have all ended, as the database has them."""
    ended = []
    for job_id in ids:
        while (await jobs.get(job_id))[0].ended is None:
            await asyncio.sleep(0.01)
        ended.append(await jobs.get(job_id))
    return ended


async def no_messages(url: str) -> None:
    """Wait until the queue is empty."""
    async with await psycopg.AsyncConnection.connect(
        url.replace("+psycopg", ""), autocommit=True
    ) as connection:
        while (
            await (await connection.execute("SELECT count(*) FROM procrastinate_jobs")).fetchone()
        ) != (0,):
            await asyncio.sleep(0.02)


def batch_of_seeds(count: int) -> StoredRequest:
    """A batch of problems that can be told apart by their seeds."""
    problem: dict[str, Any] = {"robot": "planar_rr", "start": {"joints": [0.0, 0.0]}}
    seeds = [{"seed": 100 + n, "goal": {"joints": [0.1, 0.2]}} for n in range(count)]
    body = json.dumps(problem | {"problems": seeds}).encode()
    return StoredRequest("POST", BATCH_PATH, "application/json", body)


def close(*machines: Machine) -> None:
    """Let no job of some agents end."""
    for machine in machines:
        machine.app.open.clear()


def contexts(*machines: Machine) -> list[JobContext]:
    return [context for machine in machines for context in machine.app.contexts]


def test_two_agents_do_each_job_once(postgresql: PostgreSQL, tmp_path: Path) -> None:
    url = postgresql.database()

    async def scenario(server: AgentJobs, one: Machine, other: Machine) -> None:
        assert server.is_connected
        accepted = [(await server.accept(REQUEST)).id for _ in range(30)]
        for record, answer in await ends(server, accepted):
            assert (record.status, record.attempt, record.progress) == ("succeeded", 1, 1.0)
            assert answer == JobAnswer("application/json", b'{"done": true}')
        assert sorted(context.id for context in contexts(one, other)) == sorted(accepted)
        assert one.app.contexts
        assert other.app.contexts
        await no_messages(url)
        assert len(server._live) == 0

    run(url, tmp_path, scenario)


def test_a_late_answer_of_a_frozen_agent_is_refused(postgresql: PostgreSQL, tmp_path: Path) -> None:
    url = postgresql.database()

    async def scenario(server: AgentJobs, one: Machine, other: Machine) -> None:
        close(one, other)
        job = (await server.accept(REQUEST)).id
        await until(lambda: bool(contexts(one, other)))
        slow, quick = (one, other) if one.app.contexts else (other, one)
        slow.app.body = b'{"late": true}'
        await asyncio.sleep(0.2)
        slow.freeze()
        quick.app.open.set()
        ((record, answer),) = await ends(server, [job])
        assert (record.status, record.attempt) == ("succeeded", 2)
        assert answer is not None
        assert answer.content == b'{"done": true}'
        slow.app.open.set()  # it wakes and answers
        await no_messages(url)
        assert (await server.get(job)) == (record, answer)

    run(url, tmp_path, scenario)


def test_an_agent_that_ends_gives_its_jobs_back(postgresql: PostgreSQL, tmp_path: Path) -> None:
    url = postgresql.database()

    async def scenario(server: AgentJobs, one: Machine, other: Machine) -> None:
        close(one, other)
        accepted = [(await server.accept(REQUEST)).id for _ in range(6)]
        await until(lambda: len(contexts(one, other)) == 4)
        await one.jobs.stop()
        other.app.open.set()
        for record, _ in await ends(server, accepted):
            assert (record.status, record.attempt) == ("succeeded", 1), "nobody died"
        await no_messages(url)

    run(url, tmp_path, scenario)


def test_a_job_is_cancelled_through_a_server(postgresql: PostgreSQL, tmp_path: Path) -> None:
    url = postgresql.database()

    async def scenario(server: AgentJobs, one: Machine, other: Machine) -> None:
        close(one, other)
        running = (await server.accept(REQUEST)).id
        await until(lambda: bool(contexts(one, other)))
        assert (await server.cancel(running)).status == "cancelled"
        await until(lambda: one.app.cancelled + other.app.cancelled == 1)
        assert (await server.cancel(running)).status == "cancelled"
        await no_messages(url)

    run(url, tmp_path, scenario)


def test_agents_connect_again_and_lose_nothing(postgresql: PostgreSQL, tmp_path: Path) -> None:
    url = postgresql.database()

    async def scenario(server: AgentJobs, one: Machine, other: Machine) -> None:
        accepted = [(await server.accept(REQUEST)).id for _ in range(10)]
        async with await psycopg.AsyncConnection.connect(
            url.replace("+psycopg", ""), autocommit=True
        ) as connection:
            await connection.execute(
                "SELECT pg_terminate_backend(pid) FROM pg_stat_activity"
                " WHERE datname = current_database() AND pid <> pg_backend_pid()"
            )
        accepted += [(await server.accept(REQUEST)).id for _ in range(10)]
        assert {record.status for record, _ in await ends(server, accepted)} == {"succeeded"}
        await no_messages(url)
        # One of them may have done all jobs while the other is connecting.
        await until(lambda: one.jobs.is_connected and other.jobs.is_connected)

    run(url, tmp_path, scenario)


def test_a_message_whose_end_was_lost_comes_again(postgresql: PostgreSQL, tmp_path: Path) -> None:
    url = postgresql.database()
    lost = []

    async def lose(**options: Any) -> None:
        lost.append(options)
        raise OSError("the connection is lost")

    async def scenario(server: AgentJobs, one: Machine, other: Machine) -> None:
        await other.jobs.stop()
        engine = one.jobs._engine
        assert engine is not None
        assert engine._worker is not None
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(engine._worker.app.job_manager, "finish_job", lose)
            job = (await server.accept(REQUEST)).id
            await until(lambda: len(lost) == 1)
        await no_messages(url)
        ((record, _),) = await ends(server, [job])
        assert (record.status, record.attempt) == ("succeeded", 1)
        assert [context.id for context in one.app.contexts] == [job], "it was done once"

    run(url, tmp_path, scenario)


def test_a_batch_is_cut_spread_and_joined_in_order(postgresql: PostgreSQL, tmp_path: Path) -> None:
    url = postgresql.database()

    async def scenario(server: AgentJobs, one: Machine, other: Machine) -> None:
        await until(lambda: one.jobs.is_connected and other.jobs.is_connected)
        job = (await server.accept(batch_of_seeds(20))).id
        ((record, answer),) = await ends(server, [job])
        assert record.status == "succeeded"
        assert answer is not None
        body = json.loads(answer.content)
        # Each result carries the index that its instance would have, and the seed of its problem.
        assert body["results"] == [[n, 100 + n] for n in range(20)]
        sizes = one.app.sizes + other.app.sizes
        assert sum(sizes) == 20
        assert max(sizes) <= 3, "of 1 s each, and 3 s is the most"
        assert (body["succeeded"], body["failed"]) == (20 - len(sizes), len(sizes))
        assert one.app.sizes
        assert other.app.sizes
        await no_messages(url)
        assert [r.id for r in await server.list(None, "", 10)] == [job], "chunks are not listed"

    run(url, tmp_path, scenario)


def test_a_batch_that_is_cancelled_takes_its_chunks_along(
    postgresql: PostgreSQL, tmp_path: Path
) -> None:
    url = postgresql.database()

    async def scenario(server: AgentJobs, one: Machine, other: Machine) -> None:
        close(one, other)
        job = (await server.accept(batch_of_seeds(20))).id
        await until(lambda: len(contexts(one, other)) == 4)
        contexts(one, other)[0].on_progress(0.5, "1 of 3 problems")
        while not (await server.get(job))[0].progress:
            await asyncio.sleep(0.02)
        assert 0.0 < (await server.get(job))[0].progress < 0.2
        assert (await server.cancel(job)).status == "cancelled"
        await until(lambda: one.app.cancelled + other.app.cancelled == 4)
        await no_messages(url)
        assert sum(one.app.sizes + other.app.sizes) < 20

    run(url, tmp_path, scenario)


def test_jobs_of_all_servers_count(postgresql: PostgreSQL, tmp_path: Path) -> None:
    async def scenario(server: AgentJobs, one: Machine, other: Machine) -> None:
        close(one, other)
        caller = Caller("default", "cell", job_limit=2)
        await server.accept(REQUEST, None, caller)
        await one.jobs.accept(REQUEST, None, caller)
        with pytest.raises(JobsFull):
            await other.jobs.accept(REQUEST, None, caller)
        await server.accept(REQUEST)
        with pytest.raises(JobsFull):
            await one.jobs.accept(REQUEST)

    run(postgresql.database(), tmp_path, scenario, job_limit=3)


def test_what_waits_is_counted(postgresql: PostgreSQL, tmp_path: Path) -> None:
    async def scenario(server: AgentJobs, one: Machine, other: Machine) -> None:
        close(one, other)
        for _ in range(7):
            await server.accept(REQUEST)
        await until(lambda: len(contexts(one, other)) == 4)
        assert await server.waiting_messages() == 3
        assert waiting_messages(one.store.database) == 3

    run(postgresql.database(), tmp_path, scenario)
