"""The command ``armwright view``: pages of answers in files."""

from pathlib import Path

import pytest

from tests.command_line.commands import Run
from tests.service.robots import ASIDE, HOME


def test_an_answer_of_plan_has_a_page(run: Run, tmp_path: Path) -> None:
    goal = ",".join(map(str, ASIDE))
    motion = tmp_path / "plan.json"
    words = ("--start", ",".join(map(str, HOME)), "--goal", goal, "--timeout", "60")
    assert run("plan", "panda", *words, "-o", str(motion)).code == 0
    made = run("view", str(motion), "--robot", "panda")
    assert made.code == 0, made.err
    page = (tmp_path / "plan.html").read_text()
    assert page.startswith("<!doctype html>")
    assert "POST /v1/validate" in page
    treeless = run("view", str(motion), "--robot", "panda", "--tree")
    assert treeless.code == 3
    assert "POST /v1/validate have no tree" in treeless.err
    refused = run("view", str(motion))
    assert refused.code == 3
    assert "--robot" in refused.err


@pytest.mark.parametrize("text", ["{}", '{"path": 1}'])
def test_a_file_without_a_motion_is_refused(run: Run, tmp_path: Path, text: str) -> None:
    file = tmp_path / "other.json"
    file.write_text(text)
    refused = run("view", str(file), "--robot", "panda")
    assert refused.code == 3
    assert "neither a plan nor a trajectory" in refused.err
    assert run("view", str(tmp_path / "none.json")).code == 3
