"""Limits of joint torques and of the tool's speed, as a value."""

from dataclasses import dataclass, replace

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
