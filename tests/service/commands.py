"""The command ``armwright serve`` in a process of its own."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import httpx

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
) -> Iterator[tuple[subprocess.Popen[str], httpx.Client]]:
    """Run the command, if need be under another one, and give the process with a client, once it is
    ready."""
    process = subprocess.Popen(
        [*under, *COMMAND, "serve", "--port", "0", "--data-dir", str(data)],
        cwd=ROOT,
        env=os.environ | {"ARMWRIGHT_WORKERS": "2"} | dict(environment),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
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
