"""The kinds of constraints there are."""

from planning.constraints.joint import JointConstraint
from planning.constraints.limit import ClearanceConstraint, ToolSpeedConstraint, TorqueConstraint
from planning.constraints.look_at import LookAtConstraint
from planning.constraints.orientation import ConeConstraint, OrientationConstraint
from planning.constraints.position import PositionConstraint
from planning.constraints.relative_pose import RelativePoseConstraint

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
