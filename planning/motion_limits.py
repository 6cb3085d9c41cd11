"""Limits of tool speed and torque that constraints put on a motion."""

from dataclasses import replace

import numpy as np

from planning.constraints.constraint_set import ConstraintSet
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
