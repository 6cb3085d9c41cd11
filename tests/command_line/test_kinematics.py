"""Kinematics and formulas from a shell; values from standard input."""

import io
import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import armwright as aw
from command_line import robot_files
from kinematics.jacobian import geometric
from kinematics.robots import builtin_chain, builtin_urdf
from service.endpoints.ik.task import ik
from service.storage.caches.cache_key import builtin_reference
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


def test_branches_have_the_names_that_the_service_and_the_library_give(run: Run) -> None:
    pose = run("fk", "ur5e", "-q", "0.3,-1.2,1.4,-0.5,0.8,0.1", "--json").json["pose"]
    words = ("ik", "ur5e", "--pose", json.dumps(pose), "--all", "--count", "64")
    asked = json.dumps({"pose": pose, "all_solutions": True, "max_solutions": 64}).encode()
    answer: Any = ik(builtin_reference("ur5e"), None, asked)
    told = {one["branch"] for one in json.loads(answer)["solutions"]}
    assert len(told) == 8
    assert {one["branch"] for one in run(*words, "--json").json["solutions"]} == told
    assert all(name in run(*words).out for name in told)
    T = aw.pose(pose["position"], pose["quaternion_xyzw"])
    found = aw.ik(aw.load_robot("ur5e"), T, most=64)
    assert {one.branch for one in found.solutions} == told


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
        "no built-in tool, none of the robot and no tool file 'drill'"
        in run("fk", "ur5e", "-q", "0,0,0,0,0,0", "--tool", "drill").err
    )


@pytest.fixture
def typed(monkeypatch: pytest.MonkeyPatch) -> io.StringIO:
    """Standard input of the next command."""
    text = io.StringIO()
    robot_files.standard_input.cache_clear()
    monkeypatch.setattr("sys.stdin", text)
    return text


def write(stream: io.StringIO, value: object) -> None:
    stream.write(json.dumps(value))
    stream.seek(0)


def test_a_jacobian_has_the_rows_asked_for(run: Run) -> None:
    q = np.random.default_rng(3).uniform(-1, 1, 6)
    words = ",".join(map(repr, q.tolist()))
    asked = "jacobian", "ur5e", f"--joints={words}", "--axes", "x,y,z"
    J = np.array(run(*asked, "--json").json["jacobian"])
    np.testing.assert_allclose(J, geometric(builtin_chain("ur5e"), q)[:3], atol=1e-12)
    shown = run(*asked).out
    assert f"{J[2, 0]:.4f}" in shown
    assert "manipulability" in shown


def test_every_form_of_a_rotation_is_that_of_scipy(run: Run, typed: io.StringIO) -> None:
    for turn in Rotation.random(5, rng=np.random.default_rng(5)):
        roll, pitch, yaw = turn.as_euler("xyz").tolist()
        forms = run("pose", f"0.1,0.2,0.3,{roll!r},{pitch!r},{yaw!r}", "--json").json["pose"]
        np.testing.assert_allclose(forms["rotation_matrix"], turn.as_matrix(), atol=1e-12)
        np.testing.assert_allclose(
            Rotation.from_euler("ZYZ", forms["euler_zyz"]).as_matrix(), turn.as_matrix(), atol=1e-9
        )
    write(typed, forms)
    back = run("pose", "-", "--inverse", "--json")
    assert back.code == 3, "a pose has one orientation"
    assert "rpy is singular" in run("pose", "0,0,0,0.1,1.5707963267948966,0.3").out


def test_ik_takes_a_pose_of_standard_input_axes_and_a_method(run: Run, typed: io.StringIO) -> None:
    write(typed, [0.4, 0.1, 0.5, 3.0, 0.2, 0.1])
    found = run("ik", "panda", "--pose", "-", "--method", "numeric", "--axes", "x,y,z", "--json")
    assert found.code == 0, found.err
    joints = ",".join(map(repr, found.json["solutions"][0]["joints"]))
    pose = run("fk", "panda", f"--joints={joints}", "--json").json["pose"]
    np.testing.assert_allclose(pose["position"], [0.4, 0.1, 0.5], atol=1e-5)
    turn = Rotation.from_quat(pose["quaternion_xyzw"])
    asked = Rotation.from_euler("xyz", [3.0, 0.2, 0.1])
    assert (turn * asked.inv()).magnitude() > 0.01, "its rotation is free"
    refused = run("ik", "panda", "--pose", "0.4,0,0.5", "--method", "magic")
    assert refused.code == 3
    assert "method" in refused.err


def test_a_motion_and_its_premises_come_from_standard_input_once(
    run: Run, typed: io.StringIO
) -> None:
    plan = run("plan", "planar_rr", "--start", "0,0.5", "--goal", "0.5,0.2", "--json").json
    write(typed, plan)
    assert run("validate", "planar_rr", "-").code == 0
    robot_files.standard_input.cache_clear()
    typed.truncate(0)
    refused = run("validate", "planar_rr", "-")
    assert refused.code == 3
    assert "-: it is not JSON" in refused.err


def test_formulas_have_the_values_of_the_pose(run: Run) -> None:
    answer = run("equations", "planar_rr", "--json").json
    values = {item["symbol"]: item["value"] for item in answer["parameters"]}
    q = {"q_1": 0.3, "q_2": -0.8}
    names = {"cos": np.cos, "sin": np.sin, **values, **q}
    for item in answer["abbreviations"]:
        names[item["symbol"]] = eval(item["formula"].replace("^", "**"), {}, names)
    position = [eval(text, {}, names) for text in answer["pose"]["position"]]
    wanted = run("fk", "planar_rr", "--joints=0.3,-0.8", "--json").json["pose"]["position"]
    np.testing.assert_allclose(position, wanted, atol=1e-12)
    assert re.search(r"cos", run("equations", "planar_rr").out)
    assert r"\cos" in run("equations", "planar_rr", "--format", "latex").out


def test_a_robot_its_limits_a_recording_and_a_plan_to_view_come_from_standard_input(
    run: Run, typed: io.StringIO, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def given(text: str) -> None:
        robot_files.standard_input.cache_clear()
        monkeypatch.setattr("sys.stdin", io.StringIO(text))

    urdf = tmp_path / "arm.urdf"
    urdf.write_text(builtin_urdf("planar_rr"))
    given(urdf.read_text())
    asked = ("fk", "-", "-q", "0.3,0.4", "--json")
    assert run(*asked).json == run("fk", "planar_rr", *asked[2:]).json
    given(json.dumps({"name": "mine", "urdf": urdf.read_text()}))
    assert run("robots", "-", "--json").json["name"] == "mine"
    given(json.dumps({"joint_1": {"velocity": 0.25}}))
    words = ("retime", str(urdf), str(tmp_path / "path.json"), "--json")
    (tmp_path / "path.json").write_text(json.dumps({"joints": [[0.0, 0.5], [0.6, 0.5]]}))
    slow = run(*words, "--joint-limits", "-").json
    assert slow["trajectory"]["duration"] > 0.6 / 0.25
    rows = [f"{0.1 * k},{0.01 * k * k},{0.02 * k}" for k in range(11)]
    given("\n".join(["time,position.joint_1,position.joint_2", *rows]))
    assert run("fit", "planar_rr", "-", "--tolerance", "0.01", "--json").json["deviation"] < 0.01
    given("nonsense")
    assert run("fit", "planar_rr", "-", "--tolerance", "0.01").code == 3
    monkeypatch.chdir(tmp_path)
    given(json.dumps(slow["trajectory"]))
    assert run("view", "-", "--robot", "planar_rr").out == "plan.html\n"
    assert b"<html" in (tmp_path / "plan.html").read_bytes()
