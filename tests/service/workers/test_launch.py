"""A fork server from outside: what it is told, what it says, and that it ends."""

import math
import os
import pickle
import signal
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from service.workers import main
from service.workers.fork.launch import Launched, Recipe, launch
from service.workers.fork.server import Notice, Order
from service.workers.main import HEADER, Reply
from service.workers.task import Job, pack_job
from tests.service import chores
from tests.service.processes import alive, wait_until

MODULE = "tests.service.chores"


@contextmanager
def launched(warm: str = "no_warming", modules: tuple[str, ...] = (MODULE,)) -> Iterator[Launched]:
    server = launch(Recipe(modules, f"{MODULE}:{warm}"))
    server.control.settimeout(60.0)
    try:
        yield server
    finally:
        server.end()


def receive(channel: socket.socket) -> tuple[Any, ...]:
    message: tuple[Any, ...] = pickle.loads(main.receive(channel))
    return message


def send(channel: socket.socket, job: Job[Any]) -> None:
    channel.sendall(main.encode(HEADER.pack(math.inf, True, False, 0.0) + pack_job(job)))


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


def test_progress_is_told_before_a_fork_server_is_warm() -> None:
    with launched("slow_warming") as server:
        assert receive(server.control) == (Notice.PROGRESS, 0, 2, None)
        assert receive(server.control) == (Notice.PROGRESS, 1, 2, 30.4)


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
