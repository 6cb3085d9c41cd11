"""A trajectory as a value: joint positions as piecewise polynomials of time.

Of one through samples, what lies between them is said by a name, never guessed.
"""

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from kinematics.arrays import Array, Remade, frozen
from kinematics.errors import InvalidNumbers, InvalidOption, InvalidTrajectory
from kinematics.trajectory.polynomial import (
    extrema_kernel,
    piece_extrema_kernel,
    sample_kernel,
    shift_kernel,
)

#: Pieces of a higher degree are refused: powers of time lose all digits long before.
MAX_DEGREE = 31
#: More samples than this are refused: half an hour at 1 kHz fits.
MAX_SAMPLES = 2_000_000
#: How long a motion takes that goes nowhere [s]: one cycle of a usual arm controller.
REST = 1e-3
# A sample this part of a period before the end would be the end twice over, to rounding.
_SAME_SAMPLE = 1e-6
# A time asked for may miss the end by what sums of times round off, a part of the duration.
_TIME_ROUNDING = 1e-12


class Extrema(NamedTuple):
    """Least and largest value of each joint with their times [s], each of shape (n,)."""

    minimum: Array
    time_of_minimum: Array
    maximum: Array
    time_of_maximum: Array


class Peaks(NamedTuple):
    """Largest absolute value of each joint with its time [s], each of shape (n,)."""

    value: Array
    time: Array


class Continuity(NamedTuple):
    """Largest jump over the breaks, over all joints, of position, velocity and acceleration."""

    position: float
    velocity: float
    acceleration: float


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory(Remade):
    """Joint positions over time, q_j(t) = sum_k c_ijk (t - b_i)^k for b_i <= t <= b_(i+1).

    Args:
        joint_names: n names.
        breaks: Instants at which the m pieces begin and the last one ends, from 0 on, shape (m +
            1,) [s].
        coefficients: Coefficients in ascending powers of the time since the piece began, shape (m,
            n, k).

    Also known: ``n``, the number of joints; ``pieces``, that of polynomial pieces, m; ``duration``
    [s].

    Raises:
        InvalidTrajectory: Shapes do not fit, values are not finite, or breaks do not ascend from 0.
    """

    joint_names: tuple[str, ...]
    breaks: Array
    coefficients: Array
    n: int = field(init=False, repr=False)
    pieces: int = field(init=False, repr=False)
    duration: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        names = tuple(self.joint_names)
        name = "breaks"
        try:
            breaks, name = frozen(self.breaks), "coefficients"
            coefficients = frozen(self.coefficients)
        except InvalidNumbers as error:
            raise InvalidTrajectory(
                f"the {name} are not an array of numbers", hint=error.hint
            ) from None
        object.__setattr__(self, "joint_names", names)
        object.__setattr__(self, "breaks", breaks)
        object.__setattr__(self, "coefficients", coefficients)
        if not _is_sound(names, breaks, coefficients):
            _refuse(self)
        object.__setattr__(self, "n", len(names))
        object.__setattr__(self, "pieces", len(breaks) - 1)
        object.__setattr__(self, "duration", float(breaks[-1]))

    def __repr__(self) -> str:
        return f"Trajectory({self.n} joints, {self.duration:.3f} s, {self.pieces} pieces)"

    @property
    def content_hash(self) -> str:
        """Digest of all numbers and names; worked out anew each time, few motions are asked."""
        digest = hashlib.sha256("\0".join(self.joint_names).encode())
        digest.update(repr(self.coefficients.shape).encode())
        digest.update(self.breaks.tobytes() + self.coefficients.tobytes())
        return digest.hexdigest()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Trajectory) and other.content_hash == self.content_hash

    def __hash__(self) -> int:
        return hash(self.content_hash)

    @property
    def degree(self) -> int:
        """Highest power that the coefficients can hold."""
        return int(self.coefficients.shape[2]) - 1

    @property
    def start(self) -> Array:
        """Position at time 0, shape (n,)."""
        return self.coefficients[0, :, 0] + 0.0

    @property
    def end(self) -> Array:
        """Position at the last instant, shape (n,)."""
        return np.asarray(self.sample([self.duration])[0])

    def sample(self, times: ArrayLike, derivative: int = 0) -> Array:
        """Position, or a derivative of it, at given times, shape (len(times), n).

        At a break the piece that begins there is meant, at the end the last piece.

        Args:
            times: Shape (p,), within [0, duration] [s].
            derivative: 0 position, 1 velocity, 2 acceleration, 3 jerk, ...

        Raises:
            InvalidOption: A time is outside the trajectory, or the derivative is negative.
        """
        wanted = np.atleast_1d(frozen(times))
        slack = _TIME_ROUNDING * self.duration
        if wanted.ndim != 1 or not ((wanted >= -slack) & (wanted <= self.duration + slack)).all():
            raise InvalidOption(
                "a time to sample at lies outside the trajectory",
                hint=f"Give times from 0 to {self.duration!r} s, in one list.",
            )
        values = np.empty((len(wanted), self.n))
        wanted = np.clip(wanted, 0.0, self.duration)
        sample_kernel(self.breaks, self.coefficients, wanted, _order(derivative), values)
        return values

    def derivative(self, order: int = 1) -> "Trajectory":
        """The derivative of the given order as a piecewise polynomial of its own."""
        c = self.coefficients
        for _ in range(_order(order)):
            c = c[:, :, 1:] * np.arange(1.0, c.shape[2]) if c.shape[2] > 1 else np.zeros_like(c)
        return Trajectory(self.joint_names, self.breaks, c)

    def extrema(self, derivative: int = 0) -> Extrema:
        """Exact least and largest values of a derivative over all t, from the pieces' roots."""
        return Extrema(*(frozen(column) for column in self._extrema(derivative, False).T))

    def _extrema(self, derivative: int, largest_only: bool) -> Array:
        size = self.degree + 1
        best = np.empty((self.n, 4))
        work = np.empty((size + 3, size))
        order = _order(derivative)
        extrema_kernel(self.breaks, self.coefficients, order, largest_only, work, best)
        return best

    def piece_extrema(self, derivative: int = 0) -> tuple[Array, Array]:
        """Exact least and largest values of a derivative within each piece, both (m, n)."""
        size = self.degree + 1
        lower = np.empty((self.pieces, self.n))
        upper = np.empty((self.pieces, self.n))
        work = np.empty((size + 4, max(size, 4)))
        order = _order(derivative)
        piece_extrema_kernel(self.breaks, self.coefficients, order, work, lower, upper)
        return lower, upper

    def peaks(self, derivative: int = 0) -> Peaks:
        """Exact largest absolute values of a derivative over all t."""
        low, time_low, high, time_high = self._extrema(derivative, True).T
        up = high >= -low
        return Peaks(frozen(np.where(up, high, -low)), frozen(np.where(up, time_high, time_low)))

    def jumps(self, derivative: int = 0) -> Array:
        """Jumps of a derivative at each inner break, shape (m - 1, n)."""
        rates = self.derivative(derivative).coefficients
        lengths = np.diff(self.breaks)[:-1, None]
        before = np.zeros((self.pieces - 1, self.n))
        for k in range(rates.shape[2] - 1, -1, -1):
            before = before * lengths + rates[:-1, :, k]
        return np.asarray(rates[1:, :, 0] - before)

    def continuity(self) -> Continuity:
        """The largest jumps over the breaks of position, velocity and acceleration."""
        jumps = (self.jumps(order) for order in range(3))
        return Continuity(*(float(np.abs(jump).max(initial=0.0)) for jump in jumps))

    def dilate(self, factor: float) -> "Trajectory":
        """Trajectory stretched in time by ``factor``: velocity / factor, acceleration / factor^2.

        Raises:
            InvalidOption: The factor is not a positive finite number.
        """
        if not (math.isfinite(factor) and factor > 0.0):
            raise InvalidOption(
                f"the dilation factor is {factor}", hint="Give a positive finite number."
            )
        powers = np.power(float(factor), -np.arange(self.degree + 1.0))
        return Trajectory(self.joint_names, self.breaks * factor, self.coefficients * powers)

    def reverse(self) -> "Trajectory":
        """Trajectory run backwards, q(T - t): velocities change their signs."""
        signs = np.where(np.arange(self.degree + 1) % 2 == 0, 1.0, -1.0)
        shifted = np.empty_like(self.coefficients)
        for i, length in enumerate(np.diff(self.breaks)):
            for joint in range(self.n):
                shift_kernel(self.coefficients[i, joint], length, shifted[i, joint])
        breaks = self.duration - self.breaks[::-1]
        return Trajectory(self.joint_names, breaks, (shifted * signs)[::-1])

    def split(self, time: float) -> tuple["Trajectory", "Trajectory"]:
        """Parts before and after ``time``, each starting at its own time 0.

        Raises:
            InvalidOption: The time is not strictly inside the trajectory.
        """
        if not 0.0 < time < self.duration:
            raise InvalidOption(
                f"a trajectory of {self.duration} s can't be split at {time} s",
                hint="Give a time strictly between 0 and the duration.",
            )
        i = int(np.searchsorted(self.breaks, time, side="left")) - 1
        head_breaks = np.append(self.breaks[: i + 1], time)
        head = Trajectory(self.joint_names, head_breaks, self.coefficients[: i + 1])
        if self.breaks[i + 1] == time:
            tail_breaks, tail = self.breaks[i + 1 :] - time, self.coefficients[i + 1 :]
        else:
            tail_breaks = np.concatenate([[0.0], self.breaks[i + 1 :] - time])
            tail = self.coefficients[i:].copy()
            for joint in range(self.n):
                shift_kernel(self.coefficients[i, joint], time - self.breaks[i], tail[0, joint])
        return head, Trajectory(self.joint_names, tail_breaks, tail)

    def uniform_samples(self, period: float) -> Array:
        """Times 0, period, 2 period, ... and exactly the duration, strictly increasing [s].

        Raises:
            InvalidOption: The period is not positive, or would give more than ``MAX_SAMPLES``.
        """
        return uniform_times(self.duration, period, "sample period")


def uniform_times(duration: float, period: float, name: str) -> Array:
    """Times 0, period, 2 period, ... and exactly the duration, strictly increasing [s].

    Args:
        duration: The last time [s].
        period: Time from one to the next [s].
        name: Name of the period in messages.

    Raises:
        InvalidOption: The period is not positive, or would give more than ``MAX_SAMPLES``.
    """
    if not (math.isfinite(period) and period > 0.0):
        raise InvalidOption(f"the {name} is {period} s", hint="Give a positive finite number.")
    if duration / period > MAX_SAMPLES:
        raise InvalidOption(
            f"a {name} of {period} s over {duration} s gives more than {MAX_SAMPLES} of them",
            hint=f"Give at least {duration / MAX_SAMPLES:.3g} s.",
        )
    count = max(1, math.ceil(duration / period - _SAME_SAMPLE))
    times: Array = np.arange(count + 1.0) * period
    times[-1] = duration
    return times


def concatenate(trajectories: Sequence[Trajectory]) -> Trajectory:
    """One trajectory that plays several in turn.

    Whether they meet is for ``Trajectory.continuity`` to say. A piece whose time is lost to
    rounding in the sum of times is left out.

    Raises:
        InvalidTrajectory: There is none, or their joints differ.
    """
    if not trajectories:
        raise InvalidTrajectory("there is no trajectory to join", hint="Give at least one.")
    names = trajectories[0].joint_names
    if any(other.joint_names != names for other in trajectories):
        raise InvalidTrajectory(
            "trajectories of different joints can't be joined",
            hint=f"Give each of them the joints {', '.join(names)}, in this order.",
        )
    size = 1 + max(item.degree for item in trajectories)
    starts = np.cumsum([0.0, *(item.duration for item in trajectories)])
    breaks = [np.zeros(1)]
    breaks += [start + t.breaks[1:] for start, t in zip(starts, trajectories, strict=False)]
    coefficients = [
        np.pad(item.coefficients, ((0, 0), (0, 0), (0, size - 1 - item.degree)))
        for item in trajectories
    ]
    times = np.concatenate(breaks)
    lasts = np.diff(times) > 0.0
    return Trajectory(names, times[np.append(True, lasts)], np.concatenate(coefficients)[lasts])


def stay(joint_names: Sequence[str], position: ArrayLike, duration: float = REST) -> Trajectory:
    """The trajectory of a robot at rest: one constant piece.

    A trajectory has a piece, and a piece has a length in time; a motion from a point to itself
    lasts one millisecond unless told otherwise.

    Args:
        joint_names: n names.
        position: Shape (n,).
        duration: [s].

    Raises:
        InvalidTrajectory: The position has not n finite values, or the duration is not positive.
    """
    coefficients = np.asarray(position, dtype=np.float64)[None, ..., None]
    return Trajectory(tuple(joint_names), np.array([0.0, duration]), coefficients)


def _is_sound(names: tuple[str, ...], breaks: Array, c: Array) -> bool:
    """Whether ``_refuse`` has nothing to refuse, at the least cost."""
    if breaks.ndim != 1 or c.ndim != 3:
        return False
    fits = 1 < len(breaks) == len(c) + 1 and c.shape[1] == len(names) > 0
    fits = fits and 0 < c.shape[2] <= MAX_DEGREE + 1 and len(set(names)) == len(names)
    ascends = fits and breaks[0] == 0.0 and bool((breaks[1:] > breaks[:-1]).all())
    return ascends and bool(breaks[-1] < np.inf) and bool(np.isfinite(c).all())


def _refuse(trajectory: Trajectory) -> None:
    """Say what is wrong with a trajectory's numbers."""
    names, breaks, c = trajectory.joint_names, trajectory.breaks, trajectory.coefficients
    for array, name in ((breaks, "breaks"), (c, "coefficients")):
        if not np.isfinite(array).all():
            raise InvalidTrajectory(f"the {name} are not all finite")
    if not names or len(set(names)) != len(names):
        raise InvalidTrajectory("the joint names of a trajectory must be distinct, at least one")
    if breaks.ndim != 1 or len(breaks) < 2:
        raise InvalidTrajectory("a trajectory needs at least one piece, that is two breaks")
    if breaks[0] != 0.0 or not (np.diff(breaks) > 0.0).all():
        place = int(np.argmin(np.diff(breaks) > 0.0))
        raise InvalidTrajectory(
            f"the breaks of a trajectory start at {breaks[0]} s and fail to ascend "
            f"after break {place}"
            if breaks[0] == 0.0
            else f"the breaks of a trajectory start at {breaks[0]} s",
            hint="Give strictly increasing times, the first of them 0.",
        )
    if c.ndim != 3 or c.shape[:2] != (len(breaks) - 1, len(names)) or c.shape[2] < 1:
        raise InvalidTrajectory(
            f"coefficients of shape {c.shape} do not fit {len(breaks) - 1} piece(s) "
            f"of {len(names)} joint(s)",
            hint="Give coefficients[piece][joint][power].",
        )
    if c.shape[2] - 1 > MAX_DEGREE:
        raise InvalidTrajectory(
            f"pieces of degree {c.shape[2] - 1} are refused", hint=f"At most {MAX_DEGREE}."
        )


def _order(derivative: int) -> int:
    if not isinstance(derivative, int | np.integer) or derivative < 0:
        raise InvalidOption(
            f"there is no derivative of order {derivative}", hint="Give 0, 1, 2, ..."
        )
    return derivative


INTERPOLATIONS = ("linear", "cubic", "quintic", "natural_spline", "clamped_spline")


def interpolate(
    joint_names: Sequence[str],
    times: ArrayLike,
    positions: ArrayLike,
    interpolation: str,
    velocities: ArrayLike | None = None,
    accelerations: ArrayLike | None = None,
) -> Trajectory:
    """The trajectory through samples.

    "linear" connects positions by straight lines; "cubic" is the Hermite cubic through positions
    and velocities, "quintic" the Hermite quintic through positions, velocities and accelerations;
    "natural_spline" and "clamped_spline" are the cubic splines with continuous accelerations, which
    at the ends are 0 or such that the velocities are 0.

    Args:
        joint_names: n names.
        times: Strictly increasing, shape (m,), m >= 2; the trajectory begins at the first [s].
        positions: Shape (m, n).
        interpolation: One of ``INTERPOLATIONS``.
        velocities: Shape (m, n), for "cubic" and "quintic".
        accelerations: Shape (m, n), for "quintic".

    Raises:
        InvalidOption: The interpolation is unknown, or what it needs is not given.
        InvalidTrajectory: Shapes do not fit, or times do not increase.
    """
    if interpolation not in INTERPOLATIONS:
        raise InvalidOption(
            f"there is no interpolation {interpolation!r}",
            hint=f"Choose one of: {', '.join(INTERPOLATIONS)}.",
            interpolations=list(INTERPOLATIONS),
        )
    t = _sample_times(times)
    shape = (len(t), len(joint_names))
    q = _rows(positions, shape, "positions")
    if interpolation in ("natural_spline", "clamped_spline"):
        ends: Literal["natural", "clamped"]
        ends = "natural" if interpolation == "natural_spline" else "clamped"
        # From scipy's descending powers (4, m - 1, n) to ours (m - 1, n, 4).
        c = np.moveaxis(scipy.interpolate.CubicSpline(t, q, bc_type=ends).c[::-1], 0, 2)
        return Trajectory(tuple(joint_names), t - t[0], c)
    needed = {"linear": 0, "cubic": 1, "quintic": 2}[interpolation]
    derivatives = [q]
    for name, rows in (("velocities", velocities), ("accelerations", accelerations))[:needed]:
        if rows is None:
            raise InvalidOption(
                f"interpolation {interpolation!r} needs {name}, which are not given",
                hint='Give them, or choose "natural_spline", which needs positions only.',
            )
        derivatives.append(_rows(rows, shape, name))
    return Trajectory(tuple(joint_names), t - t[0], _hermite(np.diff(t), derivatives))


def _hermite(lengths: Array, derivatives: Sequence[Array]) -> Array:
    """Coefficients (m - 1, n, 2 d) of the pieces that meet d derivatives at both their ends.

    On the unit interval the lower half of the coefficients is given by the start; the upper half
    solves a system of binomials for what is then left over at the end.
    """
    d = len(derivatives)
    h = lengths[:, None]
    powers = np.arange(2 * d)
    # Scaled to the unit interval: the i-th derivative times h^i.
    start = [rows[:-1] * h**i for i, rows in enumerate(derivatives)]
    end = [rows[1:] * h**i for i, rows in enumerate(derivatives)]
    factorials = np.cumprod([1.0, *range(1, d)])
    lower = [rows / factorials[i] for i, rows in enumerate(start)]
    # Row i: the i-th derivative of u^k at 1.
    falling = np.array([[np.prod(k - np.arange(i)) for k in powers] for i in range(d)], dtype=float)
    left = np.stack(end) - np.tensordot(falling[:, :d], np.stack(lower), axes=1)
    upper = np.linalg.solve(falling[:, d:], left.reshape(d, -1)).reshape(left.shape)
    c = np.stack([*lower, *upper], axis=2)
    return np.asarray(c / h[:, :, None] ** powers)


def _sample_times(times: ArrayLike) -> Array:
    t = np.asarray(times, dtype=np.float64)
    if t.ndim != 1 or len(t) < 2 or not np.isfinite(t).all():
        raise InvalidTrajectory("samples need at least two finite times")
    steps = np.diff(t)
    if not (steps > 0.0).all():
        i = int(np.argmax(steps <= 0.0)) + 1
        raise InvalidTrajectory(
            f"time {i} of the samples ({t[i]:.6g} s) is not after the one before",
            hint="Times must strictly increase.",
        )
    return t


def _rows(values: ArrayLike, shape: tuple[int, int], name: str) -> Array:
    try:
        rows = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        rows = np.zeros(0)  # rows of different lengths
    if rows.shape != shape:
        raise InvalidTrajectory(
            f"the {name} of the samples must be {shape[0]} rows of {shape[1]} values",
            hint="One row for each time, one value for each joint.",
        )
    if not np.isfinite(rows).all():
        raise InvalidTrajectory(f"the {name} of the samples are not all finite")
    return rows
