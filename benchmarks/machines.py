"""Servers, agents and PostgreSQL as processes of this machine."""

import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import httpx
import psycopg

from tests.service.postgresql import PostgreSQL
from tests.service.processes import alive, children, descendants

#: Longest time until a process that was started answers [s].
_START = 120.0
#: Time in which processes that are idle take less than this part of it [s].
_LOOK, _IDLE_SHARE = 1.0, 0.01
#: Statuses of jobs that nothing comes after.
ENDED = ("succeeded", "failed", "cancelled")


class Process:
    """A server or an agent as a process, which can be killed and started again.

    Args:
        command: ``serve`` or ``agent``.
        url: Of the database.
        folder: For what it prepares.
        environment: More settings.
    """

    def __init__(self, command: str, url: str, folder: Path, **environment: str) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port: int = free.getsockname()[1]
        self.url = f"http://127.0.0.1:{self.port}"
        self._command = [
            sys.executable, "-m", "service.cli", command, "--port", str(self.port),
            "--workers", "1", "--data-dir", str(folder), "--log-level", "error",
        ]  # fmt: skip
        given = {f"ARMWRIGHT_{name.upper()}": value for name, value in environment.items()}
        self._environment = os.environ | given | {"ARMWRIGHT_DATABASE_URL": url}
        self._log = (folder.parent / f"{folder.name}.log").open("ab")
        self.start()

    def start(self) -> None:
        """Start it, without waiting until it is ready."""
        self.process = subprocess.Popen(
            self._command, env=self._environment, stdout=self._log, stderr=self._log
        )

    def wait(self) -> None:
        """Wait until it is ready; it is started again if it ended, as service managers do."""
        end = time.monotonic() + _START
        while time.monotonic() < end:
            if self.process.poll() is not None:
                self.start()
            with suppress(httpx.HTTPError):
                if httpx.get(f"{self.url}/readyz", timeout=5.0).status_code == 200:
                    return
            time.sleep(0.2)
        raise RuntimeError(f"{self._command} is not ready")

    def kill(self) -> None:
        """Kill it with all its processes, as a machine that loses its power."""
        below = descendants(self.process.pid)
        self.process.kill()
        for pid in below:
            with suppress(OSError):
                os.kill(pid, signal.SIGKILL)
        self.process.wait()

    def freeze(self, number: signal.Signals) -> None:
        """Stop it with all its processes, or let them go on."""
        for pid in (self.process.pid, *descendants(self.process.pid)):
            with suppress(OSError):
                os.kill(pid, number)

    def kill_worker(self) -> bool:
        """Kill a worker that has work, if one can be seen."""
        forkers = children(self.process.pid)
        workers = [pid for pid in descendants(self.process.pid) - forkers if alive(pid)]
        busy = [pid for pid in workers if _state(pid) == "R"]
        for pid in busy:
            with suppress(OSError):
                os.kill(pid, signal.SIGKILL)
                return True
        return False

    def stop(self) -> int:
        """End it politely and give its exit code."""
        self.process.terminate()
        code = self.process.wait(60.0)
        self._log.close()
        return code


class ProcessorTimes(NamedTuple):
    """The processor time that a process and those below it have had, with all threads.

    Attributes:
        own: of the process itself [s].
        below: of all that it has started, and these in turn, whether they live or not [s].
    """

    own: float
    below: float

    def since(self, before: "ProcessorTimes") -> "ProcessorTimes":
        """What came since an earlier look."""
        return ProcessorTimes(self.own - before.own, self.below - before.below)


def processor_times(pid: int) -> ProcessorTimes:
    """The processor time that a process and those below it have had.

    Workers are replaced now and then: the time of those that have ended is told by the process that
    has waited for them, to a hundredth of a second.
    """
    own, below = _processor_time(pid), _time_of_ended(pid)
    for process in descendants(pid):
        with suppress(OSError):  # it has just ended
            below += _processor_time(process) + _time_of_ended(process)
    return ProcessorTimes(own, below)


def _processor_time(pid: int) -> float:
    # clock_getcpuclockid of glibc: the clock of a process has its number in it.
    return time.clock_gettime((~pid << 3) | 2)


def _time_of_ended(pid: int) -> float:
    """The processor time of the processes that one has waited for, and of theirs [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return sum(map(int, fields[13:15])) / os.sysconf("SC_CLK_TCK")


def wait_until_idle(pid: int) -> None:
    """Wait until the processes below a server do nothing: what first requests need is prepared.

    A fork server goes on preparing when workers are ready, and then replaces them.
    """
    end = time.monotonic() + _START
    while time.monotonic() < end:
        before = processor_times(pid)
        time.sleep(_LOOK)
        if processor_times(pid).since(before).below < _IDLE_SHARE * _LOOK:
            return


def _state(pid: int) -> str:
    with suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    return "X"


class Rows:
    """The rows of jobs, read past all servers.

    Args:
        url: Of the database.
    """

    def __init__(self, url: str) -> None:
        self._url = url.replace("postgresql+psycopg", "postgresql")
        self._connection: psycopg.Connection | None = None

    def ask(self, query: str) -> list[tuple[Any, ...]]:
        """The rows of a query, as soon as the database answers."""
        while True:
            try:
                # Kept: a new one for each look would cost PostgreSQL as much as what is measured.
                if self._connection is None:
                    self._connection = psycopg.connect(
                        self._url, connect_timeout=3, autocommit=True
                    )
                return self._connection.execute(query.encode()).fetchall()
            except psycopg.Error:
                self.close()
                time.sleep(0.5)

    def close(self) -> None:
        """Give the connection back; the next look makes another one."""
        connection, self._connection = self._connection, None
        if connection is not None:
            connection.close()

    def ended(self) -> int:
        """The number of jobs that have ended."""
        return int(self.ask(f"SELECT count(*) FROM jobs WHERE status IN {ENDED}")[0][0])

    def running(self) -> int:
        """The number of jobs that have not ended."""
        return int(self.ask(f"SELECT count(*) FROM jobs WHERE status NOT IN {ENDED}")[0][0])

    def messages(self) -> int:
        """The number of messages that the queue has left."""
        return int(self.ask("SELECT count(*) FROM procrastinate_jobs")[0][0])


@contextmanager
def processes(
    database: PostgreSQL, servers: int, agents: int, jobs: str = "agents"
) -> Iterator[tuple[str, list[Process], list[Process]]]:
    """Servers and agents on a new database; gives its URL and them once they are ready."""
    url = database.database()
    settings = {"job_limit": "100000", "job_count": "100000", "batch_limit": "100000"}
    with tempfile.TemporaryDirectory() as data, ExitStack() as stack:
        started: dict[str, list[Process]] = {"serve": [], "agent": []}
        for command, count in (("serve", servers), ("agent", agents)):
            for number in range(count):
                folder = Path(data) / f"{command}{number}"
                process = Process(command, url, folder, jobs=jobs, **settings)
                stack.callback(process.stop)
                started[command].append(process)
        for process in (*started["serve"], *started["agent"]):
            process.wait()
        yield url, started["serve"], started["agent"]


@contextmanager
def local_server(environment: Mapping[str, str]) -> Iterator[tuple[int, str]]:
    """A server with a folder of its own, reached from this machine only.

    Args:
        environment: Its settings.

    Yields:
        Its process and its URL, once it is ready.
    """
    with (
        tempfile.TemporaryDirectory() as folder,
        subprocess.Popen(
            [sys.executable, "-m", "service.cli", "serve", "--port", "0", "--data-dir", folder],
            env=os.environ | environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        ) as process,
    ):
        try:
            assert process.stdout is not None
            url = process.stdout.readline().split()[-1]
            while httpx.get(f"{url}/readyz").status_code != 200:
                time.sleep(0.2)
            yield process.pid, url
        finally:
            process.terminate()
