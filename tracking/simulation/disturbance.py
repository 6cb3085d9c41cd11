"""Disturbances that the controller does not know of, encoder noise, and stops of the joints.

Stops at the position limits follow Hunt and Crossley's model of contact.
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
from numpy.typing import ArrayLike

from compiled.kernel import kernel
from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidOption
from kinematics.model.chain import Chain


@dataclass(frozen=True, slots=True, eq=False)
class Disturbance:
    """Torque at the joints: torque + amplitude sin(2 pi frequency t), from ``start`` to ``end``.

    Args:
        torque: Constant part, shape (n,) [N m or N].
        amplitude: Amplitude of the periodic part, shape (n,) [N m or N].
        frequency: Frequency of the periodic part [Hz].
        wrench: F = [f; n] that acts on the tip, in the base frame, shape (6,) [N, N m].
        start: Begin of the disturbance [s].
        end: End of the disturbance [s].

    Raises:
        InvalidOption: A value is not finite, the frequency is negative, or it ends before it
            begins.
    """

    torque: ArrayLike = 0.0
    amplitude: ArrayLike = 0.0
    frequency: float = 0.0
    wrench: ArrayLike = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    start: float = 0.0
    end: float = math.inf

    def __post_init__(self) -> None:
        for name in ("torque", "amplitude", "wrench"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        if np.shape(self.wrench) != (6,) or not np.isfinite(self.wrench).all():
            raise InvalidOption("wrench must be six finite numbers [fx, fy, fz, nx, ny, nz]")
        if not (math.isfinite(self.frequency) and self.frequency >= 0.0):
            raise InvalidOption(f"the frequency of a disturbance is {self.frequency} Hz")
        if not 0.0 <= self.start < self.end:
            raise InvalidOption(
                f"a disturbance lasts from {self.start} s to {self.end} s",
                hint="Give a start that is not negative, and an end after it.",
            )

    def parts(self, chain: Chain) -> tuple[Array, Array]:
        """Constant part and amplitude for the joints of a robot, both (n,).

        Raises:
            InvalidRobotState: A part has the wrong length or is not finite.
        """
        torque, amplitude = self.torque, self.amplitude
        return chain.each_joint(torque, "disturbance"), chain.each_joint(amplitude, "amplitude")

    def cuts(self, duration: float) -> list[float]:
        """Times within (0, duration) at which it begins or ends."""
        return [t for t in (self.start, self.end) if 0.0 < t < duration]


@dataclass(frozen=True, slots=True)
class EncoderNoise:
    """Independent normal errors of the state that the controller measures.

    They are drawn anew each control period, and for a continuous controller each ``period``.

    Args:
        position: Standard deviation [rad or m].
        velocity: Standard deviation [rad/s or m/s].
        seed: Seed of the random generator: the same seed makes the same errors.
        period: Period of the errors for a continuous controller [s].

    Raises:
        InvalidOption: A deviation is negative, a value not finite, or the period not positive.
    """

    position: float = 0.0
    velocity: float = 0.0
    seed: int = 0
    period: float = 1e-3

    def __post_init__(self) -> None:
        for name in ("position", "velocity"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InvalidOption(
                    f"the {name} noise of the encoders is {value}",
                    hint="Give a standard deviation that is not negative.",
                )
        if not (math.isfinite(self.period) and self.period > 0.0):
            raise InvalidOption(f"the period of the encoders is {self.period} s")
        if self.seed < 0:
            raise InvalidOption(f"the seed of the encoders is {self.seed}", hint="Give one >= 0.")

    def draw(self, count: int, n: int) -> Array:
        """Errors of q and q_dot for ``count`` periods, shape (count, 2, n)."""
        errors = np.random.default_rng(self.seed).standard_normal((count, 2, n))
        return np.asarray(errors * np.array([[self.position], [self.velocity]]))


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
