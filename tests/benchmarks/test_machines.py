"""What benchmarks read of processes."""

import os
import subprocess
import sys

from benchmarks.server.machines import processor_times, wait_until_idle
from tests.service.processes import wait_until

#: Starts a process that works for a while and ends, and then does nothing.
_PARENT = """
import subprocess, sys
subprocess.run([sys.executable, "-c", "import time\\nwhile time.process_time() < 0.3: pass"])
print("done", flush=True)
sys.stdin.read()
"""


def test_the_time_of_processes_that_have_ended_is_told() -> None:
    before = processor_times(os.getpid())
    with subprocess.Popen(
        [sys.executable, "-c", _PARENT], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        assert process.stdin is not None
        process.stdout.readline()
        parent = processor_times(process.pid)
        assert parent.below >= 0.28
        below = processor_times(os.getpid()).since(before).below
        assert below >= 0.28 + parent.own / 2
        wait_until_idle(process.pid)
        process.stdin.close()


def test_a_process_that_works_is_not_idle() -> None:
    with subprocess.Popen([sys.executable, "-c", "while True: pass"]) as process:
        try:
            first = processor_times(os.getpid())
            assert wait_until(
                lambda: processor_times(os.getpid()).since(first).below > 0.05, seconds=30.0
            )
        finally:
            process.kill()
