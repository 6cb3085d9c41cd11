"""Family of stops q(t, tau): where the joints are a time tau after they begin to brake at t.

Enclosed on cells of both times. At one tau the joints' ways while braking grow with velocity and
acceleration at the begin (``braking``), whose intervals are those of the trajectory's polynomials.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import directly, kernel
from kinematics.arrays import Array, Indices
from kinematics.trajectory.trajectory import Trajectory, stay
from planning.stops.braking import Braking, BrakingLimits

#: What rounding can have done to a sum of few products [relative to 1 and to the sum].
_ROUNDED = 1e-13


class Cells(NamedTuple):
    """Cells of the two times (b cells).

    Args:
        piece: Piece of the trajectory that each lies in, shape (b,).
        begin: Middle and half length of the begin of braking, in the piece's own time, (b, 2) [s].
        after: Middle and half length of the time since then, shape (b, 2) [s].
    """

    piece: Indices
    begin: Array
    after: Array

    def chosen(self, rows: Indices) -> "Cells":
        """Some of the cells, by number."""
        return Cells(self.piece[rows], self.begin[rows], self.after[rows])

    def halves(self, by_begin: NDArray[np.bool_]) -> "Cells":
        """Both halves of each cell, the first ones first, along the time chosen (b,)."""
        cut = np.where(by_begin, 0.5, 0.0)[:, None], np.where(by_begin, 0.0, 0.5)[:, None]
        parts: list[list[Array]] = []
        for side in (-1.0, 1.0):
            row = []
            for times, share in zip((self.begin, self.after), cut, strict=True):
                middle, half = times[:, :1], times[:, 1:]
                row.append(np.hstack([middle + side * share * half, (1.0 - share) * half]))
            parts.append(row)
        begin, after = (np.concatenate([parts[0][k], parts[1][k]]) for k in range(2))
        return Cells(np.concatenate([self.piece, self.piece]), begin, after)


class Enclosed(NamedTuple):
    """Joints on cells, each of shape (b, n).

    Args:
        middle: Values of the member of the family in the middle of the cell [rad or m].
        radius: How far they are off that at most [rad or m].
        rate: What they move by from the middle of a cell to its end, begun later [rad or m].
        off: How far they are off a motion by ``rate`` at most [rad or m].
        moves: What changes of each of the two times move them by, about, shape (b, 2) [rad or m].
    """

    middle: Array
    radius: Array
    rate: Array
    off: Array
    moves: Array


class StopFamily:
    """Stops of a trajectory with every joint braking by itself.

    Args:
        trajectory: The motion.
        limits: Limits that the joints brake at.
    """

    def __init__(self, trajectory: Trajectory, limits: BrakingLimits) -> None:
        self.trajectory, self.limits = trajectory, limits
        self._lengths = np.diff(trajectory.breaks)

    def cells(self, longest: float) -> Cells:
        """All begins in parts of the trajectory's pieces, with all times until all is at rest.

        Args:
            longest: Length of a part at most [s].
        """
        parts = np.maximum(np.ceil(self._lengths / longest), 1.0).astype(np.int64)
        piece = np.repeat(np.arange(len(parts)), parts)
        number = np.arange(len(piece)) - np.repeat(np.cumsum(parts) - parts, parts)
        half = 0.5 * self._lengths[piece] / parts[piece]
        begin = np.stack([(2.0 * number + 1.0) * half, half * (1.0 + 1e-12)], axis=1)
        still = np.zeros((len(piece), 2))
        cells = Cells(piece, begin, still)
        halves = 0.5 * self.durations(cells)
        return cells._replace(after=np.stack([halves, halves], axis=1))

    def time(self, cells: Cells) -> Array:
        """Instants of the motion in the middle of cells, shape (b,) [s]."""
        at = self.trajectory.breaks[cells.piece] + cells.begin[:, 0]
        return np.asarray(np.minimum(at, self.trajectory.duration))

    def durations(self, cells: Cells) -> Array:
        """Bounds of the time to rest, shape (b,) [s]."""
        low, high = self._braking(self._taylor(cells), cells.begin[:, 1:])
        return np.asarray(np.maximum(low.duration, high.duration).max(axis=1))

    def farthest(self, cells: Cells) -> tuple[Array, Array]:
        """Bounds of all values on the way to rest, each of shape (b, n) [rad or m]."""
        c, h = self._taylor(cells), cells.begin[:, 1:]
        low, high = self._braking(c, h)
        radius = _spread(c, h, 0)
        least = np.minimum(low.moved(low.duration), low.moved(low.turn))
        most = np.maximum(high.moved(high.duration), high.moved(high.turn))
        lowest = c[..., 0] - radius + np.minimum(least, 0.0)
        highest = c[..., 0] + radius + np.maximum(most, 0.0)
        # Where the joint keeps its direction and may jump to its limit of acceleration, the place
        # of rest q + v |v| / 2A changes by v (1 + a sign(v) / A).
        v, a = derivative_interval(c, h, 1), derivative_interval(c, h, 2)
        size = np.abs(v).max(axis=0)
        share = np.sign(c[..., 1]) * a / self.limits.acceleration
        change = h * size * np.abs(1.0 + share).max(axis=0)
        at = c[..., 0] + 0.5 * c[..., 1] * np.abs(c[..., 1]) / self.limits.acceleration
        sure = np.isinf(self.limits.jerk) & (v[0] * v[1] > 0.0)
        forwards, backwards = sure & (v[0] > 0.0), sure & (v[0] < 0.0)
        highest = np.where(forwards, np.minimum(highest, at + change), highest)
        lowest = np.where(backwards, np.maximum(lowest, at - change), lowest)
        return lowest, highest

    def enclose(self, cells: Cells) -> Enclosed:
        """Enclose the joints of all members of the family on cells."""
        c, h, (middle, half) = self._taylor(cells), cells.begin[:, 1:], cells.after.T[..., None]
        low, high = self._braking(c, h)
        first, last = np.maximum(middle - half, 0.0) + 0.0 * c[..., 0], middle + half
        least, most = [], []
        for times in (first, last + 0.0 * first, None):
            at = [np.clip(one.turn, first, last) for one in (low, high)] if times is None else (
                times, times)  # fmt: skip
            least.append(low.moved(at[0]))
            most.append(high.moved(at[1]))
        lowest, highest = np.min(least, axis=0), np.max(most, axis=0)
        # A member of the family: a fault there is one of a stop.
        way = Braking.of(c[..., 1], 2.0 * c[..., 2], self.limits).moved(middle + 0.0 * first)
        spread = np.maximum(highest - way, way - lowest)
        radius, bend = _spread(c, h, 0), _spread(c, h, 0, linear=False)
        value = c[..., 0] + way
        rounded = _ROUNDED * (1.0 + np.abs(value) + radius + spread)
        speed = np.abs(c[..., 1])
        begun = (h * (speed + np.abs(2.0 * c[..., 2]) * middle)).sum(axis=1)
        kept = (high.moved(last + 0.0 * first) - high.moved(first)) + (
            low.moved(last + 0.0 * first) - low.moved(first)
        )
        moves = np.stack([begun, 0.25 * np.abs(kept).sum(axis=1)], axis=1)
        return Enclosed(
            value, radius + spread + rounded, h * c[..., 1], bend + spread + rounded, moves
        )

    def _taylor(self, cells: Cells) -> Array:
        return taylor(self.trajectory.coefficients[cells.piece], cells.begin[:, 0])

    def _braking(self, c: Array, h: Array) -> tuple[Braking, Braking]:
        """Braking from the least and from the largest velocities and accelerations of cells."""
        v, a = derivative_interval(c, h, 1), derivative_interval(c, h, 2)
        return Braking.of(v[0], a[0], self.limits), Braking.of(v[1], a[1], self.limits)


def taylor(coefficients: Array, at: Array) -> Array:
    """Coefficients of pieces about other times, at least four of each joint, shape (b, n, k).

    Args:
        coefficients: Coefficients about 0, shape (b, n, k).
        at: The times, shape (b,) [s].
    """
    c, shift = coefficients.copy(), at[:, None]
    if c.shape[-1] < 4:
        c = np.concatenate([c, np.zeros((*c.shape[:2], 4 - c.shape[-1]))], axis=-1)
    k = c.shape[-1]
    for first in range(k - 1):
        for i in range(k - 2, first - 1, -1):
            c[..., i] += shift * c[..., i + 1]
    return c


def derivative_interval(c: Array, h: Array, order: int) -> Array:
    """Least and largest values of a derivative on cells, shape (2, b, n).

    Args:
        c: Taylor coefficients, shape (b, n, k).
        h: Half lengths of the cells, shape (b, 1) [s].
        order: Order of the derivative, 1 or 2.
    """
    value, spread = order * c[..., order], _spread(c, h, order)
    spread = spread + _ROUNDED * (1.0 + np.abs(value) + spread)
    return np.stack([value - spread, value + spread])


def _spread(c: Array, h: Array, order: int, *, linear: bool = True) -> Array:
    """How far a derivative is off its value in the middle at most, shape (b, n)."""
    total, power = np.zeros(c.shape[:2]), h.copy()
    for i in range(order + 1, c.shape[-1]):
        factor = float(np.prod(np.arange(i - order + 1, i + 1)))
        if linear or i > order + 1:
            total += factor * np.abs(c[..., i]) * power
        power = power * h
    return total


def joint_stop(trajectory: Trajectory, at: float, limits: BrakingLimits) -> Trajectory:
    """Stop with every joint braking by itself, as a trajectory from ``at`` on.

    Args:
        trajectory: The motion.
        at: Instant of it at which braking begins [s].
        limits: Limits that the joints brake at.
    """
    return braking_motion(trajectory.joint_names, state_at(trajectory, at), limits)


def state_at(motion: Trajectory, at: float | None = None) -> Array:
    """Position, velocity and acceleration at an instant, the end where None, shape (3, n)."""
    times = [motion.duration if at is None else at]
    return np.stack([motion.sample(times, order)[0] for order in range(3)])


def braking_motion(
    joint_names: Sequence[str],
    state: Array,
    limits: BrakingLimits,
    target: Array | None = None,
    until: float | None = None,
) -> Trajectory:
    """Motion from a state to other velocities, every joint by itself: braking as seen from these.

    Args:
        joint_names: n names.
        state: Position, velocity and acceleration to begin with, shape (3, n).
        limits: Limits that the velocities change at.
        target: The velocities, shape (n,); rest where None [rad/s or m/s].
        until: Instant at which it ends; when the last joint is there where None [s].
    """
    rows = np.ascontiguousarray(state, np.float64)
    drift = np.zeros_like(rows[0]) if target is None else np.ascontiguousarray(target, np.float64)
    ends = np.inf if until is None else float(until)
    breaks, c = directly(braking_kernel, rows, np.stack(limits), drift, ends)
    return Trajectory(tuple(joint_names), breaks, c) if len(c) else stay(joint_names, rows[0])


@kernel
def braking_kernel(state: Array, limits: Array, target: Array, until: float) -> tuple[Array, Array]:
    """Breaks and coefficients (m, n, 4) of ``braking_motion``, none where all is there already.

    Each joint brakes as ``braking.Braking`` has it, seen from its target.
    """
    n = state.shape[1]
    # What phases begin with (signed), their ends, and at last rest.
    rows, ends, times = np.zeros((n, 4, 4)), np.zeros((n, 3)), np.empty(3 * n + 1)
    for j in range(n):
        _write_phases(state[1, j] - target[j], state[2, j], limits[0, j], limits[1, j],
                      rows[j], ends[j])  # fmt: skip
        times[3 * j : 3 * j + 3] = ends[j]
    times[3 * n] = until if until < np.inf else 0.0
    times.sort()
    breaks, count = np.zeros(3 * n + 2), 0
    for time in times:
        # Ends of phases that rounding alone tells apart are one.
        if time > breaks[count] + 1e-12 and time <= until:
            count += 1
            breaks[count] = time
    if until < np.inf:
        breaks[count] = until
    c = np.zeros((count, n, 4))
    for i in range(count):
        within = 0.5 * (breaks[i] + breaks[i + 1])
        for j in range(n):
            phase = 0
            while phase < 3 and within >= ends[j, phase]:
                phase += 1
            x = breaks[i] - (ends[j, phase - 1] if phase > 0 else 0.0)
            c0, c1, c2, c3 = rows[j, phase]
            c[i, j, 0] = c0 + x * (c1 + x * (c2 + x * c3)) + state[0, j] + breaks[i] * target[j]
            c[i, j, 1] = c1 + x * (2.0 * c2 + 3.0 * x * c3) + target[j]
            c[i, j, 2] = c2 + 3.0 * x * c3
            c[i, j, 3] = c3
    return breaks[: count + 1], c


@kernel(allocates=False, inline="code")
def _write_phases(
    velocity: float, acceleration: float, limit: float, jerk: float, rows: Array, ends: Array
) -> None:
    """Write coefficients at the begin of each phase of a joint's braking, and when they end."""
    jumps = np.isinf(jerk)
    J, a = (1.0, 0.0) if jumps else (jerk, acceleration)
    sign = 1.0 if velocity + a * abs(a) / (2.0 * J) >= 0.0 else -1.0
    v, a = sign * velocity, sign * a
    spans = 0.0, v / limit, 0.0
    if jumps:
        a, J = -limit, 0.0
    else:
        # More than the limit is not built up, but where it is there it is held.
        most = max(limit, -a)
        peak = max(min(math.sqrt(max(J * v + 0.5 * a * a, 0.0)), most), -a, 0.0)
        left = v + (0.5 * a * a - peak * peak) / J
        held = left / peak if peak >= most and peak > 0.0 else 0.0
        spans = max((a + peak) / J, 0.0), max(held, 0.0), max(peak / J, 0.0)
    place, passed = 0.0, 0.0
    for phase in range(3):
        slope, x = (phase - 1) * J, spans[phase]
        rows[phase, 0], rows[phase, 1] = sign * place, sign * v
        rows[phase, 2], rows[phase, 3] = sign * 0.5 * a, sign * slope / 6.0
        place += x * (v + x * (0.5 * a + x * slope / 6.0))
        v, a = v + x * (a + 0.5 * x * slope), a + x * slope
        passed += x
        ends[phase] = passed
    rows[3, 0] = sign * place
