"""Proofs of motions that are none of the robot's: refused with what is wrong, never answered."""

from typing import Any

import numpy as np
import pytest

import armwright as aw
from kinematics.arrays import Array
from planning.constraints.constraint_set import ConstraintSet
from planning.values.limits import EffortLimits

ROBOT = aw.load_robot("panda")
NAMES = ROBOT.chain.joint_names
HOME = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])


def motion(names: tuple[str, ...], q: Array, way: float = 0.1) -> aw.Trajectory:
    """A motion by ``way`` of each joint within 2 s, from rest to rest."""
    c = np.zeros((1, len(q), 6))
    c[0, :, 0] = q
    c[0, :, 3:] = way * np.array([10.0 / 2.0**3, -15.0 / 2.0**4, 6.0 / 2.0**5])
    return aw.Trajectory(names, np.array([0.0, 2.0]), c)


RIGHT = motion(NAMES, HOME)
UR = aw.load_robot("ur5e")


@pytest.mark.parametrize(
    ("names", "q"),
    [
        ((*NAMES, "extra"), np.append(HOME, 0.0)),
        (NAMES[:-1], HOME[:-1]),
        (NAMES[::-1], HOME),
        (tuple("abcdefg"), HOME),
    ],
)
def test_a_motion_of_other_joints_is_refused(names: tuple[str, ...], q: Array) -> None:
    with pytest.raises(aw.ArmwrightError, match="the trajectory is of the joints") as told:
        aw.certify(motion(names, q), ROBOT, aw.Scene())
    assert told.value.hint is not None
    assert ", ".join(NAMES) in told.value.hint


@pytest.mark.parametrize(
    "asked",
    [
        {"margin": -0.05},
        {"margin": np.nan},
        {"margin": np.inf},
        {"limits": aw.MotionLimits({"velocity": np.ones(6)})},
        {"limits": aw.MotionLimits({"jerk": np.ones(8)})},
        {"limits": aw.MotionLimits({}, EffortLimits(UR.chain, np.ones(6)))},
        {"constraints": ConstraintSet(UR.chain, (aw.ToolSpeedConstraint(1.0),))},
    ],
)
def test_limits_constraints_and_margins_of_no_such_robot_are_refused(asked: dict[str, Any]) -> None:
    assert aw.certify(RIGHT, ROBOT, aw.Scene()).verified
    with pytest.raises(aw.ArmwrightError):
        aw.certify(RIGHT, ROBOT, aw.Scene(), **asked)


@pytest.mark.parametrize(
    "bounds",
    [
        {"velocities": np.ones(7)},
        {"velocity": -np.ones(7)},
        {"velocity": np.ones((1, 7))},
        {"velocity": 1.0},
        {"velocity": ["1"] * 7},
    ],
)
def test_limits_that_are_none_can_not_be_made(bounds: dict[str, Any]) -> None:
    with pytest.raises(aw.ArmwrightError, match="limit"):
        aw.MotionLimits(bounds)
    with pytest.raises(aw.ArmwrightError, match="torque limits must be 7 positive numbers"):
        EffortLimits(ROBOT.chain, np.ones(6))


@pytest.mark.parametrize(
    ("position", "wrong", "cure"),
    [(1, "panda", "aw.load_robot('panda')"), (1, None, "load_robot"), (2, None, "aw.Scene()"),
     (0, HOME, "aw.retime")],
)  # fmt: skip
def test_arguments_of_another_type_are_named_with_what_to_give(
    position: int, wrong: Any, cure: str
) -> None:
    arguments: list[Any] = [RIGHT, ROBOT, aw.Scene()]
    arguments[position] = wrong
    with pytest.raises(aw.ArmwrightError, match="has to be a") as told:
        aw.certify(*arguments)
    assert cure in (told.value.hint or "")


def test_a_motion_out_of_all_limits_is_refused_at_once() -> None:
    """A million radians took ten minutes, though the limits were broken from the first instant."""
    certificate = aw.certify(motion(NAMES, HOME, 1e6), ROBOT, aw.Scene())
    assert not certificate.verified
    assert not certificate.proved.collisions
    assert certificate.min_clearance == -np.inf
    assert certificate.violation is not None
    assert certificate.violation.kind in ("position", "velocity", "acceleration", "jerk")
    assert "farther than 1000 rad" in certificate.proved.reasons[-1]
