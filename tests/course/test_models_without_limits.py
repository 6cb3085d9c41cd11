"""Tables and URDF without position limits: kinematics need none, plans say which they miss."""

import math
from typing import Any

import httpx
import numpy as np
import pytest

from tests.course.example import ask

#: The notes' table of lecture 9 with numbers: a, alpha, d, theta and nothing else.
ROWS: list[dict[str, Any]] = [
    {"type": "revolute", "a": 0.3, "alpha": -math.pi / 2, "d": 0.4, "theta": 0.0},
    {"type": "revolute", "a": 0.0, "alpha": math.pi / 2, "d": 0.1, "theta": 0.0},
    {"type": "prismatic", "a": 0.0, "alpha": 0.0, "d": 0.2, "theta": 0.0},
]
URDF = """<robot name="bare"><link name="a"/><link name="b"/><link name="c"/>
<joint name="turn" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint>
<joint name="slide" type="prismatic"><parent link="b"/><child link="c"/>
<origin xyz="0.5 0 0"/><axis xyz="1 0 0"/></joint></robot>"""
Q = [0.3, -0.5, 0.25]


@pytest.fixture(scope="module")
def table(service: httpx.Client) -> Any:
    body = {"name": "bare_table", "dh": {"convention": "standard", "rows": ROWS}}
    stored = service.post("/v1/robots", json=body)
    assert stored.status_code == 201, stored.text
    return stored.json()


@pytest.fixture(scope="module")
def urdf(service: httpx.Client) -> Any:
    stored = service.post("/v1/robots", json={"name": "bare_urdf", "urdf": URDF})
    assert stored.status_code == 201, stored.text
    return stored.json()


def test_the_answer_says_that_the_range_is_unlimited(table: Any, urdf: Any) -> None:
    assert table["limits"]["lower"] == table["limits"]["upper"] == [None] * 3
    assert any("joint_1, joint_2, joint_3 have no lower" in note for note in table["lint"])
    assert urdf["limits"]["lower"] == [None, None]
    for joint in ("turn", "slide"):
        assert any(f"'{joint}'" in note and "unlimited" in note for note in urdf["lint"])


def test_joints_that_turn_without_end_are_not_reported(service: httpx.Client) -> None:
    rows = [ROWS[0] | {"continuous": True}, ROWS[2] | {"lower": 0.0}]
    body = {"name": "endless", "dh": {"convention": "standard", "rows": rows}}
    lint = service.post("/v1/robots", json=body).json()["lint"]
    (note,) = (note for note in lint if "no lower or no upper" in note)
    assert note.startswith("joint_2 have")


@pytest.mark.usefixtures("table")
def test_jacobian_potential_and_inverse_kinematics_need_no_limits(service: httpx.Client) -> None:
    J = np.array(ask(service, "robots/bare_table/jacobian", {"joints": Q})["jacobian"])
    near = [[Q[0] + step, *Q[1:]] for step in (1e-6, -1e-6)]
    poses = ask(service, "robots/bare_table/fk", {"joints": near})["pose"]
    p, m = (np.array(pose["position"]) for pose in poses)
    np.testing.assert_allclose(J[:3, 0], (p - m) / 2e-6, atol=1e-9)
    field = ask(
        service,
        "robots/bare_table/potential",
        {"joints": Q, "goal_joints": [0.0, 0.0, 0.0], "scene": {"obstacles": []}},
    )
    assert field["potential"] > 0.0
    target = ask(service, "robots/bare_table/fk", {"joints": Q})["pose"]["position"]
    found = ask(
        service,
        "robots/bare_table/ik",
        {"pose": {"position": target}, "method": "gradient", "axes": ["x", "y", "z"],
         "seed_joints": [0.2, -0.4, 0.2]},
    )  # fmt: skip
    reached = ask(service, "robots/bare_table/fk", {"joints": found["solutions"][0]["joints"]})
    np.testing.assert_allclose(reached["pose"]["position"], target, atol=1e-5)


@pytest.mark.usefixtures("table", "urdf")
@pytest.mark.parametrize(("robot", "n"), [("bare_table", 3), ("bare_urdf", 2)])
def test_a_plan_says_which_limit_it_misses_and_how_to_give_it(
    service: httpx.Client, robot: str, n: int
) -> None:
    body = {"robot": robot, "start": {"joints": [0.0] * n}, "goal": {"joints": [0.2] * n}}
    answer = service.post("/v1/plan", json=body)
    assert answer.status_code == 422
    problem = answer.json()
    assert problem["code"] == "MISSING_LIMIT"
    assert "velocity" in problem["detail"]
    assert "joint_limits" in problem["hint"]


def test_limits_of_positions_can_be_given_beside_the_description(service: httpx.Client) -> None:
    limits = {"turn": {"lower": -1.0, "upper": 2.0}, "slide": {"upper": 0.4}}
    body = {"name": "bounded_urdf", "urdf": URDF, "joint_limits": limits}
    stored = service.post("/v1/robots", json=body)
    assert stored.status_code == 201, stored.text
    assert stored.json()["limits"]["lower"] == [-1.0, None]
    assert stored.json()["limits"]["upper"] == [2.0, 0.4]


def test_a_joint_with_one_limit_plans_and_keeps_it(service: httpx.Client) -> None:
    row = {"a": 0.4, "alpha": 0.0, "d": 0.0, "theta": 0.0, "velocity": 1.0, "acceleration": 2.0}
    rows = [{"type": "revolute", "lower": 5.0, **row}, {"type": "revolute", **row}]
    dh = {"convention": "standard", "rows": rows, "geometry": {"capsules": 0.02}}
    assert service.post("/v1/robots", json={"name": "half_open", "dh": dh}).status_code == 201
    body = {
        "robot": "half_open",
        "start": {"joints": [5.5, 0.0]},
        "goal": {"joints": [7.0, 9.0]},
        "timeout": 20,
    }
    plan = ask(service, "plan", body)
    assert plan["certificate"]["verified"]
    assert plan["path"]["joints"][-1] == [7.0, 9.0]
    below = service.post("/v1/plan", json=body | {"goal": {"joints": [4.9, 0.0]}})
    assert below.status_code == 422
    assert below.json()["details"]["joint"] == "joint_1"
