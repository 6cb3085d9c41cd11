"""Tours whose legs hold constraints: seen from outside, by kinematics at many instants."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import armwright as aw
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.limit import ClearanceConstraint, ToolSpeedConstraint
from planning.constraints.kinds.orientation import ConeConstraint
from planning.options import Options
from planning.result import Failure
from planning.tours.planner import plan_tour
from planning.tours.problem import TourGoal, TourOptions, TourProblem
from planning.tours.result import Tour
from tests.planning.tours.test_planner import START, pose
from tests.planning.tours.test_planner import problem as problem  # noqa: PLC0414

#: Half the angle of the cone about the direction of the tool [rad].
CONE = 0.6
#: To the side and down: straight joint motions do not keep a tool there.
ASIDE = np.array([0.0, np.sin(0.7), -np.cos(0.7)])
KEPT = ConeConstraint((0.0, 0.0, 1.0), ASIDE, CONE)


def aside(x: float, y: float, z: float) -> aw.PoseGoal:
    T = np.array(pose(x, y, z).T_base_tip)
    T[:3, 2], T[:3, 0] = ASIDE, (1.0, 0.0, 0.0)
    T[:3, 1] = np.cross(T[:3, 2], T[:3, 0])
    return aw.PoseGoal(T)


def few(problem: TourProblem, *constraints: object) -> TourProblem:
    """Three goals near and far, low and high, the tool aside at each."""
    rules = ConstraintSet(problem.robot.chain, constraints)  # type: ignore[arg-type]
    places = ((0.3, -0.45, 0.2), (0.6, -0.2, 0.2), (0.35, -0.45, 0.6))
    found = [
        aw.ik(problem.robot, aside(*place).T_base_tip, seed_joints=START).solutions
        for place in places
    ]
    goals = tuple(TourGoal(str(k), (aw.JointGoal(s[0].joints),)) for k, s in enumerate(found))
    return replace(problem, start=None, end="any", goals=goals, constraints=rules)


def test_every_leg_keeps_the_tool_aside_and_slow(problem: TourProblem) -> None:
    slow = few(problem, KEPT, ToolSpeedConstraint(0.3), ClearanceConstraint(0.01))
    assert slow.margin == 0.01
    tour = plan_tour(slow, TourOptions(Options(timeout=60.0), rounds=0))
    assert isinstance(tour, Tour), tour
    assert sorted(tour.order) == [0, 1, 2]
    cosine = np.cos(CONE)
    for leg in tour.legs:
        times = np.linspace(0.0, leg.trajectory.duration, 60)
        poses = [aw.fk(slow.robot, q) for q in leg.trajectory.sample(times)]
        assert min(ASIDE @ T[:3, 2] for T in poses) >= cosine - 1e-9
        points = np.array([T[:3, 3] for T in poses])
        speed = np.linalg.norm(np.diff(points, axis=0), axis=1) / np.diff(times)
        assert speed.max() <= 0.3 + 1e-9
        assert leg.certificate.path_constraints
        assert leg.certificate.min_clearance >= 0.0
    for before, after in pairwise(tour.legs):
        assert np.abs(before.trajectory.end - after.trajectory.start).max() < 1e-9


def test_without_the_constraint_the_tool_does_not_keep_aside(problem: TourProblem) -> None:
    """What the test above sees is the constraint's doing."""
    tour = plan_tour(replace(few(problem, KEPT), constraints=None))
    assert isinstance(tour, Tour)
    instants = [
        float(ASIDE @ aw.fk(problem.robot, q)[:3, 2])
        for leg in tour.legs
        for q in leg.trajectory.sample(np.linspace(0.0, leg.trajectory.duration, 60))
    ]
    assert min(instants) < np.cos(CONE)


def test_ends_and_goals_that_violate_it_are_named(problem: TourProblem) -> None:
    held = few(problem, KEPT)
    failure = plan_tour(replace(held, start=START))
    assert isinstance(failure, Failure)
    assert failure.code == "START_STATE_VIOLATES_PATH_CONSTRAINTS"
    failure = plan_tour(replace(held, end=START))
    assert isinstance(failure, Failure)
    assert (failure.code, failure.stage) == ("GOAL_VIOLATES_PATH_CONSTRAINTS", "end")
    assert "the end of the tour" in failure.message
    up = np.array(pose(0.4, 0.3, 0.4).T_base_tip)
    up[:3, :3] = np.diag([1.0, 1.0, 1.0])
    goals = (replace(held.goals[0], alternatives=(aw.PoseGoal(up),)), *held.goals[1:])
    failure = plan_tour(replace(held, goals=goals))
    assert isinstance(failure, Failure)
    unvisited = failure.details["unvisited"]
    assert [one["index"] for one in unvisited] == [0]


@pytest.mark.parametrize("width", [1e-6])
def test_a_constraint_too_thin_for_a_motion_is_refused(problem: TourProblem, width: float) -> None:
    thin = few(problem, ConeConstraint((0.0, 0.0, 1.0), ASIDE, width))
    with pytest.raises(aw.ArmwrightError, match="at least are needed"):
        plan_tour(thin)
