"""Solutions of inverse kinematics as answers: limits, collisions, order, traces and many poses."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armwright_wire.robots.kinematics import GradientTrace, IkRequest
from kinematics.ik.gradient import Trace
from kinematics.ik.solution import IkSolution
from kinematics.robots import builtin_chain
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Sphere
from service.endpoints.attached_objects import RobotInScene
from service.endpoints.ik.answers import (
    all_in_collision,
    combined_answer,
    convergence_problem,
    solution_answer,
    trace_answer,
)
from service.endpoints.ik.task import CollisionCheck
from service.workers.result import TaskProblem
from tests.planning.scenes import HOME, builtin

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


def test_a_pose_reached_in_collision_only_carries_some_of_the_rejected() -> None:
    answers = [{"rejected_because": f"reason {i}"} for i in range(40)]
    problem = all_in_collision("hand", answers)
    assert "each of the 40 configurations" in problem.message
    assert problem.message.endswith("reason 0")
    assert problem.details["rejected"] == answers[:32]


def test_many_poses_say_so_where_time_ended_the_search_for_one() -> None:
    whole: Any = {"solutions": [], "deterministic": True}
    refused = TaskProblem("NO_IK_SOLUTION", "too late", None, {"deterministic": False})
    assert "deterministic" not in combined_answer([whole, whole])
    assert (
        combined_answer([whole, {"solutions": [], "deterministic": False}])["deterministic"]
        is False
    )
    assert combined_answer([refused, whole])["deterministic"] is False


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
