"""The example of the README does what the README says."""

import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from armwright_client import Client, NotReady, TransportError
from tests.service.forked_commands import start_command

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


@pytest.fixture
def address() -> Iterator[str]:
    with tempfile.TemporaryDirectory() as folder:
        running = start_command(
            ["serve", "--port", "0", "--workers", "1", "--data-dir", folder],
            stdout=subprocess.PIPE,
            # A busy machine may take longer over the first plan of a worker than users wait.
            env=os.environ | {"ARMWRIGHT_DEFAULT_TIMEOUT": "60"},
        )
        assert running.stdout is not None
        try:
            line = next(line for line in running.stdout if "http://" in line)
            yield "http://" + line.split("http://")[1].strip()
        finally:
            running.terminate()
            running.wait(20.0)
            running.stdout.close()


def test_example_prints_what_the_readme_says(address: str) -> None:
    example = re.search(r"```python\n(.*?)```", README, re.DOTALL)
    printed = re.search(r"prints\n\n```\n(.*?)```", README, re.DOTALL)
    assert example is not None
    assert printed is not None
    with Client(address) as client:
        for _ in range(600):
            try:
                client.readyz()
                break
            except (NotReady, TransportError):
                time.sleep(0.2)
    code = example[1].replace("http://127.0.0.1:8000", address)
    answer = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=90.0
    )
    assert (answer.stdout, answer.stderr) == (printed[1], "")
