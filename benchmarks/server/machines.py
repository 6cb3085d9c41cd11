"""A server as a process of this machine, and the processor time of its processes."""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

import httpx

from tests.service.processes import descendants

#: Longest time until a process that was started answers [s].
_START = 120.0
#: Time in which processes that are idle take less than this part of it [s].
_LOOK, _IDLE_SHARE = 1.0, 0.01


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
