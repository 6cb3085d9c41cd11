"""Limits that a motion is held to, with their tolerances: values for planners and proof alike."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidOption
from kinematics.model.chain import Chain


@dataclass(frozen=True, slots=True, eq=False)
class EffortLimits:
    """Limits of joint torques and of the tool's speed.

    Args:
        chain: The robot with all that it carries.
        effort: Torque limits, shape (n,), inf where there is none [N m or N]; None for none. Dry
            friction is taken off them, and from the chain.
        tool_speed: Largest speed of the tip's origin [m/s]; None for none.

    Raises:
        InvalidOption: A limit is not positive, or their number is wrong.
    """

    chain: Chain
    effort: Array | None = None
    tool_speed: float | None = None

    def __post_init__(self) -> None:
        if self.tool_speed is not None and not 0.0 < self.tool_speed < np.inf:
            raise InvalidOption(
                f"the tool speed limit is {self.tool_speed}", hint="Give a positive number in m/s."
            )
        if self.effort is not None:
            object.__setattr__(self, "effort", frozen(self.effort))
            if self.effort.shape != (self.chain.n,) or not (self.effort > 0.0).all():
                raise InvalidOption(
                    f"the torque limits must be {self.chain.n} positive numbers, one a joint",
                    hint=f"The order is: {', '.join(self.chain.joint_names)}.",
                )
        friction = self.chain.coulomb_friction
        if self.effort is None or not friction.any():
            return
        # At its worst dry friction takes all of its value from a limit; what is left is a limit of
        # the torque without it, which is smooth.
        if not (self.effort > friction).all():
            raise InvalidOption(
                "the dry friction of a joint takes all of its torque limit",
                hint="Give a torque limit above the coulomb_friction of each joint.",
            )
        object.__setattr__(self, "effort", frozen(self.effort - friction))
        smooth = replace(self.chain, coulomb_friction=np.zeros(self.chain.n))
        object.__setattr__(self, "chain", smooth)


#: Quantities that have limits beside position.
_BOUNDED = ("velocity", "acceleration", "jerk")
#: A ratio of a value to its limit may exceed 1 by the rounding error of an extremum [-]; a position
#: may exceed its limit by as much [rad or m].
RATIO_TOLERANCE = 1e-9
#: Jump of the acceleration beyond which jerk is not bounded [rad/s^2 or m/s^2]. Pieces that meet to
#: rounding are nearer by thousands: of positions of 10 rad, a hundredth of a second apart, doubles
#: leave 1e-11. A controller that reads the motion at 1 kHz makes 1e-3 rad/s^3 of the jump, less
#: than a ten thousandth of the jerk that any arm is limited to.
JERK_JUMP = 1e-6


class LimitsBetween(NamedTuple):
    """Limits that hold beside others between two instants of a motion.

    Args:
        begin: The first instant [s].
        end: The last instant [s].
        limits: The limits.
    """

    begin: float
    end: float
    limits: "MotionLimits"


@dataclass(frozen=True, slots=True, eq=False)
class MotionLimits:
    """Limits that a motion is held to in place of the robot's.

    Args:
        bounds: Limits by quantity ("velocity", "acceleration", "jerk"), each of shape (n,); NaN and
            infinity bind nothing. A quantity that is not named has the robot's limits.
        effort: Limits of torque and tool speed; None for none.
        holds_jerk: Whether jerk is to be kept; else what exceeds its limits is told, no more.
        between: Limits that hold beside these between two instants.

    Raises:
        InvalidOption: There is no such quantity, or a limit is negative.
    """

    bounds: Mapping[str, Array] = field(default_factory=dict)
    effort: EffortLimits | None = None
    holds_jerk: bool = True
    between: tuple[LimitsBetween, ...] = ()

    def __post_init__(self) -> None:
        for name, given in self.bounds.items():
            row = np.asarray(given)
            if name not in _BOUNDED:
                raise InvalidOption(
                    f"there is no limit of {name!r}", hint=f"Name one of: {', '.join(_BOUNDED)}."
                )
            if row.ndim != 1 or row.dtype.kind not in "fiu" or (row < 0.0).any():
                raise InvalidOption(
                    f"the limits of {name} are not one number of 0 or more for each joint",
                    hint="Give an array (n,), inf for a joint without a limit.",
                )

    def check_lengths(self, joint_names: Sequence[str]) -> None:
        """Refuse limits of another number of joints.

        Raises:
            InvalidOption: There are more or fewer.
        """
        for one in self.between:
            one.limits.check_lengths(joint_names)
        for name, row in self.bounds.items():
            if len(row) != len(joint_names):
                raise InvalidOption(
                    f"limits.{name} has {len(row)} value(s) for {len(joint_names)} joints",
                    hint=f"The order is: {', '.join(joint_names)}.",
                )

    def check(self, chain: Chain) -> None:
        """Refuse limits of another number of joints, or of another robot.

        Raises:
            InvalidOption: They are none of this robot's.
        """
        self.check_lengths(chain.joint_names)
        if self.effort is not None and self.effort.chain.joint_names != chain.joint_names:
            raise InvalidOption(
                f"the limits of torque and tool speed are of robot {self.effort.chain.name!r}",
                hint=f"Make them for the joints {', '.join(chain.joint_names)}.",
            )


def position_excess(joint: str, value: float, limit: float) -> str:
    """Sentence that says by how much a joint is outside a limit of its position.

    Args:
        joint: Name of the joint.
        value: Position of the joint [rad or m].
        limit: The limit that it exceeds [rad or m].
    """
    which = "above its upper" if value > limit else "below its lower"
    return f"joint {joint!r} is at {value:.9g}, {abs(value - limit):.3g} {which} limit {limit:.9g}"
