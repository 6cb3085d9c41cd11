"""The command ``armwright task``."""

import json
from pathlib import Path
from typing import Any

from armwright_wire.plans.task import TaskRequest
from tests.command_line.commands import Run

_EXAMPLE: Any = TaskRequest.model_json_schema()["examples"][0]
HOME = "0,-0.785,0,-2.356,0,1.571,0.785"


def _file(folder: Path, **changes: Any) -> str:
    path = folder / "task.json"
    body = {name: value for name, value in _EXAMPLE.items() if name not in ("robot", "start")}
    path.write_text(json.dumps(body | {"improve": 0.0, "timeout": 30.0} | changes))
    return str(path)


def test_stages_are_listed_with_choices_and_what_is_held(run: Run, tmp_path: Path) -> None:
    output = tmp_path / "answer.json"
    stages = [{"kind": "open", "name": "wide"}, *_EXAMPLE["stages"][:6]]
    ran = run("task", "panda", _file(tmp_path, stages=stages), "--start", HOME, "-o", str(output))
    assert ran.code == 0, ran.err
    assert "7 stages in" in ran.out
    assert "every one proved" in ran.out
    assert "open wide" in ran.out
    answer = json.loads(output.read_text())
    (grasp,) = (stage for stage in answer["stages"] if stage["kind"] == "grasp")
    line = next(line for line in ran.out.splitlines() if "grasp" in line)
    assert f" {grasp['choice']} " in line
    assert "crate" not in line
    assert "crate" in next(line for line in ran.out.splitlines() if "lift" in line)


def test_the_answer_of_the_service_is_printed_as_json(run: Run, tmp_path: Path) -> None:
    wait = _file(tmp_path, stages=[{"kind": "wait", "duration": 0.25}])
    answer = run("task", "panda", wait, "--start", HOME, "--json")
    assert answer.code == 0, answer.err
    assert answer.json["status"] == "success"
    assert answer.json["duration"] == 0.25


def test_what_could_not_be_done_is_told(run: Run, tmp_path: Path) -> None:
    stages = [{"kind": "wait", "duration": 0.1}, {"kind": "lift", "distance": [2.0, 3.0]}]
    partial = run(
        "task", "panda", _file(tmp_path, stages=stages, allow_partial=True), "--start", HOME
    )
    assert partial.code == 0, partial.err
    assert "1 stage in" in partial.out
    assert "stage 1 and what follows it" in partial.out
    refused = run("task", "panda", _file(tmp_path, stages=stages), "--start", HOME)
    assert refused.code != 0
    assert "lift" in refused.err
