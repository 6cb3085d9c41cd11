"""Progress of long commands: the stage that runs is shown on a terminal, and nowhere else."""

import json
import re
from pathlib import Path

import pytest

from tests.command_line.commands import Run
from tests.service.robots import ASIDE, POST


def test_a_terminal_shows_the_stage_that_runs(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = tmp_path / "scene.json"
    scene.write_text(json.dumps({"obstacles": [POST]}))
    words = ("plan", "panda", "--start", "home", "--goal", ",".join(map(str, ASIDE)),
             "--scene", str(scene), "--json")  # fmt: skip
    silent = run(*words, "--timeout", "60")
    assert silent.code == 0, silent.err
    assert silent.err == ""
    for name, value in (("TTY_COMPATIBLE", "1"), ("TTY_INTERACTIVE", "1"), ("TERM", "xterm")):
        monkeypatch.setenv(name, value)
    # RRT* looks for shorter paths until its time is up: long enough for the line to be drawn.
    shown = run(*words, "--planner", "rrt_star", "--timeout", "1.5")
    assert shown.code == 0, shown.err
    assert shown.json["planner"] == "rrt_star"
    drawn = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", shown.err)
    assert drawn.count("rrt_star") > 2  # once for each turn of the spinner
    # The line is gone at the end: erased, and the cursor is back.
    assert shown.err.rstrip().endswith(("\x1b[2K", "\x1b[?25h"))
