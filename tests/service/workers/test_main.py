"""Worker processes and the fork server that makes them, their tasks and their queue."""

import math
import multiprocessing
import os
import pickle
import random
import signal
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from multiprocessing.context import SpawnProcess
from typing import Any

import pytest

from planning.values.deadline import Deadline
from service.endpoints.plan.task import plan, validate
from service.http.errors import document, headers_of, status_of
from service.storage.caches.cache_key import Reference, builtin_reference
from service.validation import ProblemError
from service.workers import main
from service.workers.fork.launch import Launched, Recipe, launch
from service.workers.fork.server import Notice, Order
from service.workers.load import FairQueue
from service.workers.main import HEADER, Reply
from service.workers.process import Ticket
from service.workers.result import PlanOutcome
from service.workers.state import (
    DeadlineExceeded,
    JobsFull,
    QueueFull,
    ShuttingDown,
    WorkerCrashed,
)
from service.workers.task import (
    GRACE,
    NEVER,
    Job,
    pack_job,
    registered_task,
    task,
    unpack_job,
)
from tests.service import chores
from tests.service.processes import alive, wait_until
from tests.times import quickest


@contextmanager
def worker(
    target: Callable[[socket.socket], None] = chores.worker,
) -> Iterator[tuple[SpawnProcess, socket.socket]]:
    ours, theirs = socket.socketpair()
    ours.settimeout(60.0)
    process = multiprocessing.get_context("spawn").Process(target=target, args=(theirs,))
    process.start()
    theirs.close()
    try:
        yield process, ours
    finally:
        ours.close()
        process.join(10.0)
        process.kill()


def send(channel: socket.socket, job: Job[Any], *, wants_progress: bool = False) -> None:
    header = HEADER.pack(job.deadline.at, True, wants_progress, 0.0)
    channel.sendall(main.encode(header + pack_job(job)))


def receive(channel: socket.socket) -> tuple[Any, ...]:
    reply: tuple[Any, ...] = pickle.loads(main.receive(channel))
    return reply


def test_jobs_are_answered_until_the_channel_closes() -> None:
    with worker() as (process, channel):
        assert receive(channel) == (Reply.READY,)
        for _ in range(2):
            send(channel, chores.add.job(2, b=3))
            assert receive(channel) == (Reply.STARTED,)
            kind, seconds, result = receive(channel)
            assert (kind, result) == (Reply.RESULT, 5)
            assert 0.0 < seconds < 5.0
        send(channel, chores.remaining.job().with_deadline(Deadline.after(30.0)))
        assert receive(channel) == (Reply.STARTED,)
        kind, _, left = receive(channel)
        assert kind == Reply.RESULT
        assert 25.0 < left <= 30.0
        send(channel, chores.remaining.job())
        receive(channel)
        assert receive(channel)[2] == math.inf, "a deadline ends with its job"
        channel.close()
        process.join(10.0)
        assert process.exitcode == 0


def test_a_worker_tells_how_long_it_had_a_job() -> None:
    with worker() as (_, channel):
        receive(channel)

        def attempt() -> float:
            send(channel, chores.nap.job(0.2))
            time.sleep(0.5)  # whoever reads late learns the same
            receive(channel)
            seconds: float = receive(channel)[1]
            return seconds

        assert 0.2 <= quickest(attempt, 0.45) < 0.45


def test_progress_is_sent_only_where_it_is_wanted() -> None:
    with worker() as (_, channel):
        receive(channel)
        for wanted, expected in ((True, 4), (False, 0)):
            send(channel, chores.advance.job(), wants_progress=wanted)
            assert receive(channel) == (Reply.STARTED,)
            replies = [receive(channel)]
            while replies[-1][0] == Reply.PROGRESS:
                replies.append(receive(channel))
            assert len(replies) == expected + 1
            assert replies[-1][2] == "done"
            assert all(stage == f"step_{i}" for i, (_, _, stage) in enumerate(replies[:-1]))


def test_a_worker_ends_itself_when_the_server_does_not() -> None:
    with worker(chores.impatient_worker) as (process, channel):
        receive(channel)
        job = chores.burn.job()
        header = HEADER.pack(Deadline.after(0.1).at, True, False, 0.0)
        channel.sendall(main.encode(header + pack_job(job)))
        assert receive(channel) == (Reply.STARTED,)
        process.join(5.0)
        assert process.exitcode == -signal.SIGALRM


def test_any_cut_of_the_stream_gives_the_same_payloads() -> None:
    random_source = random.Random(1)
    payloads = [random_source.randbytes(random_source.choice((0, 1, 7, 300))) for _ in range(200)]
    stream = b"".join(main.encode(payload) for payload in payloads)
    decoder = main.FrameDecoder()
    received: list[bytes] = []
    position = 0
    while position < len(stream):
        step = random_source.choice((1, 3, 8, 500))
        received += decoder.feed(stream[position : position + step])
        position += step
    assert received == payloads


def test_garbage_is_refused() -> None:
    with pytest.raises(ValueError, match="a frame of"):
        list(main.FrameDecoder().feed(b"\xff" * 8))


MODULE = "tests.service.chores"


@contextmanager
def launched(warm: str = "no_warming", modules: tuple[str, ...] = (MODULE,)) -> Iterator[Launched]:
    server = launch(Recipe(modules, f"{MODULE}:{warm}"))
    server.control.settimeout(60.0)
    try:
        yield server
    finally:
        server.end()


def fork(server: Launched) -> tuple[int, socket.socket]:
    ours, theirs = socket.socketpair()
    ours.settimeout(60.0)
    with theirs:
        socket.send_fds(server.control, [Order.FORK.value], [theirs.fileno()])
    kind, pid = receive(server.control)
    assert kind == Notice.FORKED
    assert receive(ours) == (Reply.READY,)
    return pid, ours


def test_workers_are_forked_and_their_ends_are_told() -> None:
    with launched() as server:
        assert receive(server.control) == (Notice.WARM,)
        first, one = fork(server)
        second, other = fork(server)
        assert first != second
        with one, other:
            send(other, chores.add.job(1, 2))
            assert receive(other) == (Reply.STARTED,)
            assert receive(other)[2] == 3
            os.kill(first, signal.SIGSEGV)
            assert receive(server.control) == (Notice.EXITED, first, -signal.SIGSEGV)
        assert receive(server.control) == (Notice.EXITED, second, 0), "its channel was closed"


def test_workers_leave_processors_to_the_server() -> None:
    with launched() as server:
        receive(server.control)
        worker, channel = fork(server)
        with channel:
            own = os.getpriority(os.PRIO_PROCESS, server.process.pid)
            assert os.getpriority(os.PRIO_PROCESS, worker) == min(own + 5, 19)


def test_a_signal_to_the_whole_group_ends_neither_fork_server_nor_workers() -> None:
    with launched() as server:
        receive(server.control)
        worker, channel = fork(server)
        with channel:
            for pid in (server.process.pid, worker):
                os.kill(pid, signal.SIGINT)
                os.kill(pid, signal.SIGTERM)
            time.sleep(0.1)
            assert alive(server.process.pid)
            assert alive(worker)


def test_all_end_at_once_with_the_sentinel() -> None:
    with launched() as server:
        receive(server.control)
        worker, channel = fork(server)
        with channel:
            send(channel, chores.burn.job())
            assert receive(channel) == (Reply.STARTED,)
            other = os.dup(server.sentinel.fileno())
            server.sentinel.close()
            time.sleep(0.1)
            assert alive(worker), "somebody else still holds it"
            os.close(other)
            assert wait_until(lambda: not alive(worker), 20.0), "though native code runs"
            assert wait_until(lambda: server.process.poll() is not None, 20.0)


def test_a_fork_server_that_cannot_warm_up_says_why_and_ends() -> None:
    for warm, modules, reason in (
        ("failing_warming", (MODULE,), "no compiler"),
        ("no_warming", ("tests.service.nowhere",), "ModuleNotFoundError"),
    ):
        with launched(warm, modules) as server:
            kind, trace = receive(server.control)
            assert kind == Notice.UNFIT
            assert reason in trace
            assert server.process.wait(10.0) == 0


def test_a_task_is_its_function_and_makes_jobs() -> None:
    assert chores.add(1, b=2) == 3
    job = chores.add.job(1, b=2)
    assert (job.task, job.args, job.kwargs) == ("tests.service.chores:add", (1,), {"b": 2})
    assert job.deadline.remaining == float("inf")
    assert pickle.loads(pickle.dumps(job)) == job
    assert unpack_job(pack_job(job)) == job


def test_what_jobs_carry_arrives_as_it_was_sent() -> None:
    reference = Reference("scene", "table", "0a1b", "/data/prepared")
    built_in = builtin_reference("panda", "/data/prepared")
    outcome = PlanOutcome(b"{}", "straight_line", (("preflight", 0.1),))
    for value in (reference, built_in, outcome):
        assert pickle.loads(pickle.dumps(value)) == value
    job = plan.job(built_in, reference, b"{}").with_deadline(Deadline.after(3.0))
    sent = unpack_job(pack_job(job))
    assert (sent.task, sent.args) == (job.task, job.args)


def test_a_deadline_is_a_field_of_the_job() -> None:
    before = time.monotonic()
    job = chores.add.job(1, 2).with_deadline(Deadline.after(3.0))
    assert before + 3.0 <= job.deadline.at <= time.monotonic() + 3.0
    assert job.args == (1, 2)


def test_another_deadline_leaves_all_other_fields_alone() -> None:
    @dataclass(frozen=True, slots=True)
    class Longer(Job[object]):
        origin: str = "unknown"

    before = Longer("a:b", (1,), {"c": 2}, NEVER, 0.5, "an address")
    after = before.with_deadline(Deadline(7.0))
    assert after == replace(before, deadline=Deadline(7.0))
    assert (after.deadline.at, after.grace) == (7.0, 0.5)


def test_tasks_that_mind_their_deadline_have_a_grace() -> None:
    assert plan.grace == validate.grace == GRACE
    assert plan.job(None, None, b"").grace == GRACE  # type: ignore[arg-type]
    assert chores.add.grace == 0.0


def test_two_tasks_of_one_name_are_refused() -> None:
    with pytest.raises(ValueError, match="already is a task"):
        task(chores.add.function)
    assert registered_task("tests.service.chores:add") is chores.add


def ticket(client: str, name: str = "t") -> Ticket:
    job: Job[None] = Job(name)
    nobody: Any = None
    return Ticket(job, job.deadline, b"", nobody, None, client=client)


def order(queue: FairQueue) -> list[str]:
    return [queue.popleft().job.task for _ in range(queue.count)]


def filled(*names: str) -> FairQueue:
    queue = FairQueue()
    for name in names:
        queue.append(ticket(name[0], name))
    return queue


def test_clients_take_turns_each_in_its_own_order() -> None:
    assert order(filled("a1", "a2", "a3", "b1", "c1", "c2")) == ["a1", "b1", "c1", "a2", "c2", "a3"]
    assert order(filled("a1", "a2")) == ["a1", "a2"]
    assert order(filled()) == []


def test_what_is_put_back_comes_first() -> None:
    queue = filled("a1", "b1", "b2")
    first = queue.popleft()
    queue.appendleft(first)
    assert order(queue) == ["a1", "b1", "b2"]
    queue = filled("a1", "b1")
    queue.appendleft(ticket("c", "c1"))
    assert order(queue) == ["c1", "a1", "b1"]


def test_what_is_taken_out_is_gone() -> None:
    queue = filled("a1", "b1")
    gone = next(iter(queue))
    assert gone in queue
    queue.remove(gone)
    assert gone not in queue
    assert order(queue) == ["b1"]
    with pytest.raises(KeyError):
        queue.remove(gone)
    with pytest.raises(KeyError):
        queue.popleft()


def test_what_is_ahead_of_a_new_ticket_is_what_comes_before_it() -> None:
    source = random.Random(7)
    for _ in range(200):
        names = [f"{source.choice('abc')}{i}" for i in range(source.randrange(12))]
        queue, client = filled(*names), source.choice("abcd")
        for _ in range(source.randrange(queue.count + 1)):
            queue.popleft()
        ahead = {t.job.task for t in queue.ahead(client)}
        queue.append(ticket(client, "new"))
        names = order(queue)
        before = set(names[: names.index("new")])
        assert before <= ahead, "never told too little"
        assert len(ahead - before) <= 3, "of each other client one at most"


@pytest.mark.parametrize(
    ("exit_code", "cause"),
    [(-signal.SIGSEGV, "SIGSEGV"), (-signal.SIGKILL, "SIGKILL"), (1, "it ended"),
     (None, "it ended"), (-999, "it ended")],
)  # fmt: skip
def test_a_crash_names_the_signal(exit_code: int | None, cause: str) -> None:
    problem = WorkerCrashed("service.endpoints.plan.task:plan", exit_code)
    assert problem.detail.endswith(cause) or cause in problem.detail
    assert status_of(problem) == 500
    assert problem.details == {"task": "service.endpoints.plan.task:plan"}


@pytest.mark.parametrize(
    ("problem", "code", "status", "retry_after"),
    [
        (DeadlineExceeded("t", "waiting for a worker"), "TIMED_OUT", 504, None),
        (DeadlineExceeded("t", "being computed", ["it ended"]), "TIMED_OUT", 504, None),
        (QueueFull(3, 7), "OVERLOADED", 429, "7"),
        (ShuttingDown(), "OVERLOADED", 503, "1"),
        (JobsFull(100, 4), "OVERLOADED", 429, "25"),
        (JobsFull(1, 4), "OVERLOADED", 429, "1"),
        (JobsFull(10_000, 1), "OVERLOADED", 429, "60"),
    ],
)
def test_codes_statuses_and_when_to_ask_again(
    problem: ProblemError, code: str, status: int, retry_after: str | None
) -> None:
    told = document(problem, "/v1/plan")
    assert (told["code"], told["status"]) == (code, status)
    assert headers_of(problem).get("Retry-After") == retry_after
    assert told["hint"]
