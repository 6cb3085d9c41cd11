"""Problems as values: refusals, hashes, and limits that constraints put on motions."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from kinematics.errors import InvalidGoal, InvalidRobotState
from obstacles.scenes.scene import Scene
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import (
    ClearanceConstraint,
    JointConstraint,
    ToolSpeedConstraint,
    TorqueConstraint,
)
from planning.options import Options, with_limits
from planning.problem import JointGoal, PoseGoal, Problem
from planning.timing.options import TimingOptions
from tests.planning.scenes import box, builtin
from tests.planning.slider import slider

ROBOT = slider()
CHAIN = ROBOT.chain
START, GOAL = np.array([-0.5, 0.1]), np.array([0.5, 0.1])
RATES = np.array([0.1, 0.0])
PLAIN = Problem(ROBOT, Scene(), START, (JointGoal(GOAL),))
POSE = np.eye(4)


def problem(**changes: Any) -> Problem:
    given: dict[str, Any] = {"robot": ROBOT, "scene": Scene(), "start": START}
    return Problem(**{**given, "goals": (JointGoal(GOAL),), **changes})


def held(*constraints: Any) -> ConstraintSet:
    return ConstraintSet(CHAIN, constraints)


@pytest.mark.parametrize(
    "changes",
    [
        {"scene": Scene((box("box", (0.1, 0.1, 0.1), (0.0, 0.9, 0.0)),))},
        {"start": START + np.array([1e-12, 0.0])},
        {"goals": (JointGoal(GOAL + np.array([0.0, 1e-12])),)},
        {"goals": (JointGoal(GOAL), JointGoal(GOAL))},
        {"goals": (JointGoal(GOAL, velocity=RATES),)},
        {"goals": (JointGoal(GOAL, velocity=np.zeros(2), acceleration=RATES),)},
        {"goals": (PoseGoal(POSE),)},
        {"goals": (PoseGoal(POSE, 2e-4),)},
        {"goals": (PoseGoal(POSE, 1e-4, 2e-3),)},
        {"margin": 1e-6},
        {"start_state_tolerance": 1e-3},
        {"constraints": held(JointConstraint("jx", 0.0, 1.0, 1.0))},
        {"constraints": held(JointConstraint("jx", 0.0, 1.0, 1.0, 2.0))},
        {"start_velocity": RATES},
        {"start_velocity": RATES, "start_acceleration": np.zeros(2)},
        {"start_velocity": RATES, "start_acceleration": RATES},
    ],
)
def test_whatever_changes_the_question_changes_its_hash(changes: dict[str, Any]) -> None:
    changed = problem(**changes)
    assert changed.content_hash != PLAIN.content_hash
    assert changed.content_hash == problem(**changes).content_hash


def test_goals_in_another_order_are_another_question() -> None:
    one, two = JointGoal(GOAL), JointGoal(-GOAL)
    assert problem(goals=(one, two)).content_hash != problem(goals=(two, one)).content_hash


@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        ({"goals": ()}, InvalidGoal, "no goal"),
        ({"margin": -1e-9}, InvalidGoal, "margin"),
        ({"margin": np.nan}, InvalidGoal, "margin"),
        ({"margin": np.inf}, InvalidGoal, "margin"),
        ({"start": np.zeros(3)}, InvalidRobotState, "start.joints"),
        ({"start": np.array([0.0, np.nan])}, InvalidRobotState, "start.joints"),
        ({"goals": (JointGoal(np.zeros(1)),)}, InvalidRobotState, "goal.joints"),
        ({"start_velocity": np.zeros(3)}, InvalidRobotState, "start.velocities"),
        ({"start_velocity": [np.inf, 0.0]}, InvalidRobotState, "start.velocities"),
        ({"start_acceleration": np.zeros(1)}, InvalidRobotState, "start.accelerations"),
    ],
)
def test_what_is_no_question_is_refused(
    changes: dict[str, Any], error: type[Exception], words: str
) -> None:
    with pytest.raises(error, match=words):
        problem(**changes)


@pytest.mark.parametrize(
    ("changes", "moving"),
    [
        ({}, False),
        ({"start_velocity": np.zeros(2)}, False),
        ({"start_velocity": RATES}, True),
        ({"start_acceleration": RATES}, True),
        ({"goals": (JointGoal(GOAL), JointGoal(START, velocity=RATES))}, True),
        ({"goals": (JointGoal(GOAL, velocity=np.zeros(2)),)}, False),
    ],
)
def test_it_moves_where_any_end_has_a_velocity_or_acceleration(
    changes: dict[str, Any], moving: bool
) -> None:
    assert problem(**changes).moving is moving


def test_the_clearance_of_constraints_raises_the_margin_and_never_lowers_it() -> None:
    for given, margin in ((0.0, 0.03), (0.01, 0.03), (0.05, 0.05)):
        raised = problem(
            margin=given, constraints=held(ClearanceConstraint(0.02), ClearanceConstraint(0.03))
        )
        assert raised.margin == margin
    assert replace(PLAIN, margin=0.04).margin == 0.04


PANDA = builtin("panda").chain
EFFORT = np.array(PANDA.limits.effort)


def constraints(*items: ToolSpeedConstraint | TorqueConstraint) -> ConstraintSet:
    return ConstraintSet(PANDA, items)


@pytest.mark.parametrize(("asked", "least"), [(None, 0.3), (0.2, 0.2), (0.5, 0.3)])
def test_the_lower_tool_speed_counts(asked: float | None, least: float) -> None:
    options = Options(timing=TimingOptions(tool_speed=asked))
    limited = with_limits(options, constraints(ToolSpeedConstraint(0.3)))
    assert limited.timing.tool_speed == least
    assert not limited.timing.torque_limits
    assert with_limits(options, None) is options


def test_torque_constraints_turn_torque_limits_on_and_only_lower_them() -> None:
    plain = with_limits(Options(), constraints(TorqueConstraint()))
    assert plain.timing.torque_limits
    assert "effort" not in plain.limits
    lower = 0.5 * EFFORT
    lower[0] = 2.0 * EFFORT[0]
    options = Options(limits={"effort": EFFORT})
    limited = with_limits(options, constraints(TorqueConstraint(tuple(lower))))
    np.testing.assert_array_equal(limited.limits["effort"], np.minimum(lower, EFFORT))
