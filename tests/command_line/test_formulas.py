"""Rotations, Jacobians and formulas from a shell; values from standard input."""

import io
import json
import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from command_line import robot_files
from tests.command_line.commands import Run


@pytest.fixture
def typed(monkeypatch: pytest.MonkeyPatch) -> io.StringIO:
    """Standard input of the next command."""
    text = io.StringIO()
    robot_files._standard_input.cache_clear()
    monkeypatch.setattr("sys.stdin", text)
    return text


def write(stream: io.StringIO, value: object) -> None:
    stream.write(json.dumps(value))
    stream.seek(0)


def test_a_jacobian_is_the_derivative_of_the_pose(run: Run) -> None:
    q = np.random.default_rng(3).uniform(-1, 1, 6)

    def position(joints: np.ndarray) -> np.ndarray:
        words = ",".join(map(repr, joints.tolist()))
        return np.array(run("fk", "ur5e", f"--joints={words}", "--json").json["pose"]["position"])

    words = ",".join(map(repr, q.tolist()))
    asked = "jacobian", "ur5e", f"--joints={words}", "--axes", "x,y,z"
    J = np.array(run(*asked, "--json").json["jacobian"])
    step = 1e-6
    for k, column in enumerate(J.T):
        ahead, behind = q.copy(), q.copy()
        ahead[k] += step
        behind[k] -= step
        slope = (position(ahead) - position(behind)) / (2 * step)
        np.testing.assert_allclose(slope, column, atol=1e-8)
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
    robot_files._standard_input.cache_clear()
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
