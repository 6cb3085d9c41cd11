"""Motions that keep near the path that is found, and proofs of motions near a path."""

from typing import Any

import httpx
import numpy as np
import pytest

import armwright as aw
from armwright_wire.motions.trajectory import TrajectoryBody
from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.trajectory.trajectory import Trajectory
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.problem import JointGoal, Problem
from planning.proof.path_nearness import path_nearness
from service.translate.trajectories import named_trajectory

START, GOAL = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785], [1.2, -0.3, 0, -2.0, 0, 1.8, 0.785]
POST = {
    "id": "post",
    "shape": {"type": "box", "size": [0.1, 0.1, 1.0]},
    "pose": {"position": [0.45, 0.2, 0.5]},
}
FIELD = {"planner": "potential_field", "planner_options": {"keep_path": True}}


def asked(**changes: Any) -> dict[str, Any]:
    scene = {"obstacles": [POST]}
    ends = {"start": {"joints": START}, "goal": {"joints": GOAL}}
    return {"robot": "panda", "scene": scene, **ends, "timeout": 20.0, **changes}


def motion_of(plan: dict[str, Any]) -> Trajectory:
    given = {name: plan["trajectory"][name] for name in ("joint_names", "segments")}
    return named_trajectory(TrajectoryBody.model_validate(given))


def largest_gap(states: Array, line: Array) -> float:
    """Largest distance of any joint of states from the nearest of dense places on a polyline."""
    at = np.linspace(0.0, len(line) - 1.0, 200 * (len(line) - 1) + 1)
    places = np.stack([np.interp(at, np.arange(len(line)), row) for row in line.T], axis=-1)
    return max(float(np.abs(places - q).max(axis=1).min()) for q in states)


@pytest.mark.parametrize("options", [{}, {"planner": "rrt_connect"}, FIELD])
@pytest.mark.parametrize("tolerance", [1e-3, 0.05])
def test_plan_keeps_near_its_path(
    client: httpx.Client, options: dict[str, Any], tolerance: float
) -> None:
    body = asked(path={"tolerance": tolerance}, **options)
    if options is FIELD:
        body |= {"robot": "planar_rr", "scene": None}
        body |= {"start": {"joints": [0.1, 0.2]}, "goal": {"joints": [1.5, -0.8]}}
    answer = client.post("/v1/plan", json=body)
    assert answer.status_code == 200, answer.text
    found = answer.json()
    near, path = found["certificate"]["path"], np.array(found["path"]["joints"])
    assert found["certificate"]["verified"]
    assert near["tolerance"] == tolerance
    assert near["deviation"] <= tolerance
    motion = motion_of(found)
    states = motion.sample(np.linspace(0.0, motion.duration, 200))
    assert largest_gap(states, path) <= near["deviation"] + 1e-3
    assert path_nearness(motion, path, 1.01 * tolerance)[1] is None
    if options is not FIELD:
        # The same by validate, for this path and for another one.
        question = {key: body[key] for key in ("robot", "scene", "timeout")}
        question |= {"trajectory": found["trajectory"], "limits": found["timing"]["limits"]}
        given = {"joints": path.tolist(), "tolerance": tolerance}
        proof = client.post("/v1/validate", json=question | {"path": given}).json()
        assert proof["verified"], proof
        assert proof["path"] == near
        bent = path.copy()
        bent[-1] += 3.0 * tolerance
        given = {"joints": bent.tolist(), "tolerance": tolerance}
        proof = client.post("/v1/validate", json=question | {"path": given}).json()
        assert not proof["verified"]
        assert proof["violation"]["kind"] == "path_deviation"
        assert proof["path"] == {"tolerance": tolerance, "deviation": None}
        assert not proof["proved"]["limits"]


def test_descent_keeps_nearer_with_a_smaller_tolerance_and_takes_longer(
    client: httpx.Client,
) -> None:
    body = {"robot": "planar_rr", "start": {"joints": [0.1, 0.2]}, "goal": {"joints": [1.5, -0.8]}}
    durations, deviations = [], []
    for tolerance in (0.1, 1e-2, 1e-4):
        answer = client.post("/v1/plan", json=body | FIELD | {"path": {"tolerance": tolerance}})
        assert answer.status_code == 200, answer.text
        durations.append(answer.json()["trajectory"]["duration"])
        deviations.append(answer.json()["certificate"]["path"]["deviation"])
    assert sorted(durations) == durations
    assert sorted(deviations, reverse=True) == deviations


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"refine": True}, "path.tolerance"),
        ({"planner": "optimize"}, "path.tolerance"),
        ({"timing": {"blend_tolerance": 0.1}}, "blend_tolerance"),
        ({"timing": {"method": "spline"}}, "path.tolerance"),
        ({"path": {"tolerance": 0.0}}, "path.tolerance"),
        ({"path": {"tolerance": 0.1, "knots": [0, 1]}}, "knots"),
    ],
)
def test_what_does_not_go_with_a_tolerance_is_refused(
    client: httpx.Client, changes: dict[str, Any], told: str
) -> None:
    answer = client.post("/v1/plan", json=asked(path={"tolerance": 0.01}) | changes)
    assert 400 <= answer.status_code < 500
    assert told in answer.text


def test_path_of_other_joints_is_refused(client: httpx.Client) -> None:
    found = client.post("/v1/plan", json=asked()).json()
    given = {"joints": [[0.0, 1.0]], "tolerance": 0.1}
    question = {"robot": "panda", "trajectory": found["trajectory"], "path": given}
    answer = client.post("/v1/validate", json=question)
    assert answer.status_code == 422
    assert "path.joints" in answer.json()["detail"]


def test_moving_start_has_no_path_to_keep() -> None:
    robot = aw.load_robot("panda")
    problem = Problem(
        robot, aw.Scene(), np.array(START), (JointGoal(GOAL),), start_velocity=np.full(7, 0.1)
    )
    with pytest.raises(InvalidOption, match=r"path\.tolerance"):
        plan(problem, Options(path_tolerance=0.01))
