"""Limits that a motion is held to, with their tolerances: values for planners and proof alike."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from kinematics.arrays import Array
from planning.effort_limits import EffortLimits

#: A ratio of a value to its limit may exceed 1 by the rounding error of an extremum [-]; a position
#: may exceed its limit by as much [rad or m].
RATIO_TOLERANCE = 1e-9
#: Jump of the acceleration beyond which jerk is not bounded [rad/s^2 or m/s^2]. Pieces that meet to
#: rounding are nearer by thousands: of positions of 10 rad, a hundredth of a second apart, doubles
#: leave 1e-11. A controller that reads the motion at 1 kHz makes 1e-3 rad/s^3 of the jump, less
#: than a ten thousandth of the jerk that any arm is limited to.
JERK_JUMP = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class MotionLimits:
    """Limits that a motion is held to in place of the robot's.

    Args:
        bounds: Limits by quantity ("velocity", "acceleration", "jerk"), each of shape (n,); NaN and
            infinity bind nothing. A quantity that is not named has the robot's limits.
        effort: Limits of torque and tool speed; None for none.
        holds_jerk: Whether jerk is to be kept; else what exceeds its limits is told, no more.
    """

    bounds: Mapping[str, Array] = field(default_factory=dict)
    effort: EffortLimits | None = None
    holds_jerk: bool = True


def position_excess(joint: str, value: float, limit: float) -> str:
    """Sentence that says by how much a joint is outside a limit of its position.

    Args:
        joint: Name of the joint.
        value: Its position [rad or m].
        limit: The limit that it exceeds [rad or m].
    """
    which = "above its upper" if value > limit else "below its lower"
    return f"joint {joint!r} is at {value:.9g}, {abs(value - limit):.3g} {which} limit {limit:.9g}"
