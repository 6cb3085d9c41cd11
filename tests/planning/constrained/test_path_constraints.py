"""Path constraints of a ball that slides: ends, widths, and by how much they have to give."""

import numpy as np
import pytest

from kinematics.errors import InvalidGoal
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.constrained.checker import ConstrainedChecker
from planning.constrained.path_constraints import (
    Relaxation,
    apply_path_constraints,
    check_widths,
    find_relaxation,
)
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import JointConstraint, PositionConstraint
from planning.constraints.kinds.region import PlaneRegion
from planning.planner import Ready
from planning.problem import JointGoal, Problem
from planning.result import Failure
from planning.values.deadline import Deadline
from tests.planning.scenes import box
from tests.planning.slider import slider

SLIDER = slider().chain
BEGIN = np.array([-0.5, 0.0])


def band(middle: float, half: float, weight: float | None = None) -> ConstraintSet:
    """The second slide stays within ``half`` of a middle."""
    return ConstraintSet(SLIDER, (JointConstraint("jy", middle, half, half, weight=weight),))


def applied(
    constraints: ConstraintSet | None, *goals: tuple[float, float]
) -> tuple[Ready, Ready | Failure]:
    ends = [np.array(goal) for goal in goals]
    joints = tuple(JointGoal(q) for q in ends)
    problem = Problem(slider(), Scene(), BEGIN, joints, constraints=constraints)
    ready = Ready(BEGIN, ends, (Checker.of(slider(), Scene()),), ("a note",))
    return ready, apply_path_constraints(problem, ready, 0)


def test_without_hard_constraints_nothing_changes() -> None:
    for constraints in (None, band(0.3, 0.1, weight=2.0)):
        ready, answer = applied(constraints, (0.5, 0.0))
        assert answer is ready
    failure = Failure("CODE", "why", "hint", "start")
    problem = Problem(slider(), Scene(), BEGIN, (JointGoal(BEGIN),), constraints=band(0.0, 0.1))
    assert apply_path_constraints(problem, failure, 0) is failure


def test_goals_that_violate_are_left_out_and_the_checker_knows_the_constraints() -> None:
    _, answer = applied(band(0.0, 0.1), (0.5, 0.3), (0.5, 0.05), (0.2, -0.4))
    assert isinstance(answer, Ready)
    (goal,) = answer.goals
    np.testing.assert_array_equal(goal, [0.5, 0.05])
    assert answer.notes == ("a note",)
    (checker,) = answer.checkers
    assert isinstance(checker, ConstrainedChecker)
    assert checker.free(BEGIN, goal)
    assert not checker.free(BEGIN, np.array([0.5, 0.3]))
    # Of the goal's 5 cm to spare two millimetres are kept back.
    assert checker.free(BEGIN, np.array([0.5, 0.0979]))
    assert not checker.free(BEGIN, np.array([0.5, 0.0981]))


def slab(half: float, weight: float | None = None) -> ConstraintSet:
    """The ball stays within ``half`` of a plane."""
    plane = PlaneRegion([0.0, 0.0, 0.0], [0.0, 1.0, 0.0], half)
    return ConstraintSet(SLIDER, (PositionConstraint(plane, weight=weight),))


def test_widths() -> None:
    check_widths(slab(1e-4))
    check_widths(slab(1e-6, weight=1.0))
    check_widths(band(0.0, 0.0))
    with pytest.raises(InvalidGoal, match="tolerance") as caught:
        check_widths(slab(5e-5))
    assert caught.value.details["relaxation"] == pytest.approx(5e-5)


START, GOAL = np.array([-0.5, 0.0]), np.array([0.5, 0.0])
#: A wall that ends at y = 0.2: the ball of 5 cm gets round it at y > 0.25.
WALL = Scene((box("wall", (0.1, 0.8, 0.4), (0.0, -0.2, 0.0)),))
BAND = JointConstraint("jy", 0.0, 0.1, 0.1)
WIDE = JointConstraint("jx", 0.0, 0.8, 0.8)


def relaxation(scene: Scene, *constraints: JointConstraint, seconds: float = 1.5) -> Relaxation:
    hard = ConstraintSet(SLIDER, constraints)
    model = Checker.of(slider(), scene).model
    checker = ConstrainedChecker(model, 0.0, constraints=hard, spare=np.zeros(len(hard.rows)))
    return find_relaxation(checker, START, [GOAL], 0, Deadline.after(seconds))


def test_the_constraint_that_bars_the_way_is_named_with_what_it_lacks() -> None:
    answer = relaxation(WALL, BAND, WIDE)
    assert answer.constraints == (0,)
    # Past the wall's end 25 cm up, of which the constraint allows 10.
    assert 0.15 <= answer.wider[0] <= 0.95
    assert answer.units == ("m",)
    assert "widened" in answer.sentence
    assert answer.details["constraints_that_unblock"] == [0]
    assert answer.details["way_without_obstacles"] is True
    assert "Without the obstacles there is a way." in answer.sentence


def test_a_constraint_that_the_start_violates_lacks_exactly_that() -> None:
    answer = relaxation(Scene(), JointConstraint("jy", 0.3, 0.1, 0.1), WIDE)
    assert answer.constraints == (0,)
    assert answer.wider[0] == pytest.approx(0.2)
    assert answer.without_obstacles is None


def test_it_says_where_obstacles_are_not_to_blame() -> None:
    answer = relaxation(WALL, JointConstraint("jy", 0.6, 0.1, 0.1), WIDE, seconds=2.0)
    assert answer.constraints == (0,)
    assert answer.without_obstacles is False
    assert "Without the obstacles no way was found either." in answer.sentence


def test_widening_by_nothing_is_not_told_as_a_number() -> None:
    answer = Relaxation((1,), ("joint",), (0.0,), ("m",))
    assert "widened by very little" in answer.sentence
    assert "0 m" not in answer.sentence


def test_where_no_constraint_helps_it_says_so() -> None:
    shut = Scene((box("wall", (0.1, 3.0, 0.4), (0.0, 0.0, 0.0)),))
    answer = relaxation(shut, BAND, WIDE, seconds=0.4)
    assert answer.constraints == ()
    assert "did not help" in answer.sentence
