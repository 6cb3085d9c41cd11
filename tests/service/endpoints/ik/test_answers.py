"""Solutions of inverse kinematics as answers: traces, collisions, order, hints and many poses."""

import json
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from armwright_wire.robots.kinematics import GradientTrace, IkRequest
from kinematics.forward import forward
from kinematics.ik import inverse
from kinematics.ik.gradient import Trace
from kinematics.ik.solution import IkSolution
from kinematics.robots import builtin_chain, builtin_urdf
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Sphere
from planning.constrained.ik import ConstrainedSolution
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import ClearanceConstraint
from service.endpoints.attached_objects import RobotInScene
from service.endpoints.ik import task
from service.endpoints.ik.constrained import _too_near
from service.endpoints.ik.task import (
    CollisionCheck,
    convergence_problem,
    solution_answer,
    trace_answer,
)
from service.storage.caches.cache_key import builtin_reference
from tests.planning.scenes import HOME, box, builtin
from tests.service.poses import as_pose, draws

CHAIN = builtin_chain("panda")
SOLUTION = IkSolution(HOME, 1e-9, 2e-9, 7, "elbow up")


def trace(count: int) -> Trace:
    times = np.arange(float(count))
    joints, errors = np.outer(times, np.ones(7)), np.outer(times, np.arange(6.0))
    return Trace(times, joints, errors, 2.0 * times, 3.0 * times, converged=False)


def request(**gradient: Any) -> IkRequest:
    options = gradient or None
    return IkRequest.model_validate(
        {"pose": {"position": [0, 0, 0]}, "method": "gradient", "gradient": options}
    )


@pytest.mark.parametrize(
    ("count", "points"), [(1, 1), (2, 2), (500, 500), (501, 500), (20_000, 500)]
)
def test_a_long_trace_of_a_refusal_is_thinned_out_between_its_ends(count: int, points: int) -> None:
    answer = trace_answer(trace(count), request())
    GradientTrace.model_validate(answer)
    times = answer["time"]
    assert len(times) == points
    assert (times[0], times[-1]) == (0.0, count - 1.0)
    assert times == sorted(set(times))
    assert [row[0] for row in answer["joints"]] == times
    assert answer["position_error"] == [2.0 * t for t in times]
    assert answer["orientation_error"] == [3.0 * t for t in times]


def test_a_gradient_that_ends_elsewhere_says_where() -> None:
    problem = convergence_problem("hand", trace(8), request())
    assert (problem.code, problem.details["stage"]) == ("NO_IK_SOLUTION", "ik")
    assert "after 7 steps" in problem.message
    assert "14 m and 21 rad" in problem.message
    assert problem.details["nearest_joints"] == [7.0] * 7
    assert (problem.details["position_error"], problem.details["orientation_error"]) == (14.0, 21.0)


# -------------------------------------------------------------------------------- collisions


def answers_at(*rows: Any) -> list[dict[str, Any]]:
    return [solution_answer(CHAIN, SOLUTION._replace(joints=np.array(row))) for row in rows]


@pytest.fixture
def check() -> CollisionCheck:
    """A ball in the way of the arm where it turns by about a quarter."""
    at = np.eye(4)
    at[:3, 3] = [0.0, 0.4, 0.55]
    scene = Scene((Obstacle("ball", Sphere(0.15), at),))
    return CollisionCheck(RobotInScene(builtin("panda"), scene))


TURNED = HOME + np.array([np.pi / 2, 0, 0, 0, 0, 0, 0])
BEYOND = HOME + np.array([0, 0, 0, 0, 0, 0, 9.0])


def test_solutions_outside_the_limits_go_last_with_both_reasons(check: CollisionCheck) -> None:
    both = TURNED + BEYOND - HOME
    ordered = check.apply(answers_at(both, BEYOND, TURNED, HOME), everything=True)
    order = [(item["within_limits"], item["collision_free"]) for item in ordered]
    assert order == [(True, True), (True, False), (False, True), (False, False)]
    first, second = ordered[-1]["rejected_because"].split("; ")
    assert "panda_joint7" in first
    assert "overlap" in second


def test_the_best_of_equals_stays_the_best(check: CollisionCheck) -> None:
    near, far = HOME + 0.01, HOME - 0.01
    ordered = check.apply(answers_at(near, far), everything=True)
    assert [item["joints"] for item in ordered] == [near.tolist(), far.tolist()]


def test_the_search_ends_at_the_first_usable_one(check: CollisionCheck) -> None:
    some = check.apply(answers_at(TURNED, BEYOND, HOME, HOME + 0.01), everything=False)
    assert len(some) == 3
    assert some[0]["joints"] == HOME.tolist()
    everything = check.apply(answers_at(TURNED, BEYOND, HOME, HOME + 0.01), everything=True)
    assert len(everything) == 4


def test_only_some_depths_are_measured(
    check: CollisionCheck, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[Any] = []

    def collisions(q: Any) -> list[Any]:
        calls.append(q)
        return [SimpleNamespace(pair=("ball", "hand"), depth=0.5)]

    monkeypatch.setattr(check, "_world", SimpleNamespace(collisions=collisions))
    ordered = check.apply(answers_at(*[TURNED] * 12), everything=True)
    assert len(calls) == 8
    reasons = [item["rejected_because"] for item in ordered]
    assert reasons[:8] == ["'ball' and 'hand' overlap by 0.5 m"] * 8
    assert all(reason.endswith(" overlap") for reason in reasons[8:])


BESIDE = "widen the constraints, move the obstacle, or try another seed."
WALL = box("wall", (0.1, 0.1, 0.1), (0.4, 0.3, 0.4))


@pytest.mark.parametrize(
    ("margin", "clearance", "other", "cures"),
    [
        (0.0, -0.05, "wall", BESIDE.capitalize()),
        (0.02, -0.05, "wall", BESIDE.capitalize()),
        (
            0.1,
            -0.05,
            "wall",
            f"Lower the margin by 0.05 m, {BESIDE}",
        ),
        (0.1, -0.05, "panda_link2", "Widen the constraints, or try another seed."),
    ],
)  # fmt: skip
def test_only_what_is_there_is_to_be_changed(
    margin: float, clearance: float, other: str, cures: str
) -> None:
    """A margin of less than the overlap is no cure, and own links know none."""
    wanted = ConstraintSet(CHAIN, (ClearanceConstraint(margin),) if margin else ())
    pair = ("panda_hand", other)
    nearest = ConstrainedSolution(np.zeros(7), np.zeros(0), clearance, pair, 0.0)
    what, hint = _too_near(wanted, nearest, RobotInScene(builtin("panda"), Scene((WALL,))))
    assert "closer than they may be by 0.05 m" in what
    assert hint == cures


def test_what_touches_is_not_closer_by_nothing() -> None:
    nearest = ConstrainedSolution(np.zeros(7), np.zeros(0), -1e-9, ("a", "b"), 0.0)
    what, hint = _too_near(ConstraintSet(CHAIN, (ClearanceConstraint(0.1),)), nearest, None)
    assert what == "has 'a' and 'b' touching"
    assert "margin" not in hint


@pytest.mark.parametrize(
    ("robot", "more"),
    [
        ("panda", {}),
        ("ur5e", {}),
        ("ur5e", {"method": "numeric"}),
        ("panda", {"axes": ["x", "y", "z", "rx", "ry"]}),
        ("ur5e", {"choice": "limits"}),
    ],
)
def test_many_poses_are_solved_in_one_call_of_the_batch_kernels(
    robot: str, more: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    chain = builtin_chain(robot)
    targets = [forward(chain, q) for q in draws(robot, 40, seed=8)]
    unreachable = {"position": [9.0, 0.0, 0.0]}
    body = {"poses": [*map(as_pose, targets), unreachable], **more}
    calls = []

    def counted(*args: Any, **kwargs: Any) -> Any:
        calls.append(args)
        return inverse.inverse_kinematics(*args, **kwargs)

    monkeypatch.setattr("service.endpoints.ik.task.inverse_kinematics", counted)
    answer = task.ik(builtin_reference(robot), None, json.dumps(body).encode())
    assert isinstance(answer, bytes)
    assert len(calls) == 1, "the pose out of reach alone is looked at by itself"
    found = json.loads(answer)
    assert [item["index"] for item in found["unsolved"]] == [40]
    assert found["unsolved"][0]["code"] == "NO_IK_SOLUTION"
    assert found["solutions"][40] == []
    model = pin.buildModelFromXML(builtin_urdf(robot))
    data, frame = model.createData(), model.getFrameId(chain.tip_link)
    tolerance = 1e-6 if more.get("method") == "numeric" or "axes" in more else 1e-8
    for T, solutions in zip(targets, found["solutions"], strict=False):
        (solution,) = solutions
        q = np.array(solution["joints"])
        assert solution["within_limits"]
        assert (q >= chain.limits.lower).all()
        assert (q <= chain.limits.upper).all()
        full = pin.neutral(model)
        for name, value in zip(chain.joint_names, q, strict=True):
            full[model.joints[model.getJointId(name)].idx_q] = value
        pin.framesForwardKinematics(model, data, full)
        reached = data.oMf[frame].homogeneous
        np.testing.assert_allclose(reached[:3, 3], T[:3, 3], atol=tolerance)
        compared = reached[:3, :3] if "axes" not in more else reached[:3, 2]
        expected = T[:3, :3] if "axes" not in more else T[:3, 2]
        np.testing.assert_allclose(compared, expected, atol=2 * tolerance)
