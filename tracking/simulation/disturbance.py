"""Disturbances that the controller does not know of, and encoder noise."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidOption, InvalidRobotState
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
        return _each(chain, "disturbance", self.torque), _each(chain, "amplitude", self.amplitude)

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


def _each(chain: Chain, name: str, value: ArrayLike) -> Array:
    if np.ndim(value) == 0:
        value = np.full(chain.n, value)
    checked = chain.configuration(value, name)
    if checked.shape != (chain.n,):
        raise InvalidRobotState(f"{name} is a batch; give one value for each joint")
    return checked
