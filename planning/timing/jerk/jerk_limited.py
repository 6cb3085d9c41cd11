"""The least time along a given path within velocity, acceleration and jerk limits.

The squared speed is a spline on a grid, found by an interior-point method. What comes of it is
turned into exact polynomials of time with continuous acceleration; straight legs are run through in
closed form between the states at their ends. Time is stretched by what the exact peaks exceed the
limits by: a hundredth as a rule, since on the grid they hold.
"""

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from kinematics.errors import InvalidOption
from kinematics.trajectory.polynomial import composed_pieces
from kinematics.trajectory.trajectory import Trajectory
from planning.timing.jerk.double_s import MAX_PHASES, line_phases, moving_leg_kernel
from planning.timing.jerk.grid import (
    Cells,
    Grid,
    JerkLimits,
    decisive_kernel,
    grid,
    inside_kernel,
    scale_kernel,
    slopes_kernel,
    start_kernel,
    tightened_kernel,
)
from planning.timing.jerk.interior_point import least_time_kernel
from planning.timing.options import TimingFailed
from planning.timing.path.path import SAME_DIRECTION, JointPath
from planning.timing.speed.effort_limits import Extra, KnotLimits, effort_rows, slow_down
from planning.timing.time_scaling import ScaledTime, dilate, motion_bounds, slowed_at_ends
from planning.values.limits import EffortLimits


@kernel
def phases_kernel(states: Array, phases: Array) -> bool:
    """Write (start, speed, acceleration / 2, jerk / 6, duration) of the phases; False if none fit.

    Args:
        states: (s, v, a) at the knots, shape (N + 1, 3). Accelerations between which no phases fit
            are lowered.
        phases: Shape (2 N, 5).
    """
    for _ in range(states.shape[0]):
        fits = True
        for i in range(states.shape[0] - 1):
            way, total = states[i + 1, 0] - states[i, 0], states[i, 1] + states[i + 1, 1]
            change = states[i + 1, 2] - states[i, 2]
            if not 12.0 * change * way <= 9.0 * total * total:
                # Between two of at most this size some do, whatever their signs.
                fits, most = False, 0.37 * total * total / way
                for row in states[i : i + 2]:
                    row[2] = min(max(row[2], -most), most)
        if fits:
            break
    for i in range(states.shape[0] - 1):
        s0, v0, a0 = states[i]
        s1, v1, a1 = states[i + 1]
        way, total = s1 - s0, v0 + v1
        square = 9.0 * total * total + 12.0 * (a0 - a1) * way
        h = 12.0 * way / (3.0 * total + math.sqrt(max(square, 0.0)))
        if not 0.0 < h < np.inf:
            return False
        A, B = (a1 - a0) / h, (v1 - v0 - a0 * h) / (h * h)
        j1, j2 = 4.0 * B - A, 3.0 * A - 4.0 * B
        half = 0.5 * h
        v, a = v0 + (a0 + 0.5 * j1 * half) * half, a0 + j1 * half
        s = s0 + (v0 + (0.5 * a0 + j1 * half / 6.0) * half) * half
        first, second = phases[2 * i], phases[2 * i + 1]
        first[0], first[1], first[2], first[3], first[4] = s0, v0, 0.5 * a0, j1 / 6.0, half
        second[0], second[1], second[2], second[3], second[4] = s, v, 0.5 * a, j2 / 6.0, half
    return True


@kernel
def ratios_kernel(
    coefficients: Array,
    pieces: NDArray[np.int64],
    breaks: Array,
    phases: Array,
    limits: Array,
    ratios: Array,
) -> None:
    """Write the largest ratios to the limits at both ends of both phases of each cell.

    Args:
        coefficients: Coefficients of the path, shape (p, n, d + 1), d at most 3.
        pieces: The path's piece of each cell, shape (N,).
        breaks: Breaks of the path, shape (p + 1,).
        phases: Phases as ``phases_kernel`` writes them, shape (2 N, 5).
        limits: Limits of velocity, acceleration and jerk, shape (3, n).
        ratios: Shape (3, N).
    """
    for i in range(pieces.shape[0]):
        worst_v, worst_a, worst_j = 0.0, 0.0, 0.0
        for phase in range(2 * i, 2 * i + 2):
            start, one, two, three, h = phases[phase]
            for end in range(2):
                t = end * h
                u = start + (one + (two + three * t) * t) * t - breaks[pieces[i]]
                v = one + (2.0 * two + 3.0 * three * t) * t
                a, j = 2.0 * two + 6.0 * three * t, 6.0 * three
                for joint in range(coefficients.shape[1]):
                    q1, q2, q3 = slopes_kernel(coefficients[pieces[i], joint], u)
                    worst_v = max(worst_v, abs(q1 * v) / limits[0, joint])
                    worst_a = max(worst_a, abs(q1 * a + q2 * v * v) / limits[1, joint])
                    third = q1 * j + 3.0 * q2 * v * a + q3 * v * v * v
                    worst_j = max(worst_j, abs(third) / limits[2, joint])
        ratios[0, i], ratios[1, i], ratios[2, i] = worst_v, worst_a, worst_j


class Pieces(NamedTuple):
    """Pieces of a motion, not yet checked.

    Args:
        breaks: Shape (m + 1,) [s].
        coefficients: Shape (m, n, k).
    """

    breaks: Array
    coefficients: Array


@kernel
def legs_kernel(
    breaks: Array,
    coefficients: Array,
    limits: Array,
    given: Array,
    owners: Indices,
    phases: Array,
    whose: Indices,
) -> int:
    """Write phases with those of straight pieces in closed form, where that is no slower.

    Args:
        breaks: Breaks of the path, shape (p + 1,).
        coefficients: Coefficients of the path, shape (p, n, d + 1).
        limits: Limits of velocity, acceleration and jerk, shape (3, n).
        given: Phases, their starts along their pieces, shape (M, 5).
        owners: The path's piece of each, shape (M,).
        phases: Room for the phases, shape (M + MAX_PHASES + 2, 5).
        whose: Likewise for the path's piece of each.

    Returns:
        The number of the phases.
    """
    along = np.empty(3)
    used, first, whole = 0, 0, given[:, 4].sum()
    while first < given.shape[0]:
        piece, last, time, count = owners[first], first, 0.0, 0
        while last < given.shape[0] and owners[last] == piece:
            time += given[last, 4]
            last += 1
        bend = 0.0
        along[:] = np.inf
        for joint in range(coefficients.shape[1]):
            for k in range(2, coefficients.shape[2]):
                bend = max(bend, abs(coefficients[piece, joint, k]))
            for row in range(3):
                limit = limits[row, joint] / abs(coefficients[piece, joint, 1])
                along[row] = min(along[row], limit)
        if bend == 0.0:
            begin, end = given[first], given[last - 1]
            start = begin[1], 2.0 * begin[2]
            speed = end[1] + (2.0 * end[2] + 3.0 * end[3] * end[4]) * end[4]
            finish = speed, 2.0 * end[2] + 6.0 * end[3] * end[4]
            length = breaks[piece + 1] - breaks[piece]
            count = moving_leg_kernel(start, finish, length, along, phases[used:])
            # What is found on the grid may be that much too fast between its knots. A phase that is
            # this short in a long motion is lost in the rounding of its time.
            made = phases[used : used + count, 4]
            if made.sum() > 1.01 * time or (made < 1e-12 * whole).any():
                count = 0
        if count == 0:
            count = last - first
            phases[used : used + count] = given[first:last]
        whose[used : used + count] = piece
        used += count
        first = last
    return used


#: What the time found may exceed the least one on the grid by, as a part of it.
TOLERANCE = 3e-3
# The same for a rough motion, and its cells: finer ones make the spline near it hardly faster.
_ROUGH_TOLERANCE, _ROUGH_CELLS = 0.2, Cells(4, 3, 6)
_NEARLY_INSIDE = 0.95
_ROUNDS = 2


def time_path_with_jerk(
    path: JointPath,
    joint_names: Sequence[str],
    velocity: ArrayLike,
    acceleration: ArrayLike,
    jerk: ArrayLike,
    *,
    end_speeds: tuple[float, float] = (0.0, 0.0),
    loads: EffortLimits | None = None,
) -> ScaledTime:
    """The path run through in little more than the least time that a bounded jerk allows.

    The trajectory follows the path exactly; its acceleration is continuous and 0 at both ends. It
    stops at sharp corners. On a path of degree d the pieces have degree 3 d.

    Args:
        path: Path to follow, of degree at most 3, d2q/ds2 continuous but at its sharp corners.
        joint_names: n names.
        velocity: Limits, shape (n,), inf where there is none [rad/s or m/s].
        acceleration: Limits, shape (n,) [rad/s^2 or m/s^2].
        jerk: Limits, shape (n,) [rad/s^3 or m/s^3].
        end_speeds: ds/dt at the start and at the end.
        loads: Limits of torque and tool speed.

    Returns:
        The trajectory, and the factor by which time was stretched so that every exact peak ratio
        is at most 1.

    Raises:
        InvalidOption: A limit is not positive and finite (the velocity's may be inf), or the
            path's second derivative jumps.
        TimingFailed: Nothing was found, say since boundary speeds can't be kept.
    """
    limits = motion_bounds(path.n, velocity, acceleration, jerk)
    if not np.isfinite(limits[1:]).all():
        raise InvalidOption(
            "each joint needs finite acceleration and jerk limits to be timed with bounded jerk",
            hint="Only a velocity limit may be missing.",
        )
    _check_smooth(path)
    extra = None if loads is None else effort_rows(loads)

    def make(speeds: tuple[float, float]) -> ScaledTime:
        return ScaledTime(
            Trajectory(tuple(joint_names), *_sections(path, limits, speeds, extra)), 1.0
        )

    def slow(made: ScaledTime) -> ScaledTime:
        scaled = dilate(made.trajectory, *limits)
        return scaled if loads is None else slow_down(loads, scaled)

    return slowed_at_ends(make, slow, end_speeds)


def rough_pieces(path: JointPath, limits: Array) -> Pieces:
    """A motion along a path from rest to rest in about the least time, found in a moment.

    Between the knots of its few cells it may exceed the limits.

    Args:
        path: Path to follow, as ``time_path_with_jerk`` takes it.
        limits: Limits of velocity (inf where there is none), acceleration and jerk, shape (3, n).

    Raises:
        TimingFailed: No speed along the path was found.
    """
    return _sections(path, limits, (0.0, 0.0), None, rough=True)


def _sections(
    path: JointPath,
    limits: Array,
    speeds: tuple[float, float],
    extra: Extra | None,
    *,
    rough: bool = False,
) -> Pieces:
    """The pieces of the motion, from stop to stop."""
    durations, coefficients = [np.zeros(1)], []
    stops = [0, *path.corners, len(path.lengths)]
    for first, last in itertools.pairwise(stops):
        section = path
        if len(stops) > 2:
            section = JointPath(path.coefficients[first:last], path.lengths[first:last])
        ends = (speeds[0] if first == 0 else 0.0, speeds[1] if last == stops[-1] else 0.0)
        straight = last == first + 1 and not section.coefficients[:, :, 2:].any()
        if straight and extra is None:
            with np.errstate(divide="ignore"):
                along = (limits / np.abs(section.coefficients[0, :, 1])).min(axis=1)
            phases = line_phases(float(section.lengths[0]), along, *ends)
            owners = np.zeros(len(phases), dtype=np.int64)
        else:
            phases, owners = _curved_phases(section, limits, ends, extra, rough=rough)
        durations.append(phases[:, 4])
        coefficients.append(composed_pieces(section.coefficients, owners, phases, 3))
    breaks = np.cumsum(np.concatenate(durations))
    # Phases of a short section are lost in the rounding of the time of a long one before it.
    if not (np.diff(breaks) > 0.0).all():
        raise _no_speed()
    return Pieces(breaks, np.concatenate(coefficients))


def _curved_phases(
    path: JointPath,
    limits: Array,
    speeds: tuple[float, float],
    extra: Extra | None,
    *,
    rough: bool,
) -> tuple[Array, Indices]:
    """The phases of a section, their starts within the path's pieces, and those pieces."""
    made = grid(path, limits, speeds, extra, _ROUGH_CELLS if rough else None)
    on_spline = made.limits
    z = np.empty(len(on_spline.lengths))
    if not start_kernel(on_spline, z):
        raise _no_speed()
    # Barrier parameter at the start from a first guess, far from the limits, and what the time may
    # exceed the least one by: the first round only shows where limits between knots are exceeded.
    least_time_kernel(on_spline, z, 0.3, _ROUGH_TOLERANCE if rough else 1e-2)
    for rounds in range(_ROUNDS + 1):
        phases = _phases(made, z, speeds)
        if rough:
            break
        ratios = np.empty((3, len(made.pieces)))
        ratios_kernel(path.coefficients, made.pieces, path.breaks, phases, limits, ratios)
        if extra is not None:
            _widen(ratios, extra(path, phases[1::2, 0]), phases[1::2])
        excess = max(float(r.max()) ** (1.0 / k) for k, r in enumerate(ratios, 1))
        # Where the motion between knots takes longer than this without exceeding limits, they are
        # lowered there and the speeds found anew: of the excess hardly a tenth is left each time.
        if excess < 1.01 or rounds == _ROUNDS:
            break
        on_spline = tightened_kernel(on_spline, ratios)
        # What is outside by less than this is mended in the next round, if there is one.
        z = _faster(on_spline, z, 0.8 if rounds + 1 < _ROUNDS else _NEARLY_INSIDE)
    owners = np.repeat(made.pieces, 2)
    phases[:, 0] -= path.breaks[owners]
    if extra is not None:
        return phases, owners
    size = len(phases) + MAX_PHASES + 2
    made_phases, whose = np.empty((size, 5)), np.empty(size, dtype=np.int64)
    used = legs_kernel(path.breaks, path.coefficients, limits, phases, owners, made_phases, whose)
    return made_phases[:used], whose[:used]


def _faster(limits: JerkLimits, z: Array, enough: float) -> Array:
    """The least time from a z that is nearly right, by the limits that matter.

    Where that is not inside all limits even when made smaller by ``enough``, by all of them.
    """
    # Limits that less than this part of is used hardly matter to the next round, which leaves them
    # out.
    decisive = decisive_kernel(limits, z, 0.3)
    found = z.copy()
    if not scale_kernel(decisive, found, _NEARLY_INSIDE):
        raise _no_speed()
    # Barrier parameter at the start from a guess that is nearly right [-].
    near = 0.03
    least_time_kernel(decisive, found, near, TOLERANCE)
    if inside_kernel(limits, enough * found):
        return found
    z = z.copy()
    if not scale_kernel(limits, z, _NEARLY_INSIDE):
        raise _no_speed()
    least_time_kernel(limits, z, near, TOLERANCE)
    return z


def _widen(ratios: Array, more: KnotLimits, middles: Array) -> None:
    """Let the ratios (3, N) take in further limits in the middle of each cell."""
    v, a = middles[:, 1], 2.0 * middles[:, 2]
    ratios[0] = np.maximum(ratios[0], v / np.sqrt(more.caps))
    along, square, low, high = np.moveaxis(more.rows, -1, 0)
    value = along * a[:, None] + square * (v**2)[:, None]
    over = np.maximum(value / high, value / low).max(axis=1, initial=0.0)
    ratios[1] = np.maximum(ratios[1], over)


def _phases(made: Grid, z: Array, speeds: tuple[float, float]) -> Array:
    """Two phases a cell, shape (2 N, 5), their starts along the whole path."""
    h = made.limits.lengths
    both = h[:-1] + h[1:]
    c, slope = (h[1:] * z[:-1] + h[:-1] * z[1:]) / both, 2.0 * np.diff(z) / both
    speed, bend = made.speeds
    v, a = speed * np.sqrt(c), bend * c + 0.5 * speed * slope
    for end, wanted in ((0, speeds[0]), (-1, speeds[1])):
        # Boundary speeds are met this well before they are set right.
        if wanted > 0.0 and abs(v[end] - wanted) > 0.02 * wanted:
            raise TimingFailed(
                f"a boundary speed of {wanted:.6g} along the path is not possible without "
                f"acceleration: {v[end]:.6g} is",
                hint="Give a lower boundary velocity, or higher limits.",
            )
        v[end] = wanted
    phases = np.empty((2 * len(made.pieces), 5))
    if not phases_kernel(np.column_stack([made.places, v, a]), phases):
        raise _no_speed()
    return phases


def _no_speed() -> TimingFailed:
    return TimingFailed(
        "no speed along the path was found that keeps all limits",
        hint="Look for limits or lengths of very different sizes.",
    )


def _check_smooth(path: JointPath) -> None:
    """Refuse what no bounded jerk can follow."""
    # On a path of a higher degree the pieces of time would be of a degree above 9: too many digits
    # go.
    max_degree = 3
    if path.coefficients.shape[2] - 1 > max_degree:
        raise InvalidOption(f"a path of a degree above {max_degree} can't be timed with its jerk")
    c, u = path.coefficients, path.lengths[:, None]
    powers = np.arange(c.shape[2])
    bends = c * powers * (powers - 1)
    leaving = sum(bends[:, :, k] * u ** (k - 2) for k in range(2, c.shape[2]))
    if not np.any(bends):
        return
    jumps = np.abs(2.0 * c[1:, :, 2] - np.asarray(leaving)[:-1]).max(axis=1)
    jumps[np.array(path.corners, dtype=np.int64) - 1] = 0.0
    # What rounding of the positions leaves of a second derivative.
    shorter = np.minimum(u[1:, 0], u[:-1, 0])
    rounding = 1e-14 * float(np.abs(c[:, :, 0]).max()) / shorter**2
    over = jumps - 1e3 * SAME_DIRECTION * float(np.abs(bends).max()) - rounding
    if over.max(initial=0.0) > 0.0:
        place = int(np.argmax(over)) + 1
        raise InvalidOption(
            f"the second derivative of the path jumps at the start of its piece {place}",
            hint="Round corners by cubics, which blend(..., smooth=True) does.",
        )
