"""The life of a real worker process, seen from the other end of its channel."""

import math
import multiprocessing
import pickle
import signal
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.context import SpawnProcess
from typing import Any

from planning.values.deadline import Deadline
from service.workers import main
from service.workers.main import HEADER, Reply
from service.workers.task import Job, pack_job
from tests.service import chores
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
        send(channel, chores.remaining.job().with_timeout(30.0))
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


def test_faults_bugs_and_unknown_tasks_cost_no_worker() -> None:
    with worker() as (process, channel):
        receive(channel)
        unknown: Job[Any] = Job("os:getpid")
        for job, kind, text in (
            (chores.blame_caller.job(), Reply.FAULT, "INVALID_LINK_NAME"),
            (chores.stumble.job(), Reply.BUG, "ZeroDivisionError"),
            (chores.unpicklable.job(), Reply.BUG, "pickle"),
            (unknown, Reply.BUG, "not a registered task"),
        ):
            send(channel, job)
            assert receive(channel) == (Reply.STARTED,)
            reply = receive(channel)
            assert reply[0] == kind
            assert text in str(reply[2])
        assert process.is_alive()


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
