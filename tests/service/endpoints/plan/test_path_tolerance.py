"""Motions that keep near the path that is found, and proofs of motions near a path."""

from typing import Any

import httpx
import numpy as np
import pytest

import armwright as aw
from armwright_wire.motions.trajectory import TrajectoryBody
from kinematics.arrays import Array
from kinematics.trajectory.trajectory import Trajectory
from planning.options import Options
from planning.pipeline.moving_start import Splice
from planning.pipeline.pipeline import plan
from planning.problem import JointGoal, Problem
from planning.proof.path_nearness import path_nearness
from planning.result import Failure, Plan
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
    """Largest distance of any joint of states from places on a polyline, 1e-4 apart."""
    lengths = np.append(0.0, np.cumsum(np.abs(np.diff(line, axis=0)).max(axis=1)))
    at = np.arange(0.0, lengths[-1] + 1e-4, 1e-4)
    places = np.stack([np.interp(at, lengths, row) for row in line.T], axis=-1)
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
    assert largest_gap(states, path) <= near["deviation"] + 1e-4
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
        ({"refine": True, **FIELD}, "keep_path"),
        ({"path": {"tolerance": 1e-14}, "planner": "optimize"}, "too fine"),
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


LINE = {
    "planner": "cartesian",
    "planner_options": {"motions": [{"type": "lin", "pose": {"position": [0.4, -0.3, 0.5]}}]},
}


@pytest.mark.parametrize(
    "changes",
    [
        {"refine": True},
        {"planner": "optimize"},
        {"start": {"joints": START, "velocities": [0.4, 0.1, 0, 0, -0.3, 0, 0.2]}},
        {
            "planner": "optimize",
            "start": {"joints": START, "velocities": [0.1, 0, 0, 0, 0, 0, 0]},
            "goal": {"joints": GOAL, "velocities": [0.1, 0, 0, 0, 0, 0, 0]},
        },
        LINE,
    ],
)
@pytest.mark.parametrize("tolerance", [1e-4, 0.05])
def test_path_stands_for_a_motion_that_leaves_the_one_found(
    client: httpx.Client, changes: dict[str, Any], tolerance: float
) -> None:
    body = asked(path={"tolerance": tolerance}, limits={"acceleration": [10.0] * 7}) | changes
    if changes is LINE:
        T_base_tip = np.array(aw.fk(aw.load_robot("panda"), START))
        T_base_tip[:3, 3] += [-0.05, -0.1, 0.1]
        pose = {"transform": T_base_tip.tolist()}
        body |= {"planner_options": {"motions": [{"type": "lin", "pose": pose}]}}
        body |= {"goal": {"pose": pose}}
    answer = client.post("/v1/plan", json=body)
    assert answer.status_code == 200, answer.text
    found = answer.json()
    near, path = found["certificate"]["path"], np.array(found["path"]["joints"])
    assert found["certificate"]["verified"]
    assert near["deviation"] <= near["tolerance"] == tolerance
    # What is optimised may be no better than what was found.
    kept = found["planner"] != "optimize" and "velocities" not in body["start"] and changes != LINE
    assert kept != any("leaves the path" in note for note in found["notes"])
    motion = motion_of(found)
    np.testing.assert_allclose(path[0], START, atol=1e-12)
    np.testing.assert_allclose(path[-1], motion.end, atol=1e-9)
    states = motion.sample(np.linspace(0.0, motion.duration, 400))
    assert largest_gap(states, path) <= near["deviation"] + 1e-4
    # It is a path of few points, not one sample after another.
    assert len(path) <= 20 + 4.0 * motion.duration / np.sqrt(tolerance)


def test_motion_that_replaces_another_has_a_path_too() -> None:
    robot = aw.load_robot("panda")
    first = plan(Problem(robot, aw.Scene(), np.array(START), (JointGoal(GOAL),)), Options())
    assert isinstance(first, Plan)
    splice = Splice(first.trajectory, 0.4 * first.trajectory.duration)
    options = Options(path_tolerance=1e-3)
    problem = splice.begins(
        Problem(robot, aw.Scene(), np.array(START), (JointGoal(START),), margin=0.0)
    )
    joined = splice.join(plan(problem, options), problem, options)
    stopped = splice.join(Failure("NONE", "none", "none", "none"), problem, options)
    for found in (joined, stopped):
        assert isinstance(found, Plan)
        assert found.certificate.verified
        assert found.certificate.path is not None
        wrong = path_nearness(found.trajectory, found.path.waypoints, 1e-3)[1]
        assert wrong is None
