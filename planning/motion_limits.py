"""Limits of tool speed and torque that constraints put on a motion."""

from dataclasses import replace

import numpy as np

from kinematics.chain import Chain
from planning.constraints.constraint_set import ConstraintSet
from planning.effort_limits import EffortLimits
from planning.options import Options


def with_limits(options: Options, constraints: ConstraintSet | None) -> Options:
    """Options whose timing keeps the constraints on tool speed and torque."""
    if constraints is None:
        return options
    timing, limits = options.timing, dict(options.limits)
    if constraints.tool_speed is not None:
        speed = min(constraints.tool_speed, timing.tool_speed or np.inf)
        timing = replace(timing, tool_speed=speed)
    if constraints.torque is not None:
        timing = replace(timing, torque_limits=True)
        if constraints.torque.limits is not None:
            given = np.array(constraints.torque.limits)
            limits["effort"] = np.minimum(given, limits.get("effort", np.inf))
    return replace(options, timing=timing, limits=limits)


def limit_loads(
    loads: EffortLimits | None, constraints: ConstraintSet | None, chain: Chain
) -> EffortLimits | None:
    """Loads that a foreign motion is held to, those of its constraints included.

    Raises:
        MissingLimit: Torques are constrained, and a joint's effort limit is not known.
    """
    if constraints is None or (constraints.tool_speed is None and constraints.torque is None):
        return loads
    effort = None if loads is None else loads.effort
    if constraints.torque is not None:
        own = constraints.torque.limits
        limits = chain.limits
        given = limits.require("effort", chain.joint_names) if own is None else np.array(own)
        effort = given if effort is None else np.minimum(effort, given)
    speed = None if loads is None else loads.tool_speed
    speeds = [value for value in (speed, constraints.tool_speed) if value is not None]
    return EffortLimits(chain if loads is None else loads.chain, effort, min(speeds, default=None))
