"""The commands ``armwright task``, ``tour`` and ``reach``, whose requests are files."""

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


TENDING = Path(__file__).parents[2] / "examples" / "machine_tending.yaml"


def test_the_work_of_the_example_becomes_a_page_and_a_program(run: Run, tmp_path: Path) -> None:
    whole, program = tmp_path / "done.json", tmp_path / "tending.src"
    told = run("task", "ur5e", str(TENDING), "--whole", str(whole))
    assert told.code == 0, told.err
    assert "50 stages in" in told.out
    page = run("view", str(whole), "--robot", "ur5e", "-o", str(tmp_path / "page.html"))
    assert page.code == 0, page.err
    fields = tmp_path / "ports.json"
    fields.write_text(json.dumps({"ports": {"speed": 2}, "blend": 0.03}))
    written = run("export", "ur5e", str(whole), "--format", "krl", "--fields", str(fields),
                  "-o", str(program))  # fmt: skip
    assert written.code == 0, written.err
    text = program.read_text()
    assert text.count("gripper_to(") == 6
    assert "$ANOUT[2] = 0.8" in text
    assert "C_PTP" in text
    refused = run("export", "ur5e", str(whole), "--format", "krl")
    assert refused.code != 0
    assert "'speed' has no number" in refused.err


START = "0,-1.44,2.5,0,-1.07,0"


def goals(*turns: float) -> list[dict[str, object]]:
    return [{"id": f"g{turn}", "joints": [turn, -1.44, 2.5, 0.0, -1.07, 0.0]} for turn in turns]


def test_goals_are_listed_in_their_best_order(run: Run, tmp_path: Path) -> None:
    request = tmp_path / "tour.json"
    request.write_text(json.dumps({"goals": goals(0.9, 0.3, 0.6), "rounds": 0}))
    answer = run("tour", "kr6_sixx", str(request), "--start", START, "--json")
    assert answer.code == 0, answer.err
    assert answer.json["order"] == ["g0.3", "g0.6", "g0.9"]
    output = tmp_path / "answer.json"
    text = run("tour", "kr6_sixx", str(request), "--start", START, "--end", "start",
               "--output", str(output)).out  # fmt: skip
    assert "3 goals in" in text
    assert "no tour takes less than" in text
    assert len(json.loads(output.read_text())["legs"]) == 4


def test_goals_left_out_are_listed(run: Run, tmp_path: Path) -> None:
    request = tmp_path / "tour.json"
    document = {"goals": goals(0.3, 0.6, 9.0), "rounds": 0, "allow_partial": True}
    request.write_text(json.dumps(document))
    text = run("tour", "kr6_sixx", str(request), "--start", START).out
    assert "Left out" in text
    assert "g9.0" in text


DOWN = [1, 0, 0, 0]


def test_poses_within_and_beyond_an_arm_are_told_apart(run: Run, tmp_path: Path) -> None:
    request = tmp_path / "poses.json"
    poses = [{"position": [x, 0.2, 0.3], "quaternion_xyzw": DOWN} for x in (0.5, 1.4)]
    request.write_text(json.dumps({"poses": poses}))
    answer = run("reach", "ur5e", str(request), "--json")
    assert answer.code == 0
    names = [answer.json["statuses"][status] for status in answer.json["status"]]
    assert names == ["reached", "out_of_reach"]
    assert "1 of 2 poses are reached" in run("reach", "ur5e", str(request)).out


def test_a_box_is_counted_and_drawn(run: Run, tmp_path: Path) -> None:
    request = tmp_path / "box.json"
    box = {"size": [1.0, 0.0, 0.0], "pose": {"position": [1.0, 0.1, 0.3]}, "spacing": 0.25}
    document = {"box": box | {"orientations": [DOWN]}}
    request.write_text(json.dumps(document))
    text = run("reach", "ur5e", str(request)).out
    assert "of 5 poses are reached" in text
    assert "out_of_reach" in text
    request.write_text(json.dumps(document | {"format": "svg"}))
    assert run("reach", "ur5e", str(request)).out.startswith("<svg")
    request.write_text(json.dumps(document | {"format": "glb"}))
    mesh = tmp_path / "reached.glb"
    assert "reached.glb" in run("reach", "ur5e", str(request), "-o", str(mesh)).out
    assert mesh.read_bytes().startswith(b"glTF")
