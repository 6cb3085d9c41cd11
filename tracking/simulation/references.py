"""References of a controller: a trajectory, extended by rest; holds, steps, sines and splines."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory, interpolate
from tracking.controllers.controller import Reference

#: Pieces in a period of the fastest sine, each a Taylor polynomial of the degree below: positions
#: are those of the sine to 3e-17 of its amplitude, accelerations to 3e-14 of theirs.
_PIECES = 16
_DEGREE = 13
#: Most pieces: as many events for the integrator.
_MOST_PIECES = 20_000


def hold(chain: Chain, position: ArrayLike, duration: float) -> Trajectory:
    """A reference that stands still at ``position`` (n,) [rad or m] for ``duration`` [s].

    Raises:
        InvalidRobotState: The position has the wrong length or is not finite.
    """
    q = chain.each_joint(position, "reference.joints")
    return Trajectory(chain.joint_names, np.array([0.0, duration]), q[None, :, None])


def step(chain: Chain, start: ArrayLike, end: ArrayLike, at: float, duration: float) -> Trajectory:
    """A reference that jumps from ``start`` (n,) to ``end`` (n,) [rad or m].

    Args:
        chain: The robot.
        start: Position before the step, shape (n,) [rad or m].
        end: Position after the step, shape (n,) [rad or m].
        at: Instant of the step [s]; at 0 the reference stands at ``end`` all the time.
        duration: Duration of the whole [s].

    Raises:
        InvalidRobotState: A position has the wrong length or is not finite.
        InvalidOption: The step is not within the duration.
    """
    before, after = chain.each_joint(start, "reference.from"), chain.each_joint(end, "reference.to")
    if not 0.0 <= at < duration:
        raise InvalidOption(
            f"the reference lasts {duration:g} s and would step at {at:g} s",
            hint="Give a time `at` that is not negative, and a longer duration.",
        )
    if at == 0.0:
        return hold(chain, after, duration)
    rows = np.stack([before, after])[:, :, None]
    return Trajectory(chain.joint_names, np.array([0.0, at, duration]), rows)


def sine(
    chain: Chain,
    center: ArrayLike,
    amplitude: ArrayLike,
    frequency: ArrayLike,
    phase: ArrayLike,
    duration: float,
) -> Trajectory:
    """The reference center + amplitude sin(2 pi frequency t + phase) of each joint.

    Args:
        chain: The robot.
        center: Shape (n,) [rad or m].
        amplitude: Shape (n,) or () for all joints [rad or m].
        frequency: Not negative, shape (n,) or () [Hz].
        phase: Shape (n,) or () [rad].
        duration: Duration of the trajectory [s].

    Raises:
        InvalidRobotState: A vector has the wrong length or is not finite.
        InvalidOption: A frequency is negative, or the duration has too many periods.
    """
    middle, size, hertz, angle = (
        chain.each_joint(value, f"reference.{name}")
        for name, value in {
            "center": center, "amplitude": amplitude, "frequency": frequency, "phase": phase,
        }.items()
    )  # fmt: skip
    if (hertz < 0.0).any():
        raise InvalidOption(
            f"the frequency of a reference is {hertz.min():g} Hz", hint="Give one that is >= 0."
        )
    count = max(1, math.ceil(_PIECES * float(hertz.max()) * duration))
    if count > _MOST_PIECES:
        raise InvalidOption(
            f"the reference has {float(hertz.max()) * duration:.6g} periods, at most "
            f"{_MOST_PIECES / _PIECES:g} are taken",
            hint="Give a lower frequency or a shorter duration.",
        )
    breaks = np.linspace(0.0, duration, count + 1)
    turn = 2.0 * np.pi * hertz
    orders = np.arange(_DEGREE + 1)
    factorials = np.array([math.factorial(k) for k in orders], dtype=np.float64)
    # The k-th derivative of the sine is that of a quarter of a turn more.
    angles = (np.outer(breaks[:-1], turn) + angle)[:, :, None] + 0.5 * np.pi * orders
    rows = size[:, None] * np.sin(angles) * turn[:, None] ** orders / factorials
    rows[:, :, 0] += middle
    return Trajectory(chain.joint_names, breaks, rows)


def spline(
    chain: Chain, points: Sequence[ArrayLike], times: ArrayLike, interpolation: str
) -> Trajectory:
    """A cubic spline through points.

    Args:
        chain: The robot.
        points: Configurations, each of shape (n,) [rad or m].
        times: One for each point, ascending, the first 0 [s].
        interpolation: "natural_spline" or "clamped_spline"; see ``interpolate``.

    Raises:
        InvalidRobotState: A point has the wrong length or is not finite.
        InvalidOption: There are not as many times as points, or the first is not 0.
        InvalidTrajectory: Times do not ascend.
    """
    rows = np.stack(
        [chain.each_joint(point, f"reference.points[{i}]") for i, point in enumerate(points)]
    )
    knots = np.array(times, dtype=np.float64)
    if knots.shape != (len(rows),) or knots[0] != 0.0:
        raise InvalidOption(
            f"the spline has {len(rows)} points and {knots.size} times, the first at "
            f"{knots.flat[0] if knots.size else math.nan:g} s",
            hint="Give one time for each point, ascending from 0.",
        )
    return interpolate(chain.joint_names, knots, rows, interpolation)


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceSignal:
    """Position, velocity and acceleration of a trajectory, piece by piece.

    An integrator must see one smooth piece at a time: at a break where the acceleration jumps,
    the piece decides which of the two is meant. The robot rests at the end in the piece after
    the last.

    Args:
        trajectory: Trajectory to follow.
    """

    trajectory: Trajectory
    rates: tuple[Array, Array, Array] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        orders = (self.trajectory.derivative(order).coefficients for order in range(3))
        object.__setattr__(self, "rates", tuple(orders))

    def piece(self, t: float) -> int:
        """Index of the piece that begins at, or contains, time ``t`` [s]."""
        return int(np.searchsorted(self.trajectory.breaks, t, side="right")) - 1

    def arrays(self) -> tuple[Array, Array]:
        """Breaks (m + 1,) and coefficients (m + 1, n, k); the last piece is the rest at the end."""
        m, n, k = self.trajectory.coefficients.shape
        coefficients = np.zeros((m + 1, n, k))
        coefficients[:m] = self.trajectory.coefficients
        coefficients[m, :, 0] = self.trajectory.end
        return np.array(self.trajectory.breaks), coefficients

    def breaks(self, duration: float) -> list[float]:
        """Times within (0, duration) at which a piece ends [s]."""
        return [float(t) for t in self.trajectory.breaks[1:] if t < duration]

    def at(self, t: float, piece: int | None = None) -> Reference:
        """The reference at time ``t`` [s], in a given piece where its neighbour's may differ."""
        i = self.piece(t) if piece is None else piece
        if i >= self.trajectory.pieces:
            rest = np.zeros(self.trajectory.n)
            return Reference(self.trajectory.end, rest, rest)
        powers = (t - self.trajectory.breaks[i]) ** np.arange(self.trajectory.degree + 1.0)
        return Reference(*(c[i] @ powers[: c.shape[2]] for c in self.rates))
