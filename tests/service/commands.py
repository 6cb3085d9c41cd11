"""Commands of the service in processes of their own."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx

from tests.service.processes import wait_until
from tests.service.server import CONNECTIONS

ROOT = Path(__file__).parents[2]
COMMAND = [sys.executable, "-m", "service.cli"]


def start_command(arguments: Sequence[str], **options: Any) -> "subprocess.Popen[str]":
    """Start a command of the service.

    Args:
        arguments: Of the command.
        options: Of `subprocess.Popen`: where output and errors go, and the variables.
    """
    return subprocess.Popen([*COMMAND, *arguments], cwd=ROOT, text=True, **options)


@contextmanager
def serve(
    data: Path,
    *,
    warm: bool = True,
    longest: float = 90.0,
    environment: Mapping[str, str] = {},
    under: Sequence[str] = (),
) -> Iterator[tuple[subprocess.Popen[str], httpx.Client]]:
    """Run the command; gives the process with a client, once it is ready.

    Args:
        data: Folder of its database.
        warm: Whether it is ready only when its workers are.
        longest: Longest wait for that [s].
        environment: More variables.
        under: A command that runs it, with arguments.
    """
    arguments = ["serve", "--port", "0", "--data-dir", str(data)]
    process = subprocess.Popen(
        [*under, *COMMAND, *arguments], cwd=ROOT, text=True,
        env=os.environ | {"ARMWRIGHT_WORKERS": "2"} | dict(environment),
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        said = process.stdout.readline()
        address = re.fullmatch(r"Armwright serves on (http://127\.0\.0\.1:\d+)\n", said)
        assert address, said
        with httpx.Client(base_url=address[1], timeout=60.0, limits=CONNECTIONS) as client:
            assert not warm or wait_until(lambda: client.get("/readyz").status_code == 200, longest)
            yield process, client
    finally:
        process.kill()
        process.communicate()
