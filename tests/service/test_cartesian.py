"""Tool motions over HTTP: what is asked for, what comes back, what is refused."""

from typing import Any

import httpx
import numpy as np
import pytest

from armwright_client import CartesianOptions as ClientOptions
from armwright_client import Plan as ClientPlan
from armwright_client import Pose as ClientPose
from armwright_client import ToolMotion
from armwright_wire.plans.plan import PlanAnswer
from kinematics.forward import forward
from kinematics.pose import to_quaternion
from kinematics.robots import builtin_chain
from tests.service.robots import HOME, answer, problem, scene

CHAIN = builtin_chain("panda")
TIP = forward(CHAIN, HOME)
TURN = to_quaternion(TIP[:3, :3]).tolist()


def pose(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> dict[str, Any]:
    return {"position": (TIP[:3, 3] + [x, y, z]).tolist(), "quaternion_xyzw": TURN}


BODY: dict[str, Any] = {
    "robot": "panda",
    "start": {"joints": HOME},
    "goal": {"pose": pose(0.0, 0.2, 0.0)},
    "planner": "cartesian",
    "timeout": 20.0,
}


def plan(client: httpx.Client, **changes: Any) -> dict[str, Any]:
    found = answer(client.post("/v1/plan", json=BODY | changes))
    PlanAnswer.model_validate(found)
    ClientPlan.model_validate(found)
    return found


def test_a_goal_alone_is_one_line(client: httpx.Client) -> None:
    found = plan(client, timing={"sample_period": 0.01, "tool_speed": 0.2})
    assert (found["planner"], found["fraction"], found["stopped"]) == ("cartesian", 1.0, None)
    (motion,) = found["tool_motions"]
    assert (motion["type"], motion["begins"], motion["fraction"]) == ("lin", 0.0, 1.0)
    assert motion["length"] == pytest.approx(0.2)
    assert motion["ends"] == pytest.approx(found["trajectory"]["duration"])
    deviation = found["certificate"]["path_deviation"]
    assert 0.0 < deviation["position"] <= deviation["max_position"] == 1e-4
    assert 0.0 <= deviation["orientation"] <= deviation["max_orientation"] == 1e-3
    tool = forward(CHAIN, found["trajectory"]["samples"]["position"])[:, :3, 3] - TIP[:3, 3]
    assert np.abs(tool[:, [0, 2]]).max() <= deviation["position"]
    assert np.ptp(tool[:, 1]) == pytest.approx(0.2, abs=1e-6)
    assert [stage["name"] for stage in found["stages"]] == [
        "preflight", "cartesian", "timing", "certificate"]  # fmt: skip
    assert plan(client, timing={"sample_period": 0.01, "tool_speed": 0.2})["path"] == found["path"]


def test_a_way_that_ends_early(client: httpx.Client) -> None:
    wall = {
        "id": "wall",
        "shape": {"type": "box", "size": [0.4, 0.02, 0.4]},
        "pose": {"position": (TIP[:3, 3] + [0.0, 0.3, 0.0]).tolist()},
    }
    body = BODY | {"goal": {"pose": pose(0.0, 0.4, 0.0)}, "scene": scene(wall)}
    document = problem(client.post("/v1/plan", json=body), 422, "PLANNING_FAILED")
    assert document["stage"] == "cartesian"
    details = document["details"]
    assert details["reason"] == "collision"
    assert "wall" in details["pair"]
    assert 0.0 < details["fraction"] < 0.75
    reached = forward(CHAIN, details["nearest"]["joints"])
    np.testing.assert_allclose(reached[:3, 3], details["nearest"]["pose"]["position"], atol=1e-9)
    partial = plan(client, **(body | {"planner_options": {"allow_partial": True}}))
    assert partial["fraction"] == pytest.approx(details["fraction"])
    assert partial["stopped"]["reason"] == "collision"
    assert partial["notes"]
    assert partial["certificate"]["verified"]


def test_what_breaks_a_constraint_on_the_way_is_told(client: httpx.Client) -> None:
    region = {"type": "box", "pose": pose(0.0, 0.1, 0.0), "size": [0.1, 0.21, 0.1]}
    arc = {"type": "circ", "pose": pose(0.0, 0.2, 0.0), "via": pose(0.0, 0.1, -0.08)["position"]}
    options = {"motions": [arc]}
    body = BODY | {"constraints": [{"type": "position", "region": region}]}
    response = client.post("/v1/plan", json=body | {"planner_options": options})
    document = problem(response, 422, "INVALID_MOTION_PLAN")
    assert document["details"]["kind"] == "path_constraint"
    assert "constraint" in document["hint"]


def test_rounded_corners_are_answered_as_motions_that_validation_takes(
    client: httpx.Client,
) -> None:
    ways = [pose(0.0, 0.1, 0.0), pose(0.0, 0.1, -0.1)]
    asked = ClientOptions(
        motions=[ToolMotion.lin(ClientPose.model_validate(way)) for way in ways], blend=0.02
    )
    found = plan(
        client, goal={"pose": ways[-1]}, planner_options=asked.as_options(),
        timing={"tool_speed": 0.1},
    )  # fmt: skip
    reports = ClientPlan.model_validate(found).tool_motions
    assert reports is not None
    assert [(report.motion, report.blend) for report in reports] == [
        (0, False), (0, True), (1, False)]  # fmt: skip
    assert [report.type for report in reports] == ["lin", "corner", "lin"]
    assert reports[1].rounds is not None
    np.testing.assert_allclose(
        reports[1].rounds.pose.position, TIP[:3, 3] + [0.0, 0.1, 0.0], atol=1e-9
    )
    body = {
        "robot": "panda",
        "trajectory": found["trajectory"],
        "tool_motions": {
            "motions": [report.as_motion.model_dump(exclude_none=True) for report in reports],
            "ends": [report.ends for report in reports],
        },
    }
    certificate = answer(client.post("/v1/validate", json=body))
    assert certificate["verified"]
    deviation = certificate["path_deviation"]
    assert deviation["position"] == pytest.approx(
        found["certificate"]["path_deviation"]["position"], rel=0.3
    )
    refused = client.post("/v1/plan", json=BODY | {"planner_options": {"blend": -1.0}})
    assert "blend" in problem(refused, 422, "VALIDATION_ERROR")["detail"]
