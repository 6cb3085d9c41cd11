"""Requirements on an optimised motion: ends, limits, obstacles."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array, frozen
from kinematics.model.chain import Chain
from obstacles.collision.checker import Checker
from planning.constraints.constraint_set import ConstraintSet
from planning.values.limits import EffortLimits


class Obstruction(NamedTuple):
    """Obstruction that keeps a motion from being found.

    Args:
        message: Description of what is violated, and by how much.
        hint: Remedy.
    """

    message: str
    hint: str


@dataclass(frozen=True, slots=True, eq=False)
class End:
    """State at an end of a motion.

    Args:
        position: Shape (n,).
        velocity: Shape (n,).
        acceleration: Shape (n,); None where any will do.
    """

    position: Array
    velocity: Array
    acceleration: Array | None = None

    def __post_init__(self) -> None:
        for name in ("position", "velocity"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        if self.acceleration is not None:
            object.__setattr__(self, "acceleration", frozen(self.acceleration))

    @classmethod
    def at_rest(cls, position: Array, *, smooth: bool) -> "End":
        """At rest, where ``smooth`` without acceleration."""
        none = np.zeros_like(position)
        return cls(position, none, none if smooth else None)

    @property
    def still(self) -> bool:
        """Whether it is at rest, whatever time is scaled by."""
        return not self.velocity.any() and (
            self.acceleration is None or not self.acceleration.any()
        )

    @property
    def order(self) -> int:
        """The highest derivative that is given."""
        return 1 if self.acceleration is None else 2

    @property
    def derivatives(self) -> list[Array]:
        """Position, velocity and, where it is given, acceleration."""
        found = [self.position, self.velocity]
        return found if self.acceleration is None else [*found, self.acceleration]


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """Requirements on an optimised motion.

    Args:
        checker: The robot in its scene.
        start: How the motion begins.
        end: State at the end.
        bounds: Limits of velocity, acceleration and perhaps jerk, shape (n,) each, by quantity.
        loads: Limits of torque and tool speed.
        constraints: Constraints that every configuration on the way has to hold.
        soft: Soft constraints: what they are violated by costs something.
        loaded_chain: The robot with all that it carries, for the energy objective.
    """

    checker: Checker
    start: End
    end: End
    bounds: Mapping[str, Array]
    loads: EffortLimits | None = None
    constraints: ConstraintSet | None = None
    loaded_chain: Chain | None = field(default=None, repr=False)
    soft: ConstraintSet | None = None

    @property
    def chain(self) -> Chain:
        """The robot."""
        return self.checker.model.robot.chain

    @property
    def still(self) -> bool:
        """Whether it begins and ends at rest, so that time can be scaled."""
        return self.start.still and self.end.still

    @property
    def orders(self) -> dict[int, Array]:
        """The limits by the order of the derivative."""
        names = ("velocity", "acceleration", "jerk")
        found = {k: self.bounds[name] for k, name in enumerate(names, 1) if name in self.bounds}
        return {k: limits for k, limits in found.items() if np.isfinite(limits).any()}
