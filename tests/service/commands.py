"""The command ``armwright serve`` in a process of its own."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx

from tests.service.forked_commands import start_command
from tests.service.processes import wait_until

ROOT = Path(__file__).parents[2]
COMMAND = [sys.executable, "-m", "service.cli"]


@contextmanager
def serve(
    data: Path,
    *,
    warm: bool = True,
    environment: Mapping[str, str] = {},
    under: Sequence[str] = (),
    loads: bool = False,
) -> Iterator[tuple[subprocess.Popen[str], httpx.Client]]:
    """Run the command; gives the process with a client, once it is ready.

    Args:
        data: Folder of its database.
        warm: Whether it is ready only when its workers are.
        environment: More variables.
        under: A command that runs it, with arguments; its fork server loads by itself then.
        loads: Whether it starts as people start it, and its fork server is its child that loads.
    """
    arguments = ["serve", "--port", "0", "--data-dir", str(data)]
    options: Any = {
        "env": os.environ | {"ARMWRIGHT_WORKERS": "2"} | dict(environment),
        "stdout": subprocess.PIPE,
        "stderr": subprocess.PIPE,
    }
    if loads or under:
        command = [*under, *COMMAND, *arguments]
        process = subprocess.Popen(command, cwd=ROOT, text=True, **options)
    else:
        process = start_command(arguments, **options)
    try:
        assert process.stdout is not None
        said = process.stdout.readline()
        address = re.fullmatch(r"Armwright serves on (http://127\.0\.0\.1:\d+)\n", said)
        assert address, said
        with httpx.Client(base_url=address[1], timeout=60.0) as client:
            assert not warm or wait_until(lambda: client.get("/readyz").status_code == 200, 90.0)
            yield process, client
    finally:
        process.kill()
        process.communicate()
