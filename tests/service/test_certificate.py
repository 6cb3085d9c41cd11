"""Certificates over HTTP: of plans, of motions that others made, and what they do not prove."""

from typing import Any

import httpx
import numpy as np
import pytest

from armwright_client import Certificate as ClientCertificate
from armwright_wire.motions.certificate import CertificateAnswer
from kinematics.forward import forward
from kinematics.pose import to_quaternion
from kinematics.robots import builtin_chain
from tests.service.planning import PLACE, world
from tests.service.robots import ASIDE, HOME, POST, answer, problem, scene, solid

TIP = forward(builtin_chain("panda"), HOME)
ROW = {
    "type": "revolute", "a": 0.5, "alpha": 0.0, "d": 0.0, "theta": 0.0,
    "lower": -3.0, "upper": 3.0, "velocity": 2.0, "acceleration": 5.0,
}  # fmt: skip
BALL = solid("ball", "sphere", [0.95, 0.0, 0.0], radius=0.1)
#: Through the ball, for an arm of two links of half a metre.
THROUGH: dict[str, Any] = {
    "robot": "lines",
    "start": {"joints": [-0.5, 0.0]},
    "goal": {"joints": [0.5, 0.0]},
    "timing": {"method": "toppra"},
    "timeout": 20.0,
}


def same(planned: Any, validated: Any, where: str = "certificate") -> None:
    """Hold two certificates to be the same, number by number."""
    if isinstance(planned, dict):
        # A plan says beside its certificate which frame its poses are in.
        assert set(planned) == set(validated) - {"frame", "frame_note"}, where
        for name in planned:
            same(planned[name], validated[name], f"{where}.{name}")
    elif isinstance(planned, list):
        assert len(planned) == len(validated), where
        for i, (one, other) in enumerate(zip(planned, validated, strict=True)):
            same(one, other, f"{where}[{i}]")
    elif isinstance(planned, float):
        assert planned == pytest.approx(validated, rel=1e-9, abs=1e-12), where
    else:
        assert planned == validated, where


def test_validation_of_a_plan_gives_its_certificate_field_by_field(client: httpx.Client) -> None:
    turn = to_quaternion(TIP[:3, :3]).tolist()

    def pose(y: float, z: float) -> dict[str, Any]:
        return {"position": (TIP[:3, 3] + [0.0, y, z]).tolist(), "quaternion_xyzw": turn}

    motions = [
        {"type": "lin", "pose": pose(0.1, 0.0)},
        {"type": "circ", "pose": pose(0.2, 0.0), "via": (TIP[:3, 3] + [0.0, 0.15, 0.05]).tolist()},
    ]
    level = {"type": "orientation", "axis": [0, 0, 1], "direction": [0, 0, -1], "cone_angle": 0.1}
    shared = {
        "robot": "panda",
        "scene": scene(POST | {"pose": {"position": [0.5, -0.6, 0.6]}}),
        "constraints": [level],
        "margin": 0.01,
        "timeout": 30.0,
    }
    more = {"torque_limits": True, "payload": {"mass": 1.5}, "tool_speed": 0.2}
    asked = shared | {
        "start": {"joints": HOME},
        "goal": {"pose": pose(0.2, 0.0)},
        "planner": "cartesian",
        "planner_options": {"motions": motions, "max_deviation": 1e-4},
        "timing": more,
    }
    planned = answer(client.post("/v1/plan", json=asked))
    first = planned["certificate"]
    assert first["verified"]
    assert first["proved"] == {"limits": True, "collisions": True, "reasons": []}
    assert first["path_deviation"]["position"] <= 1e-4
    assert {"torque", "tool_speed"} <= {name for name, use in first["limits"].items() if use}
    assert first["path_constraint_residual"] == 0.0
    ends = [report["ends"] for report in planned["tool_motions"]]
    held = {"motions": motions, "ends": ends, "max_deviation": 1e-4}
    body = shared | more | {"trajectory": planned["trajectory"], "tool_motions": held}
    second = answer(client.post("/v1/validate", json=body))
    CertificateAnswer.model_validate(second)
    assert ClientCertificate.model_validate(second).proved.collisions
    same(first, second)
    # Held to a line that it does not follow, it is refused.
    aside = [motions[0] | {"pose": pose(0.1, 0.05)}, motions[1]]
    wrong = body | {"tool_motions": held | {"motions": aside}}
    refused = answer(client.post("/v1/validate", json=wrong))
    assert not refused["verified"]
    assert refused["violation"]["kind"] == "path_deviation"
    assert not refused["proved"]["limits"]
    assert refused["proved"]["collisions"]
    assert refused["proved"]["reasons"] == [refused["violation"]["message"]]


def lines(client: httpx.Client) -> None:
    """An arm of two links from a DH table, without solids."""
    client.delete("/v1/robots/lines")
    dh = {"convention": "standard", "rows": [ROW, ROW]}
    answer(client.post("/v1/robots", json={"name": "lines", "dh": dh}), 201)


def test_obstacles_and_no_solids_are_refused(client: httpx.Client) -> None:
    lines(client)
    asked = THROUGH | {"scene": scene(BALL)}
    told = problem(client.post("/v1/plan", json=asked), 422, "INVALID_ROBOT_DESCRIPTION")
    assert "no collision geometry" in told["detail"]
    assert told["details"]["reason"] == "no_collision_geometry"
    assert '"collisions": "ignore"' in told["hint"]
    free = answer(client.post("/v1/plan", json=THROUGH))
    assert free["certificate"]["verified"]
    proved = free["certificate"]["proved"]
    assert (proved["limits"], proved["collisions"]) == (True, False)
    assert "nothing is known of collisions" in proved["reasons"][0]
    body = {"robot": "lines", "scene": scene(BALL), "trajectory": free["trajectory"]}
    problem(client.post("/v1/validate", json=body), 422, "INVALID_ROBOT_DESCRIPTION")


def test_collisions_that_a_request_ignores_are_not_proved(client: httpx.Client) -> None:
    lines(client)
    ignoring = {"scene": scene(BALL), "collisions": "ignore"}
    planned = answer(client.post("/v1/plan", json=THROUGH | ignoring))
    body = {"robot": "lines", "trajectory": planned["trajectory"]} | ignoring
    validated = answer(client.post("/v1/validate", json=body))
    same(planned["certificate"], validated)
    for certificate in (planned["certificate"], validated):
        assert certificate["verified"]
        assert not certificate["proved"]["collisions"]
        assert certificate["proved"]["reasons"]
        assert certificate["min_clearance"] is None


def test_a_robot_without_jerk_limits_moves_by_the_rule_which_the_answer_tells(
    client: httpx.Client,
) -> None:
    lines(client)
    timing = {"acceleration_scaling": 0.5}
    told = answer(client.post("/v1/plan", json=THROUGH | {"timing": timing}))
    names = told["trajectory"]["joint_names"]
    assert told["timing"]["method"] == "jerk_limited"
    assert told["timing"]["ruled"] == {"jerk": {"rule": "25 x acceleration", "joints": names}}
    limits = told["timing"]["limits"]
    assert limits == {"velocity": [2.0] * 2, "acceleration": [2.5] * 2, "jerk": [125.0] * 2}
    worst = told["certificate"]["limits"]["jerk"]["worst_ratio"]
    assert 0.99 < worst <= 1.0 + 1e-9
    # The motion again, held to the limits that the answer names.
    body = {"robot": "lines", "trajectory": told["trajectory"], "limits": limits}
    proved = answer(client.post("/v1/validate", json=body))
    assert proved["limits"]["jerk"]["worst_ratio"] == worst
    refused = problem(
        client.post("/v1/plan", json=THROUGH | {"timing": {"method": "jerk_limited"}}),
        422,
        "MISSING_LIMIT",
    )
    assert names[0] in refused["detail"]


def validate(client: httpx.Client, trajectory: dict[str, Any], **more: Any) -> dict[str, Any]:
    body = {"robot": "panda", "scene": PLACE, "trajectory": trajectory} | more
    found = answer(client.post("/v1/validate", json=body))
    CertificateAnswer.model_validate(found)
    return found


def through_the_post(duration: float = 3.0) -> dict[str, Any]:
    return {
        "samples": {"time": [0.0, duration], "position": [HOME, ASIDE]},
        "interpolation": "clamped_spline",
    }


def test_a_collision_is_found_with_its_time(client: httpx.Client) -> None:
    found = validate(client, through_the_post())
    assert found["verified"] is False
    violation = found["violation"]
    assert violation["kind"] == "collision"
    assert "post" in violation["pair"]
    s = violation["time"] / 3.0
    q = np.array(HOME) + (3 * s**2 - 2 * s**3) * (np.array(ASIDE) - np.array(HOME))
    assert world().clearance(q).distance <= 1e-6


def test_what_is_too_fast_is_told_by_joint(client: httpx.Client) -> None:
    found = validate(client, through_the_post(0.2), scene=None)
    assert found["verified"] is False
    assert found["violation"]["kind"] in ("velocity", "acceleration")
    assert found["violation"]["joint"] == "panda_joint1"
    velocity = found["limits"]["velocity"]
    limit = builtin_chain("panda").limits.velocity[0]
    assert velocity["worst_ratio"] == pytest.approx(1.5 * 1.2 / 0.2 / limit)
    slow = validate(client, through_the_post(3.0), scene=None)
    assert slow["verified"] is True
    tight = validate(client, through_the_post(3.0), scene=None, limits={"velocity": [0.1] * 7})
    assert tight["violation"]["kind"] == "velocity"
    assert tight["limits"]["velocity"]["worst_ratio"] == pytest.approx(1.5 * 1.2 / 3.0 / 0.1)
