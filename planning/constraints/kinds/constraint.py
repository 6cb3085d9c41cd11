"""The kinds of constraints there are."""

from planning.constraints.kinds.joint import JointConstraint
from planning.constraints.kinds.limit import (
    ClearanceConstraint,
    ToolSpeedConstraint,
    TorqueConstraint,
)
from planning.constraints.kinds.look_at import LookAtConstraint
from planning.constraints.kinds.orientation import ConeConstraint, OrientationConstraint
from planning.constraints.kinds.position import PositionConstraint
from planning.constraints.kinds.relative_pose import RelativePoseConstraint

#: Constraints on where the robot is, which have rows.
Geometric = (
    JointConstraint
    | PositionConstraint
    | ConeConstraint
    | OrientationConstraint
    | LookAtConstraint
    | RelativePoseConstraint
)
Constraint = Geometric | ClearanceConstraint | ToolSpeedConstraint | TorqueConstraint
