"""Failures of starts and goals: codes, sentences, and what a program can use."""

import numpy as np
import pytest

from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.preflight.failures import (
    Refusal,
    collision_failure,
    limit_failure,
    no_goal_failure,
    time_up_failure,
)
from planning.preflight.limits import snap_to_limits
from planning.problem import JointGoal, Problem
from planning.result import Failure
from tests.planning.scenes import box
from tests.planning.slider import slider

ROBOT = slider()
START, GOAL = np.array([-0.5, 0.0]), np.array([0.5, 0.0])
SCENE = Scene(
    (
        box("near", (0.1, 0.1, 0.4), (-0.5, 0.08, 0.0)),
        box("nearer", (0.1, 0.1, 0.4), (-0.5, -0.06, 0.0)),
    )
)


def failure(code: str, message: str = "it is bad") -> Failure:
    return Failure(code=code, message=message, hint="Do better.", stage="goal", details={"a": 1})


@pytest.mark.parametrize("end", ["start", "goal"])
def test_a_joint_outside_its_limit_is_named_with_value_and_limit(end: str) -> None:
    _, violation = snap_to_limits(ROBOT.chain, np.array([0.2, 1.5]), 1e-6)
    assert violation is not None
    told = limit_failure(end, violation)  # type: ignore[arg-type]
    assert told.code == f"{end.upper()}_STATE_INVALID"
    assert told.stage == end
    assert "'jy'" in told.message
    assert "1.5" in told.message
    assert told.details == violation.details


def test_of_two_overlaps_both_are_told_and_the_deeper_first() -> None:
    """The ball is 0.02 m inside one box and 0.04 m inside the other."""
    problem = Problem(ROBOT, SCENE, START, (JointGoal(GOAL),))
    told = collision_failure(problem, "start", START, ("ball", "near"), -1.0)
    assert told.code == "START_STATE_IN_COLLISION"
    pairs = {tuple(item["pair"]): item["depth"] for item in told.details["collisions"]}
    assert pairs[("ball", "nearer")] == pytest.approx(0.04, abs=1e-6)
    assert pairs[("ball", "near")] == pytest.approx(0.02, abs=1e-6)
    assert told.details["pair"] == ["ball", "nearer"]
    assert told.details["depth"] == pytest.approx(0.04, abs=1e-6)
    assert "overlap by 0.04 m" in told.message
    nearest = told.details["nearest_valid"]
    assert Checker.of(ROBOT, SCENE).valid(np.array(nearest["joints"]))
    assert nearest["distance"] >= 0.0399


def test_a_pair_nearer_than_its_margin_is_told_with_distance_and_margin() -> None:
    q = np.array([0.2, 0.0])
    wall = Scene((box("wall", (0.1, 1.0, 0.4), (0.32, 0.0, 0.0)),))
    problem = Problem(ROBOT, wall, q, (JointGoal(GOAL),), margin=0.05)
    clearance, pair = Checker.of(ROBOT, wall, 0.05).clearance(q)
    assert clearance == pytest.approx(-0.03, abs=1e-6) or clearance <= 0.0
    told = collision_failure(problem, "goal", q, pair, 0.02 - 0.05)
    assert told.code == "GOAL_IN_COLLISION"
    assert told.details["clearance"] == pytest.approx(0.02, abs=1e-6)
    assert told.details["margin"] == pytest.approx(0.05, abs=1e-6)
    assert told.details["depth"] == 0.0
    assert "nearer than their margin of 0.05 m" in told.message
    assert "touch" not in told.message


def test_time_that_was_up_says_how_far_it_came() -> None:
    told = time_up_failure(3, 8)
    assert (told.code, told.stage) == ("TIMED_OUT", "goal")
    assert "3 of 8" in told.message


def test_one_goal_alone_fails_as_it_is() -> None:
    own = failure("GOAL_IN_COLLISION")
    assert no_goal_failure([Refusal("GOAL_IN_COLLISION", lambda: own)]) is own


def test_of_several_goals_the_first_is_looked_into_and_all_are_counted() -> None:
    looked_at = []

    def refusal(code: str, number: int) -> Refusal:
        def look() -> Failure:
            looked_at.append(number)
            return failure(code)

        return Refusal(code, look)

    codes = ["NO_IK_SOLUTION", "GOAL_IN_COLLISION", "NO_IK_SOLUTION"]
    told = no_goal_failure([refusal(code, i) for i, code in enumerate(codes)])
    assert looked_at == [0]
    assert told.code == "NO_IK_SOLUTION"
    assert told.message == "none of 3 goals is valid; the first: it is bad"
    assert told.details == {"a": 1, "goals": {"NO_IK_SOLUTION": 2, "GOAL_IN_COLLISION": 1}}
