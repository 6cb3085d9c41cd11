import json
import math
from pathlib import Path

import numpy as np
import pytest

from tests.command_line.commands import Run

HOME = (0.0, -math.pi / 4, 0.0, -3 * math.pi / 4, 0.0, math.pi / 2, math.pi / 4)


def test_the_tip_of_a_planar_arm_is_where_the_closed_form_has_it(run: Run) -> None:
    """Both links of planar_rr are 1 m long."""
    q1, q2 = -0.3, 0.7
    position = run("fk", "planar_rr", "-q", f"{q1},{q2}", "--json").json["pose"]["position"]
    x = math.cos(q1) + math.cos(q1 + q2)
    height = math.sin(q1) + math.sin(q1 + q2)
    np.testing.assert_allclose(position[0], x, atol=1e-12)
    np.testing.assert_allclose(np.hypot(*position[1:]), abs(height), atol=1e-12)
    assert f"{x:.4f}, " in run("fk", "planar_rr", f"--joints={q1},{q2}").out


def test_a_named_state_stands_for_joints(run: Run) -> None:
    named = run("fk", "panda", "-q", "home", "--json").json
    numbers = run("fk", "panda", "-q", ",".join(map(repr, HOME)), "--json").json
    np.testing.assert_allclose(named["pose"]["position"], numbers["pose"]["position"], atol=1e-3)
    one = run("fk", "panda", "-q", "home", "--link", "panda_link4").out
    assert "panda_link4" in one
    assert "panda_link5" not in one


def test_ik_reaches_the_pose_that_fk_tells(run: Run, tmp_path: Path) -> None:
    pose = run("fk", "ur5e", "-q", "0.3,-1.2,1.4,-0.5,0.8,0.1", "--json").json["pose"]
    file = tmp_path / "pose.json"
    file.write_text(json.dumps(pose))
    numbers = ",".join(map(repr, pose["position"] + pose["quaternion_xyzw"]))
    for text in (json.dumps(pose), str(file), numbers):
        solutions = run("ik", "ur5e", "--pose", text, "--json").json["solutions"]
        joints = ",".join(map(repr, solutions[0]["joints"]))
        reached = run("fk", "ur5e", "-q", joints, "--json").json["pose"]
        np.testing.assert_allclose(reached["position"], pose["position"], atol=1e-6)
    assert len(solutions) > 1, "an arm of this kind has several branches"
    assert "Solutions, best first" in run("ik", "ur5e", "--pose", numbers).out


def test_seed_and_scene_change_the_answer(run: Run, tmp_path: Path) -> None:
    pose = "0.5,0,0.4,3.14159,0,0"
    seeded = run("ik", "panda", "--pose", pose, "--seed-joints", "home", "--json")
    assert seeded.code == 0
    scene = tmp_path / "scene.json"
    wall = {
        "id": "wall",
        "shape": {"type": "box", "size": [2, 2, 2]},
        "pose": {"position": [1, 0, 0]},
    }
    scene.write_text(json.dumps({"obstacles": [wall]}))
    answer = run("ik", "panda", "--pose", pose, "--scene", str(scene), "--json")
    assert (answer.code, answer.json["code"]) == (4, "NO_IK_SOLUTION")


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (("fk", "panda", "-q", "0,0"), 3, "7 joints"),
        (("fk", "panda", "-q", "ready"), 3, "home"),
        (("fk", "panda", "-q", "[0, 1"), 3, "not JSON"),
        (("fk", "panda", "-q", "home", "--link", "hand"), 3, "link"),
        (("ik", "panda", "--pose", "1,2"), 3, "pose"),
        (("ik", "panda", "--pose", "5,0,0,0,0,0"), 4, "reach"),
        (("ik", "panda", "--pose", "none.json"), 3, "none.json"),
        (("ik", "panda", "--pose", "0.5,0,0.4", "--scene", "table"), 3, "--url"),
    ],
)
def test_faults_are_told_without_a_traceback(
    run: Run, words: tuple[str, ...], code: int, said: str
) -> None:
    answer = run(*words)
    assert answer.code == code
    assert said in answer.err
    assert "Traceback" not in answer.err
    assert answer.out == ""


def test_a_tool_leads_its_tip(run: Run, tmp_path: Path) -> None:
    bare = run("fk", "ur5e", "-q", "0,0,0,0,0,0", "--json").json["pose"]
    spindle = ("--tool", "spindle", "--tcp", "tip")
    told = run("fk", "ur5e", "-q", "0,0,0,0,0,0", *spindle, "--json").json
    apart = np.subtract(told["pose"]["position"], bare["position"])
    np.testing.assert_allclose(np.linalg.norm(apart), 0.23, atol=1e-12)
    file = tmp_path / "long_bit.json"
    file.write_text(json.dumps({"form": {"type": "spindle", "bit_length": 0.1}}))
    longer = run("fk", "ur5e", "-q", "0,0,0,0,0,0", "--tool", str(file), "--json").json
    apart = np.subtract(longer["pose"]["position"], bare["position"])
    np.testing.assert_allclose(np.linalg.norm(apart), 0.28, atol=1e-12)
    assert "long_bit/tip" in longer["links"]
    pose = ",".join(map(repr, told["pose"]["position"] + told["pose"]["quaternion_xyzw"]))
    found = run("ik", "ur5e", "--pose", pose, *spindle, "--json").json["solutions"]
    assert any(np.allclose(np.exp(1j * np.array(one["joints"])), 1.0, atol=1e-6) for one in found)
    assert (
        "no built-in tool and no tool file 'drill'"
        in run("fk", "ur5e", "-q", "0,0,0,0,0,0", "--tool", "drill").err
    )
