"""Stops of the joints at their position limits: Hunt and Crossley's model of contact.

A joint that is pressed p > 0 into its stop feels

    s = -k p max(0, 1 + c p_dot)

away from the stop: a spring k, whose force loses energy while it is pressed in, and never pulls.
The force is continuous, so that the integrator needs no events. An impact at speed v is left at
about v / (1 + 2 c v / 3) for small c v.
Source: "Coefficient of restitution interpreted as damping in vibroimpact".
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.model.chain import Chain

#: Stiffness of a stop [N m/rad or N/m]: an impact of 1 kg m^2 at 1 rad/s presses it 10 mrad in.
STIFFNESS = 1e4
#: Dissipation of a stop [s/rad or s/m]: an impact at 1 rad/s keeps about a fifth of its speed.
DISSIPATION = 5.0


@dataclass(frozen=True, slots=True)
class JointStops:
    """Stops of all joints at their position limits.

    Args:
        stiffness: k, positive [N m/rad or N/m].
        dissipation: c, not negative [s/rad or s/m].

    Raises:
        InvalidOption: A value is out of its range.
    """

    stiffness: float = STIFFNESS
    dissipation: float = DISSIPATION

    def __post_init__(self) -> None:
        if not 0.0 < self.stiffness < math.inf:
            raise InvalidOption(
                f"the stiffness of the joint stops is {self.stiffness}",
                hint="Give a positive finite number [N m/rad or N/m].",
            )
        if not 0.0 <= self.dissipation < math.inf:
            raise InvalidOption(
                f"the dissipation of the joint stops is {self.dissipation}",
                hint="Give a finite number that is not negative [s/rad or s/m].",
            )


class StopArrays(NamedTuple):
    """Stops as arrays.

    Args:
        lower: Positions of the lower stops, shape (n,) [rad or m]; -inf where there is none.
        upper: Positions of the upper stops, shape (n,) [rad or m]; inf where there is none.
        stiffness: k of all of them [N m/rad or N/m].
        dissipation: c of all of them [s/rad or s/m].
    """

    lower: Array
    upper: Array
    stiffness: float
    dissipation: float


def stop_arrays(chain: Chain, stops: JointStops | None) -> StopArrays:
    """The stops of a robot's joints as arrays; stops at infinity where there are none."""
    if stops is None:
        far = np.full(chain.n, np.inf)
        return StopArrays(-far, far, STIFFNESS, DISSIPATION)
    lower, upper = np.array(chain.limits.lower), np.array(chain.limits.upper)
    return StopArrays(lower, upper, stops.stiffness, stops.dissipation)


@kernel
def add_stops(stops: StopArrays, q: Array, qd: Array, torque: Array) -> None:
    """Add the torques of the stops at positions q and velocities qd to ``torque`` (n,)."""
    for i in range(q.shape[0]):
        if q[i] > stops.upper[i]:
            size = max(0.0, 1.0 + stops.dissipation * qd[i])
            torque[i] -= stops.stiffness * (q[i] - stops.upper[i]) * size
        elif q[i] < stops.lower[i]:
            size = max(0.0, 1.0 - stops.dissipation * qd[i])
            torque[i] += stops.stiffness * (stops.lower[i] - q[i]) * size
