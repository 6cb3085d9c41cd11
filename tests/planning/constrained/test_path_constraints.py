"""Path constraints at the start and the goals of a ball that slides: closed forms."""

import numpy as np
import pytest

from kinematics.errors import InvalidGoal
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.constrained.checker import ConstrainedChecker
from planning.constrained.path_constraints import (
    apply_path_constraints,
    check_widths,
    end_violation,
)
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.joint import JointConstraint
from planning.constraints.kinds.position import PositionConstraint
from planning.constraints.kinds.region import PlaneRegion
from planning.preflight_result import Ready
from planning.problem import JointGoal, Problem
from planning.result import Failure
from tests.planning.slider import slider

CHAIN = slider().chain
START = np.array([-0.5, 0.0])


def band(middle: float, half: float, weight: float | None = None) -> ConstraintSet:
    """The second slide stays within ``half`` of a middle."""
    return ConstraintSet(CHAIN, (JointConstraint("jy", middle, half, half, weight=weight),))


def applied(
    constraints: ConstraintSet | None, *goals: tuple[float, float]
) -> tuple[Ready, Ready | Failure]:
    ends = [np.array(goal) for goal in goals]
    joints = tuple(JointGoal(q) for q in ends)
    problem = Problem(slider(), Scene(), START, joints, constraints=constraints)
    ready = Ready(START, ends, (Checker.of(slider(), Scene()),), ("a note",))
    return ready, apply_path_constraints(problem, ready, 0)


def test_without_hard_constraints_nothing_changes() -> None:
    for constraints in (None, band(0.3, 0.1, weight=2.0)):
        ready, answer = applied(constraints, (0.5, 0.0))
        assert answer is ready
    failure = Failure("CODE", "why", "hint", "start")
    problem = Problem(slider(), Scene(), START, (JointGoal(START),), constraints=band(0.0, 0.1))
    assert apply_path_constraints(problem, failure, 0) is failure


def test_goals_that_violate_are_left_out_and_the_checker_knows_the_constraints() -> None:
    _, answer = applied(band(0.0, 0.1), (0.5, 0.3), (0.5, 0.05), (0.2, -0.4))
    assert isinstance(answer, Ready)
    (goal,) = answer.goals
    np.testing.assert_array_equal(goal, [0.5, 0.05])
    assert answer.notes == ("a note",)
    (checker,) = answer.checkers
    assert isinstance(checker, ConstrainedChecker)
    assert checker.free(START, goal)
    assert not checker.free(START, np.array([0.5, 0.3]))
    # Of the goal's 5 cm to spare two millimetres are kept back.
    assert checker.free(START, np.array([0.5, 0.0979]))
    assert not checker.free(START, np.array([0.5, 0.0981]))


def test_start_and_goals_that_violate_say_by_how_much() -> None:
    _, start = applied(band(0.3, 0.1), (0.5, 0.3))
    assert isinstance(start, Failure)
    assert start.code == "START_STATE_VIOLATES_PATH_CONSTRAINTS"
    assert start.details["residual"] == pytest.approx(0.2)
    assert (start.details["constraint"], start.stage) == (0, "start")
    _, goal = applied(band(0.0, 0.1), (0.5, 0.7), (0.5, -0.3))
    assert isinstance(goal, Failure)
    assert goal.code == "GOAL_VIOLATES_PATH_CONSTRAINTS"
    assert goal.details["residual"] == pytest.approx(0.2), "that of the goal that violates least"


def test_constraints_that_exclude_each_other_are_a_conflict() -> None:
    both = (JointConstraint("jy", 0.3, 0.1, 0.1), JointConstraint("jy", -0.3, 0.1, 0.1))
    _, answer = applied(ConstraintSet(CHAIN, both), (0.5, 0.3))
    assert isinstance(answer, Failure)
    assert answer.code == "INVALID_GOAL_CONSTRAINTS"
    assert answer.stage == "constraints"
    assert sorted(answer.details["constraints"]) == [0, 1]


def slab(half: float, weight: float | None = None) -> ConstraintSet:
    """The ball stays within ``half`` of a plane."""
    plane = PlaneRegion([0.0, 0.0, 0.0], [0.0, 1.0, 0.0], half)
    return ConstraintSet(CHAIN, (PositionConstraint(plane, weight=weight),))


def test_widths() -> None:
    check_widths(slab(1e-4))
    check_widths(slab(1e-6, weight=1.0))
    check_widths(band(0.0, 0.0))
    with pytest.raises(InvalidGoal, match="tolerance") as caught:
        check_widths(slab(5e-5))
    assert caught.value.details["relaxation"] == pytest.approx(5e-5)


def test_violations_at_an_end() -> None:
    assert end_violation(None, "goal", START) is None
    assert end_violation(band(0.0, 0.1), "goal", START) is None
    assert end_violation(band(0.3, 0.1, weight=1.0), "goal", START) is None
    failure = end_violation(band(0.3, 0.1), "goal", START)
    assert failure is not None
    assert failure.code == "GOAL_VIOLATES_PATH_CONSTRAINTS"
