import base64
import json
from pathlib import Path

import numpy as np
import pytest

from tests.command_line.commands import Run
from tests.planning.witness.problems import checker, rejected
from tests.service.robots import ASIDE, POST

GOAL = ",".join(map(str, ASIDE))


@pytest.fixture
def scene(tmp_path: Path) -> str:
    path = tmp_path / "scene.json"
    path.write_text(json.dumps({"obstacles": [POST]}))
    return str(path)


@pytest.fixture
def plan(run: Run, scene: str, tmp_path: Path) -> Path:
    """A plan around the post, in a file."""
    path = tmp_path / "plan.json"
    words = ("--start", "home", "--goal", GOAL, "--scene", scene, "--timeout", "60")
    answer = run("plan", "panda", *words, "--output", str(path))
    assert answer.code == 0, answer.err
    assert "\nproved\n" in answer.out
    assert "certificate" in answer.out
    return path


def test_a_plan_is_proved_timed_followed_and_converted(run: Run, scene: str, plan: Path) -> None:
    motion = json.loads(plan.read_text())
    np.testing.assert_allclose(motion["path"]["joints"][-1], ASIDE, atol=1e-9)
    duration = motion["trajectory"]["duration"]

    proof = run("validate", "panda", str(plan), "--scene", scene, "--json")
    assert (proof.code, proof.json["verified"]) == (0, True)
    assert proof.json["min_clearance"] == pytest.approx(motion["certificate"]["min_clearance"])
    refused = run("validate", "panda", str(plan), "--scene", scene, "--margin", "0.1")
    assert refused.code == 1
    assert "not proved" in refused.out
    assert "post" in refused.out

    stoppable = run("validate", "panda", str(plan), "--scene", scene, "--stops", "both")
    assert stoppable.code == 0
    assert "Stops of both kinds are proved: at rest within" in stoppable.out
    file = plan.with_name("witness")
    told = run("witness", "panda", str(plan), "--scene", scene, "--output", str(file))
    assert told.code == 0
    assert "\nproved" in f"\n{told.out}"
    assert rejected(checker().read(file.read_bytes())) is None
    refused = run("witness", "panda", str(plan), "--scene", scene, "--margin", "0.1", "--json")
    assert refused.code == 1
    assert checker().read(base64.b64decode(refused.json["compact"]))["version"] == 2

    half = run("retime", "panda", str(plan), "--scaling", "0.5", "--json").json
    assert half["trajectory"]["duration"] > 1.5 * duration
    assert max(half["peaks"]["velocity"]) <= 0.5 * 2.61 + 1e-9
    assert "Stops along the path" in run("retime", "panda", str(plan), "--stops", "path").out
    assert "duration" in run("retime", "panda", str(plan)).out
    near = run("retime", "panda", str(plan), "--tolerance", "0.01", "--json").json
    assert (
        near["trajectory"]["duration"]
        < run("retime", "panda", str(plan), "--json").json["trajectory"]["duration"]
    )

    ends = ("plan", "panda", "--start", "home", "--goal", GOAL, "--scene", scene)
    near = run(*ends, "--path-tolerance", "0.01")
    assert near.code == 0, near.err
    assert "from the path of" in near.out

    tracked = run("simulate", "panda", str(plan), "--json").json
    assert tracked["outcome"] == "completed"
    assert tracked["max_tracking_error"] < 1e-3
    shown = run("simulate", "panda", str(plan)).out
    assert "completed" in shown
    assert "panda_joint1" in shown

    lines = run("convert", str(plan), "--format", "csv", "--sample-period", "0.1").out.splitlines()
    assert lines[0].startswith("time,position.panda_joint1")
    np.testing.assert_allclose(float(lines[-1].split(",")[0]), duration)
    message = run("convert", str(plan)).json
    np.testing.assert_allclose(message["points"][0]["positions"], motion["path"]["joints"][0])


def test_a_check_answers_by_its_exit_code(run: Run, tmp_path: Path) -> None:
    free = run("check", "panda", "-q", "home")
    assert free.code == 0
    assert free.out.startswith("valid\n")
    box = {"type": "box", "size": [0.2, 0.2, 0.2]}
    tip = run("fk", "panda", "-q", "home", "--json").json["pose"]
    scene = tmp_path / "box.json"
    scene.write_text(json.dumps({"obstacles": [{"id": "box", "shape": box, "pose": tip}]}))
    hit = run("check", "panda", "-q", "home", "--scene", str(scene))
    assert hit.code == 1
    assert hit.out.startswith("not valid\n")
    assert "box" in hit.out
    beyond = run("check", "panda", "-q", "3,-0.785,0,-2.356,0,1.571,0.785", "--json")
    assert beyond.code == 1
    assert beyond.json["limit_violations"][0]["joint"] == "panda_joint1"


def test_further_fields_come_from_a_file(run: Run, tmp_path: Path) -> None:
    fields = tmp_path / "fields.json"
    fields.write_text('{"depth": false}')
    answer = run("check", "panda", "-q", "home", "--fields", str(fields), "--json")
    assert answer.json["clearance"] is None
    fields.write_text('{"depht": false}')
    answer = run("check", "panda", "-q", "home", "--fields", str(fields))
    assert answer.code == 3
    assert "depht: unknown field" in answer.err


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (("plan", "panda", "--start", "home", "--goal", "away"), 3, "home"),
        (("plan", "panda", "--start", "home", "--goal", "0,0,0,0,0,0,0"), 4, "panda_joint4"),
        (("plan", "panda", "--start", "home", "--goal", "home", "--planner", "luck"), 3, "luck"),
        (("validate", "panda", "nowhere.json"), 3, "nowhere.json"),
        (("simulate", "panda", "nowhere.json"), 3, "nowhere.json"),
        (("convert", "nowhere.json"), 3, "nowhere.json: there is no such file"),
        (("check", "panda", "-q", "home", "--scene", "nowhere.yaml"), 3, "nowhere.yaml"),
    ],
)
def test_faults_are_told_by_class(run: Run, words: tuple[str, ...], code: int, said: str) -> None:
    answer = run(*words)
    assert answer.code == code, answer.err
    assert said in answer.err
    assert "Traceback" not in answer.err


def test_a_file_without_a_motion_is_told(run: Run, scene: str) -> None:
    answer = run("validate", "panda", scene)
    assert answer.code == 3
    assert f"{scene}: it holds no trajectory" in answer.err


def test_every_field_that_is_wrong_is_shown(run: Run, tmp_path: Path) -> None:
    request = tmp_path / "reach.json"
    request.write_text(json.dumps({"box": {"a": 1, "b": 2}}))
    answer = run("reach", "panda", str(request))
    assert answer.code == 3
    assert "box.a: unknown field\nbox.b: unknown field\n" in answer.err
    assert "details" not in answer.err


def test_a_deadline_has_its_exit_code(run: Run, scene: str) -> None:
    words = ("--start", "home", "--goal", GOAL, "--scene", scene, "--timeout", "0.001")
    answer = run("plan", "panda", *words, "--json")
    assert (answer.code, answer.json["code"]) == (5, "TIMED_OUT")


def test_a_plan_is_exported_for_its_own_scene_alone(
    run: Run, scene: str, plan: Path, tmp_path: Path
) -> None:
    """Without its scene, the file once said that it was proved free of collisions."""
    words = ("export", "panda", str(plan), "--format", "csv", "--sample-period", "0.2")
    assert run(*words, "--scene", scene).code == 0
    refused = run(*words)
    assert refused.code == 3
    assert "here are 0" in refused.err
    assert "--different-scene" in refused.err
    told = run(*words, "--different-scene")
    assert told.code == 0
    assert "against the robot itself only" in told.err
    assert "PROVED free of collisions by that rule, against the robot itself only" in told.out
    other = tmp_path / "other.json"
    changed = json.loads(Path(scene).read_text())
    changed["obstacles"][0]["margin"] = 0.001
    other.write_text(json.dumps(changed))
    assert run(*words, "--scene", str(other)).code == 3


def test_a_plan_says_what_its_stops_cost(run: Run, scene: str, tmp_path: Path) -> None:
    fields = tmp_path / "weak.json"
    fields.write_text(json.dumps({"limits": {"acceleration": [1.0] * 7}}))
    words = ("--start", "home", "--goal", GOAL, "--scene", scene, "--timeout", "60")
    answer = run("plan", "panda", *words, "--fields", str(fields), "--stops", "joints")
    assert answer.code == 0, answer.err
    assert "Stops of single joints are proved: at rest within" in answer.out
    refused = run("plan", "panda", *words, "--stops", "sometimes")
    assert refused.code == 3
    assert "stops" in refused.err
