"""Limits that path constraints themselves put on a motion: clearance, tool speed, torque.

The proof reads them from the constraints, whatever limits and margin it is handed: a planner that
forgets to pass one on must not be believed.
"""

import numpy as np

from kinematics.model.chain import Chain
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import (
    ClearanceConstraint,
    ToolSpeedConstraint,
    TorqueConstraint,
)
from planning.values.limits import EffortLimits


def constrained_margin(margin: float, constraints: ConstraintSet | None) -> float:
    """The larger of a margin and all clearances that constraints ask for [m]."""
    asked = constraints.constraints if constraints is not None else ()
    return max([margin, *(c.margin for c in asked if isinstance(c, ClearanceConstraint))])


def constrained_efforts(
    efforts: EffortLimits | None, constraints: ConstraintSet | None, chain: Chain
) -> EffortLimits | None:
    """The stricter of given effort limits and those of all constraints; None where there are none.

    Args:
        efforts: Limits of torque and tool speed, with what the robot carries.
        constraints: Constraints that the motion has to hold.
        chain: The robot, where no effort limits are given.

    Raises:
        MissingLimit: Torques are constrained to the robot's limits, and one is not known.
    """
    asked = constraints.constraints if constraints is not None else ()
    speeds = [c.limit for c in asked if isinstance(c, ToolSpeedConstraint)]
    torques = [
        chain.limits.require("effort", chain.joint_names) if c.limits is None else c.limits
        for c in asked
        if isinstance(c, TorqueConstraint)
    ]
    if not speeds and not torques:
        return efforts
    if efforts is not None and efforts.tool_speed is not None:
        speeds.append(efforts.tool_speed)
    if efforts is not None and efforts.effort is not None:
        # These have dry friction taken off already, and their chain has none.
        torques = [np.asarray(limit) - chain.coulomb_friction for limit in torques]
        torques.append(efforts.effort)
    return EffortLimits(
        chain if efforts is None else efforts.chain,
        np.min(np.array(torques, dtype=np.float64), axis=0) if torques else None,
        min(speeds, default=None),
    )
