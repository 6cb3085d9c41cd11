"""The command ``armwright studio``: it serves a page with a service of its own, and ends both."""

import re
import signal
import subprocess
import sys
from pathlib import Path

import httpx
import pytest

import command_line.commands.studio
from tests.command_line.commands import Run
from tests.service.processes import alive, descendants, wait_until

_COMMAND = [sys.executable, "-m", "command_line.main", "studio", "--no-open", "--port", "0"]


def test_the_page_is_served_until_the_command_is_ended(tmp_path: Path) -> None:
    command = [*_COMMAND, "--robot", "planar_rr", "--data-dir", str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        lines = iter(process.stdout.readline, "")
        address = next(m[1] for m in (re.search(r"studio: (\S+)", line) for line in lines) if m)
        assert address.startswith("http://127.0.0.1:")
        assert "<html" in httpx.get(address).text
        started = descendants(process.pid)
        assert started
        process.send_signal(signal.SIGTERM)
        assert process.wait(20.0) == 0
    assert wait_until(lambda: not any(alive(pid) for pid in started), 20.0)


def test_missing_packages_are_named_with_the_extra(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(command_line.commands.studio._NEEDED, "studio", ("no_such_package",))
    refused = run("studio", "--no-open")
    assert refused.code == 3
    assert "no_such_package" in refused.err
    assert "[studio]" in refused.err


def test_a_service_that_does_not_answer_is_told(run: Run) -> None:
    refused = run("studio", "--no-open", "--url", "http://127.0.0.1:9")
    assert refused.code != 0
    assert "http://127.0.0.1:9" in refused.err
