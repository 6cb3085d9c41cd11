"""Motion of a gripper's fingers while the arm stands still, as a value."""

import math
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from kinematics.trajectory.trajectory import Trajectory
from kinematics.tree.fingers import Fingers, Positions

#: Largest first, second and third derivative of 10 s^3 - 15 s^4 + 6 s^5 for s from 0 to 1.
_PEAKS = (1.875, 10.0 / math.sqrt(3.0), 60.0)
_PROFILE = np.array([0.0, 0.0, 0.0, 10.0, -15.0, 6.0])


@dataclass(frozen=True, slots=True, eq=False)
class FingerMotion:
    """All fingers from rest to rest: q(t) = q_first + (10 s^3 - 15 s^4 + 6 s^5) dq, s = t / T.

    Args:
        fingers: The joints.
        first: Positions of all that lead at the beginning [rad or m].
        last: Positions at the end.
        duration: T [s].
        names: Joints that move, those that follow others among them.
    """

    fingers: Fingers
    first: Positions
    last: Positions
    duration: float
    names: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "first", MappingProxyType(dict(self.first)))
        object.__setattr__(self, "last", MappingProxyType(dict(self.last)))
        moving = self.fingers.moving(self.leaders)
        object.__setattr__(self, "names", tuple(finger.joint.name for finger in moving))

    @property
    def leaders(self) -> frozenset[str]:
        """Joints that lead and move."""
        return frozenset(name for name, at in self.first.items() if at != self.last[name])

    @property
    def trajectory(self) -> Trajectory:
        """The motion of the joints that move, in the order of ``names``."""
        moving = self.fingers.moving(self.leaders)
        first = np.array([finger.position(self.first) for finger in moving])
        way = np.array([finger.position(self.last) for finger in moving]) - first
        powers = self.duration ** -np.arange(len(_PROFILE), dtype=np.float64)
        coefficients = way[:, None] * (_PROFILE * powers)
        coefficients[:, 0] = first
        return Trajectory(self.names, np.array([0.0, self.duration]), coefficients[None])

    def time_of(self, share: float) -> float:
        """The time when a share of the way is done [s]."""
        rest = np.polynomial.Polynomial([-share, *_PROFILE[1:]])
        roots = rest.roots()
        real = roots.real[np.abs(roots.imag) < 1e-6]
        inside = real[(real >= -1e-9) & (real <= 1.0 + 1e-9)]
        return float(self.duration * np.clip(inside.min(initial=1.0), 0.0, 1.0))


def least_duration(fingers: Fingers, first: Positions, last: Positions) -> float:
    """Least duration of a motion within the limits of all joints that move [s]."""
    least = 0.0
    for name, at in first.items():
        way, (_, _, *rates) = abs(last[name] - at), fingers.limits(name)
        for order, (peak, rate) in enumerate(zip(_PEAKS, rates, strict=True), 1):
            if rate > 0.0:
                least = max(least, (peak * way / rate) ** (1.0 / order))
    return least
