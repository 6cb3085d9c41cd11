"""What is no constraint is refused, with words that say why."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from kinematics.errors import ArmwrightError, InvalidLinkName
from kinematics.robots import builtin_chain
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import Constraint
from planning.constraints.kinds.joint import JointConstraint
from planning.constraints.kinds.limit import (
    ClearanceConstraint,
    ToolSpeedConstraint,
    TorqueConstraint,
)
from planning.constraints.kinds.look_at import LookAtConstraint
from planning.constraints.kinds.orientation import ConeConstraint, OrientationConstraint
from planning.constraints.kinds.position import PositionConstraint
from planning.constraints.kinds.region import BoxRegion, LineRegion, PlaneRegion, SphereRegion
from planning.constraints.kinds.relative_pose import RelativePoseConstraint

CHAIN = builtin_chain("panda")
BALL = SphereRegion([0.4, 0.0, 0.4], 0.1)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: JointConstraint("panda_joint1", math.nan), "not finite"),
        (lambda: JointConstraint("panda_joint1", 0.0, -0.1), "tolerance_above"),
        (lambda: JointConstraint("elbow", 0.0), "no joint 'elbow'"),
        (lambda: PositionConstraint(BALL, link="nose"), "nose"),
        (lambda: PositionConstraint(BALL, link="panda_link0"), "does not move"),
        (lambda: PositionConstraint(BALL, "panda_hand", reference_link="panda_link7"), "not move"),
        (lambda: PositionConstraint(BALL, point=[0.0, 0.0]), "point"),
        (lambda: SphereRegion([0, 0, 0], -1.0), "radius"),
        (lambda: PlaneRegion([0, 0, 0], [0, 0, 0], 0.1), "normal"),
        (lambda: LineRegion([0, 0, 0], [0, 0, 1], 0.1, -1.0), "length"),
        (lambda: BoxRegion(np.eye(4), np.array([1.0, -1.0, 1.0])), "size"),
        (lambda: BoxRegion(np.eye(3), np.ones(3)), "pose"),
        (lambda: ConeConstraint([0, 0, 0], [0, 0, 1], 0.1), "axis"),
        (lambda: ConeConstraint([0, 0, 1], [0, 0, 1], 4.0), "cone_angle"),
        (lambda: OrientationConstraint(2.0 * np.eye(3), 0.1), "rotation"),
        (lambda: OrientationConstraint(np.eye(3), [0.1, 0.1]), "axis_tolerances"),
        (lambda: LookAtConstraint([0, 0, 1], [math.inf, 0, 0], 0.1), "target"),
        (lambda: RelativePoseConstraint(np.eye(4), position_tolerances=-1.0), "position_tol"),
        (lambda: ClearanceConstraint(-0.1), "margin"),
        (lambda: ToolSpeedConstraint(0.0), "tool speed"),
        (lambda: TorqueConstraint([1.0, -1.0]), "positive"),
        (lambda: TorqueConstraint([1.0]), "7 joints"),
        (lambda: ConeConstraint([0, 0, 1], [0, 0, 1], 0.1, weight=0.0), "weight"),
    ],
)
def test_malformed_constraints_are_refused(make: Callable[[], Constraint], words: str) -> None:
    with pytest.raises(ArmwrightError) as caught:
        ConstraintSet(CHAIN, (make(),))
    assert words in f"{caught.value.message} {caught.value.hint}"


def test_an_unknown_link_lists_those_there_are() -> None:
    with pytest.raises(InvalidLinkName) as caught:
        ConstraintSet(CHAIN, (ConeConstraint([0, 0, 1], [0, 0, 1], 0.1, link="nose"),))
    assert "panda_hand" in str(caught.value.hint)


def test_a_motion_s_limits_are_known_and_have_no_rows() -> None:
    limits = (ClearanceConstraint(0.02), ClearanceConstraint(0.01), ToolSpeedConstraint(0.5))
    made = ConstraintSet(CHAIN, (*limits, TorqueConstraint()))
    assert made.rows == ()
    assert (made.margin, made.tool_speed) == (0.02, 0.5)
    assert made.torque == TorqueConstraint()
    assert made.residuals(np.zeros(7)).shape == (0,)
    assert made.residuals(np.zeros((3, 7))).shape == (3, 0)


def test_free_axes_have_no_rows() -> None:
    upright = OrientationConstraint(np.eye(3), [0.1, 0.1, 4.0])
    assert len(ConstraintSet(CHAIN, (upright,)).rows) == 2
