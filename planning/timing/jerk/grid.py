"""Limits of velocity, acceleration and jerk on a path, on a grid made for jerk-limited motion.

From rest, at constant jerk j, s grows as j t^3 / 6. In s the squared speed then has no derivatives
at the ends. So the path is described by a parameter tau of its own, s = phi(tau), that leaves rest
the same way: with phi' = u^2 (6 - 8 u + 3 u^2), u = tau / T from 0 to 1, which goes over into
phi' = 1 with two continuous derivatives. Of c = (dtau/dt)^2 nothing is asked then at the ends, and
the motion is at rest there with no acceleration. With Q(tau) = q(phi(tau)),

    dq/dt^2 = Q'^2 c,    d2q/dt2 = Q'' c + Q' c'/2,
    d3q/dt3 = sqrt(c) (Q''' c + 3 Q'' c'/2 + Q' c''/2).

Limits of velocity, acceleration and jerk on a spline of the squared speed, evaluated in kernels.

With x = c(tau) the square of dtau/dt on a path q(tau), the limits of velocity, acceleration and
jerk on the path are

    c <= x_max,    lo <= e c + f c' <= up,    |w c + r c' + p c''| <= c^(-1/2),

and the time is the integral of c^(-1/2). Let c be a quadratic B-spline: with cell lengths h_k, the
unknown z_k belonging to cell k, and knot i between the cells i and i + 1,

    C_i = (h_(i+1) z_i + h_i z_(i+1)) / (h_i + h_(i+1)),
    D_i = 2 (z_(i+1) - z_i) / (h_i + h_(i+1))

are c and c' at the knot, and c'' = (D_k - D_(k-1)) / h_k all over cell k. Two cells of length 0 at
the ends carry c at the ends.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from planning.timing.path.path import JointPath
from planning.timing.speed.effort_limits import Extra, KnotLimits


class JerkLimits(NamedTuple):
    """Limits on c over N cells.

    Args:
        lengths: Lengths of the cells, 0 at both ends, shape (N + 2,).
        caps: Largest c at the knots, inf where there is none, shape (N + 1,).
        knot_rows: (e, f, lo, up) of lo <= e c + f c' <= up, shape (N + 1, R, 4).
        knot_counts: How many rows of each knot count, shape (N + 1,).
        jerk_rows: (w, r, p) of |w c + r c' + p c''| <= c^(-1/2) at the two ends of each cell,
            shape (N, 2, S, 3).
        jerk_counts: How many rows of each cell count, shape (N,).
        pulls: Time that c at the two ends is made to stand for, so that it is as large as can be
            although it hardly matters for the true time, shape (2,).
    """

    lengths: Array
    caps: Array
    knot_rows: Array
    knot_counts: NDArray[np.int64]
    jerk_rows: Array
    jerk_counts: NDArray[np.int64]
    pulls: Array


@kernel(allocates=False)
def knot_kernel(h: Array, z: Array, i: int) -> tuple[float, float]:
    """C_i and D_i."""
    total = h[i] + h[i + 1]
    c = (h[i + 1] * z[i] + h[i] * z[i + 1]) / total
    d = 2.0 * (z[i + 1] - z[i]) / total
    return c, d


@kernel(allocates=False)
def jerk_at_kernel(row: Array, c: float, d: float, e: float) -> float:
    """The linear part w c + r c' + p c'' of a jerk row."""
    value: float = row[0] * c + row[1] * d + row[2] * e
    return value


@kernel
def inside_kernel(rows: JerkLimits, z: Array) -> bool:
    """Whether every limit is kept strictly."""
    h, caps, knot_rows, knot_counts, jerk_rows, jerk_counts = rows[:6]
    cells = h.shape[0] - 2
    for k in range(cells + 2):
        if not z[k] > 0.0:
            return False
    for i in range(cells + 1):
        c, d = knot_kernel(h, z, i)
        if not c < caps[i]:
            return False
        for k in range(knot_counts[i]):
            value = knot_rows[i, k, 0] * c + knot_rows[i, k, 1] * d
            if not knot_rows[i, k, 2] < value < knot_rows[i, k, 3]:
                return False
    for k in range(1, cells + 1):
        c0, d0 = knot_kernel(h, z, k - 1)
        c1, d1 = knot_kernel(h, z, k)
        e = (d1 - d0) / h[k]
        bound0, bound1 = 1.0 / math.sqrt(c0), 1.0 / math.sqrt(c1)
        for j in range(jerk_counts[k - 1]):
            if not abs(jerk_at_kernel(jerk_rows[k - 1, 0, j], c0, d0, e)) < bound0:
                return False
            if not abs(jerk_at_kernel(jerk_rows[k - 1, 1, j], c1, d1, e)) < bound1:
                return False
    return True


@kernel
def decisive_kernel(rows: JerkLimits, z: Array, share: float) -> JerkLimits:
    """The limits of which more than a share is used at z, and all caps; the others don't count."""
    h, caps, knot_rows, knot_counts, jerk_rows, jerk_counts, pulls = rows
    cells = h.shape[0] - 2
    knots, knots_left = knot_rows.copy(), np.zeros_like(knot_counts)
    jerks, jerks_left = jerk_rows.copy(), np.zeros_like(jerk_counts)
    for i in range(cells + 1):
        c, d = knot_kernel(h, z, i)
        for k in range(knot_counts[i]):
            value = knot_rows[i, k, 0] * c + knot_rows[i, k, 1] * d
            if value > share * knot_rows[i, k, 3] or value < share * knot_rows[i, k, 2]:
                knots[i, knots_left[i]] = knot_rows[i, k]
                knots_left[i] += 1
    for k in range(1, cells + 1):
        c0, d0 = knot_kernel(h, z, k - 1)
        c1, d1 = knot_kernel(h, z, k)
        e = (d1 - d0) / h[k]
        steepest = 0.0
        for j in range(jerk_counts[k - 1]):
            steepest = max(steepest, abs(jerk_rows[k - 1, 0, j, 2]))
        for j in range(jerk_counts[k - 1]):
            # That of the joint that moves most always counts: nothing else keeps c from swinging.
            leads = abs(jerk_rows[k - 1, 0, j, 2]) == steepest
            used0 = abs(jerk_at_kernel(jerk_rows[k - 1, 0, j], c0, d0, e)) * math.sqrt(c0)
            used1 = abs(jerk_at_kernel(jerk_rows[k - 1, 1, j], c1, d1, e)) * math.sqrt(c1)
            if leads or max(used0, used1) > share:
                jerks[k - 1, :, jerks_left[k - 1]] = jerk_rows[k - 1, :, j]
                jerks_left[k - 1] += 1
    return JerkLimits(h, caps, knots, knots_left, jerks, jerks_left, pulls)


@kernel
def time_kernel(rows: JerkLimits, z: Array) -> float:
    """The time that is made the least: the integral of c^(-1/2), each cell at its own z."""
    time = 0.0
    for k in range(z.shape[0]):
        time += weight_kernel(rows, k) / math.sqrt(z[k])
    return time


@kernel(allocates=False)
def weight_kernel(rows: JerkLimits, k: int) -> float:
    """Weight of z_k in the integral over tau."""
    weight: float = rows.lengths[k]
    if k == 0:
        weight = rows.pulls[0]
    elif k == rows.lengths.shape[0] - 1:
        weight = rows.pulls[1]
    return weight


@kernel(allocates=False)
def count_kernel(rows: JerkLimits) -> int:
    """Number of limits."""
    count = 0
    for i in range(rows.caps.shape[0]):
        count += 2 * rows.knot_counts[i] + (1 if rows.caps[i] < np.inf else 0)
    for k in range(rows.jerk_counts.shape[0]):
        count += 4 * rows.jerk_counts[k]
    return count


@kernel
def envelope_kernel(h: Array, rises: Array, z: Array) -> None:
    """Lower z until no step from cell to cell is above ``rises`` (N + 1,), and smooth it."""
    cells = h.shape[0] - 2
    for i in range(cells + 1):
        z[i + 1] = min(z[i + 1], z[i] + rises[i])
    for i in range(cells, -1, -1):
        z[i] = min(z[i], z[i + 1] + rises[i])
    # How often the first guess is smoothed: without, its kinks would ask for jerk without end.
    for _ in range(3):
        z[0], z[cells + 1] = z[1], z[cells]
        before = z[0]
        for k in range(1, cells + 1):
            here = z[k]
            z[k] = math.sqrt(math.sqrt(before * z[k + 1]) * here)
            before = here
    z[0], z[cells + 1] = z[1], z[cells]


@kernel
def scale_kernel(rows: JerkLimits, z: Array, inside: float) -> bool:
    """Make z the part ``inside`` of its largest multiple inside all limits; False if none is."""
    low, high = -1.0, 1.0
    while not inside_kernel(rows, z * math.exp(low)):
        low *= 2.0
        if not low > -500.0:
            return False
    for _ in range(8):
        middle = 0.5 * (low + high)
        if inside_kernel(rows, z * math.exp(middle)):
            low = middle
        else:
            high = middle
    z *= inside * math.exp(low)
    return True


@kernel
def start_kernel(rows: JerkLimits, z: Array) -> bool:
    """Write a shape between constant and as fast as the limits allow place by place, inside all.

    Args:
        rows: The limits.
        z: Filled, shape (N + 2,).

    Returns:
        False where not even standing nearly still is inside.
    """
    caps, rises = np.empty(rows.caps.shape[0]), np.empty(rows.caps.shape[0])
    _still_kernel(rows, caps, rises)
    last, shape = z.shape[0] - 1, np.empty(z.shape[0])
    for k in range(1, last):
        shape[k] = min(caps[k - 1], caps[k])
    shape[0], shape[last] = shape[1], shape[last - 1]
    envelope_kernel(rows.lengths, rises, shape)
    best, found = np.inf, False
    # First guesses are these powers of the highest speeds place by place, as fast as stays inside.
    for power in (1.0, 0.7, 0.4, 0.0):
        trial = shape**power
        if not scale_kernel(rows, trial, 0.7):
            continue
        time = time_kernel(rows, trial)
        if not found or time < best:
            best, found = time, True
            z[:] = trial
    return found


@kernel(allocates=False)
def _still_kernel(rows: JerkLimits, caps: Array, rises: Array) -> None:
    """Write the largest c at each knot where c stands still, and its largest change to the next."""
    h, last = rows.lengths, rows.caps.shape[0] - 1
    for i in range(last + 1):
        cap, slope = rows.caps[i], np.inf
        for k in range(rows.knot_counts[i]):
            e, f, low, high = rows.knot_rows[i, k]
            if e > 0.0:
                cap = min(cap, high / e)
            elif e < 0.0:
                cap = min(cap, low / e)
            if f != 0.0:
                slope = min(slope, min(high, -low) / abs(f))
        for cell, end in ((i, 0), (i - 1, 1)):
            for k in range(rows.jerk_counts[cell] if 0 <= cell < last else 0):
                most = abs(rows.jerk_rows[cell, end, k, 0])
                if most > 0.0:
                    cap = min(cap, most ** (-2.0 / 3.0))
        caps[i], rises[i] = cap, 0.5 * slope * (h[i] + h[i + 1])


# phi(T) / T: the length of a ramp for each unit of tau.
_RAMP = 0.6


class Grid(NamedTuple):
    """Knots on a path and the limits upon them.

    Args:
        places: s at the knots, shape (N + 1,).
        speeds: ds/dtau and d2s/dtau2 at the knots, shape (2, N + 1).
        pieces: The path's piece of each cell, shape (N,).
        rows: The limits.
    """

    places: Array
    speeds: Array
    pieces: NDArray[np.int64]
    rows: JerkLimits


class _Pace(NamedTuple):
    """phi: ramps of length ``first`` and ``last`` at the two ends of a way of some length."""

    length: float
    first: float
    last: float

    def tau(self, s: Array) -> Array:
        """The parameter at places s."""
        ahead = np.minimum(s, self.first)
        behind = np.minimum(self.length - s, self.last)
        cruise = s - ahead - (self.last - behind)
        return np.asarray(_ramp_time(ahead, self.first) + cruise - _ramp_time(behind, self.last))

    def derivatives(self, s: Array) -> Array:
        """phi', phi'' and phi''' at places s, shape (3, k)."""
        answer = np.zeros((3, len(s)))
        answer[0] = 1.0
        for sign, away, length in ((1.0, s, self.first), (-1.0, self.length - s, self.last)):
            within = away < length
            if not within.any():
                continue
            T = length / _RAMP
            u = _inverse(away[within] / T)
            answer[0, within] = u**2 * (6.0 - 8.0 * u + 3.0 * u**2)
            answer[1, within] = sign * 12.0 * u * (1.0 - u) ** 2 / T
            answer[2, within] = 12.0 * (1.0 - u) * (1.0 - 3.0 * u) / T**2
        return answer


def _ramp_time(away: Array, length: float) -> Array:
    if length == 0.0:
        return np.zeros_like(away)
    T = length / _RAMP
    times = np.full(away.shape, T)
    within = away < length
    times[within] = T * _inverse(away[within] / T)
    return times


@kernel
def _inverse(y: Array) -> Array:
    """The u in [0, 1] with 2 u^3 - 2 u^4 + 0.6 u^5 = y, by Newton's method from above."""
    answer = np.empty_like(y)
    for i in range(y.shape[0]):
        u = min((y[i] / 0.6) ** (1.0 / 3.0), 1.0)
        # Steps of Newton's method.
        for _ in range(60):
            value = u**3 * (2.0 - 2.0 * u + 0.6 * u**2) - y[i]
            slope = u**2 * (6.0 - 8.0 * u + 3.0 * u**2)
            step = value / slope if slope > 0.0 else 0.0
            u = min(max(u - step, 0.0), 1.0)
            if abs(step) < 1e-15:
                break
        answer[i] = u
    return answer


class Cells(NamedTuple):
    """Numbers of the cells of a grid.

    Args:
        straight: On each straight piece of the path.
        curved: On each curved one.
        ramp: On the ways at the two ends on which speeds change most.
    """

    straight: int
    curved: int
    ramp: int


# On curves, and where further limits bind: with twice as many the duration falls by hundredths.
_FINE = Cells(10, 6, 18)
# On rounded polylines, whose legs get closed forms: finer ones save a hundredth of the time.
_FEW = Cells(4, 4, 6)


class KnotPlaces(NamedTuple):
    """Knots on a path.

    Args:
        places: s at the knots, shape (N + 1,).
        pieces: The path's piece of each cell, shape (N,).
        straight: Whether pieces are straight, shape (p,).
        pace: ds/dtau and two further derivatives at the knots, shape (3, N + 1).
    """

    places: Array
    pieces: Indices
    straight: NDArray[np.bool_]
    pace: Array


def grid(
    path: JointPath,
    limits: Array,
    speeds: tuple[float, float] = (0.0, 0.0),
    extra: Extra | None = None,
    cells: Cells | None = None,
) -> Grid:
    """The grid on a path without sharp corners.

    Args:
        path: Pieces of degree at most 3 with continuous second derivatives.
        limits: Limits of velocity (inf where there is none), acceleration and jerk, shape (3, n).
        speeds: ds/dt at the two ends, at most.
        extra: Further limits.
        cells: Numbers of the cells; as many as the path needs where None.
    """
    c, breaks = path.coefficients, path.breaks
    straight = ~(c[:, :, 2:] != 0.0).any(axis=(1, 2))
    pace, ramps = _pace(path, limits, speeds)
    if cells is None:
        cells = _FEW if extra is None and straight.any() else _FINE
    places = _knots(breaks, straight, ramps, [speed == 0.0 for speed in speeds], cells)
    pieces = np.searchsorted(breaks, 0.5 * (places[1:] + places[:-1]), side="right") - 1
    phi, size = pace.derivatives(places), len(pieces)
    jerk_rows, knot_rows = np.empty((size, 2, path.n, 3)), np.empty((size + 1, path.n, 4))
    caps = np.full(size + 1, np.inf)
    at = KnotPlaces(places, pieces, straight, phi)
    limit_rows_kernel(c, breaks, at, limits, caps, knot_rows, jerk_rows)
    flat = straight[pieces]
    for end, speed in ((0, speeds[0]), (-1, speeds[1])):
        if speed > 0.0:
            caps[end] = min(caps[end], speed**2)
    counts = np.where(np.append(flat, True) & np.append(True, flat), 1, path.n)
    if extra is not None:
        caps, knot_rows, counts = _with_extra(extra(path, places), phi, caps, knot_rows, counts)
    # A speed asked for at an end counts like this part of the path run through at it.
    rows = JerkLimits(
        np.concatenate([[0.0], np.diff(pace.tau(places)), [0.0]]),
        caps,
        np.ascontiguousarray(knot_rows),
        counts.astype(np.int64),
        jerk_rows,
        np.where(flat, 1, path.n).astype(np.int64),
        np.where(np.array(speeds) > 0.0, 0.1 * float(breaks[-1]), 0.0),
    )
    return Grid(places, phi[:2], pieces.astype(np.int64), rows)


@kernel
def limit_rows_kernel(
    coefficients: Array,
    breaks: Array,
    at: KnotPlaces,
    limits: Array,
    caps: Array,
    knot_rows: Array,
    jerk_rows: Array,
) -> None:
    """Write the limits of ``JerkLimits``.

    Where all about a knot or in a cell is straight the row of the tightest joint comes first: it
    decides for all.

    Args:
        coefficients: Coefficients of the path, shape (p, n, d + 1), d at most 3.
        breaks: Breaks of the path, shape (p + 1,).
        at: The knots.
        limits: Limits of velocity, acceleration and jerk, shape (3, n).
        caps: Comes as inf, shape (N + 1,).
        knot_rows: Shape (N + 1, n, 4).
        jerk_rows: Shape (N, 2, n, 3).
    """
    (n, size), cells = coefficients.shape[1:], at.pieces.shape[0]
    for k in range(cells):
        piece = at.pieces[k]
        leads, lead = -1.0, 0
        for end in range(2):
            i, u = k + end, at.places[k + end] - breaks[piece]
            p1, p2, p3 = at.pace[0, i], at.pace[1, i], at.pace[2, i]
            is_knot = end == 0 or k == cells - 1
            tightest, first = -1.0, 0
            for j in range(n):
                c = coefficients[piece, j]
                c2, c3 = c[2] if size > 2 else 0.0, c[3] if size > 3 else 0.0
                q1, q2, q3 = c[1] + (2.0 * c2 + 3.0 * c3 * u) * u, 2.0 * c2 + 6.0 * c3 * u, 6.0 * c3
                Q1, Q2 = q1 * p1, q2 * p1 * p1 + q1 * p2
                Q3 = q3 * p1**3 + 3.0 * q2 * p1 * p2 + q1 * p3
                row = jerk_rows[k, end, j]
                row[0], row[1], row[2] = Q3, 1.5 * Q2, 0.5 * Q1
                for m in range(3):
                    row[m] /= limits[2, j]
                if end == 0 and abs(q1) / limits[2, j] > leads:
                    leads, lead = abs(q1) / limits[2, j], j
                if is_knot:
                    row = knot_rows[i, j]
                    row[0], row[1] = Q2 / limits[1, j], 0.5 * Q1 / limits[1, j]
                    row[2], row[3] = -1.0, 1.0
                    if Q1 != 0.0:
                        caps[i] = min(caps[i], (limits[0, j] / Q1) ** 2)
                    if abs(q1) / limits[1, j] > tightest:
                        tightest, first = abs(q1) / limits[1, j], j
            flat = at.straight[piece] and (k == 0 or end == 1 or at.straight[at.pieces[k - 1]])
            if is_knot and flat:
                knot_rows[i, 0] = knot_rows[i, first]
        if at.straight[piece]:
            for end in range(2):
                jerk_rows[k, end, 0] = jerk_rows[k, end, lead]


def _with_extra(
    more: KnotLimits, phi: Array, caps: Array, rows: Array, counts: NDArray[np.int64]
) -> tuple[Array, Array, NDArray[np.int64]]:
    """Further limits in terms of c, put before those that are there already."""
    speed, bend = phi[0][:, None], phi[1][:, None]
    with np.errstate(divide="ignore"):
        caps = np.minimum(caps, more.caps / phi[0] ** 2)
    a, b, low, high = np.moveaxis(more.rows, -1, 0)
    added = np.stack([a * bend + b * speed**2, 0.5 * a * speed, low, high], axis=-1)
    return caps, np.concatenate([added, rows], axis=1), counts + added.shape[1]


def _pace(
    path: JointPath, limits: Array, speeds: tuple[float, float]
) -> tuple[_Pace, tuple[float, float]]:
    """The pace, and the ways at the two ends on which speeds change most."""
    length = float(path.breaks[-1])
    slopes = np.abs(path.sample([0.0, length], 1))
    # A ramp takes at most this part of the way.
    ramps = [min(_ramp(slope, limits), 0.4 * length) for slope in slopes]
    resting = [ramp if speed == 0.0 else 0.0 for ramp, speed in zip(ramps, speeds, strict=True)]
    return _Pace(length, resting[0], resting[1]), (ramps[0], ramps[1])


def _ramp(slope: Array, limits: Array) -> float:
    """The way that it takes to get from rest to full speed in a straight line."""
    with np.errstate(divide="ignore"):
        v, a, j = (limits / slope).min(axis=1)
    if not np.isfinite(j):
        return np.inf
    v = min(v, 1e6 * a * a / j)
    time = v / a + a / j if v * j > a * a else 2.0 * np.sqrt(v / j)
    return float(0.5 * v * time)


def _knots(
    breaks: Array,
    straight: NDArray[np.bool_],
    ramps: tuple[float, float],
    resting: Sequence[bool],
    numbers: Cells,
) -> Array:
    """Places of the knots: all breaks of the path, and others between them."""
    # Cells of all curved pieces, if each has one at least: they are short where they are many.
    most = 3000 // max(1, int((~straight).sum()))
    counts = np.where(straight, numbers.straight, max(1, min(numbers.curved, most)))
    owners = np.repeat(np.arange(len(counts)), counts)
    u = (np.arange(len(owners)) - (np.cumsum(counts) - counts)[owners]) / counts[owners]
    # Speed changes most near corners: the first and last cell of a leg have a fifth of the mean.
    u = np.where(straight[owners], 0.2 * u + 0.8 * u**2 * (3.0 - 2.0 * u), u)
    base = breaks[owners] + u * np.diff(breaks)[owners]
    u = np.linspace(0.0, 1.0, numbers.ramp + 1)
    ramp = u**3 * (2.0 - 2.0 * u + 0.6 * u**2) / _RAMP
    # From rest s grows as t^3; an end that is passed at speed needs no knots close together.
    first, last = (ramp if still else u for still in resting)
    ramp = np.concatenate([ramps[0] * first, (breaks[-1] - ramps[1] * last)[::-1]])
    after = np.searchsorted(ramp, base).clip(1, len(ramp) - 1)
    away = np.minimum(np.abs(base - ramp[after - 1]), np.abs(ramp[after] - base))
    # Knots nearer to one of a ramp than this part of their piece's cells are one with it.
    free = np.union1d(base[away > 0.3 * (np.diff(breaks) / counts)[owners]], ramp)
    # Knots of our own give way to the path's.
    ends = np.searchsorted(free, breaks).clip(1, len(free) - 1)
    # Two knots nearer than this part of the cells about them are one.
    near = 0.3 * (free[ends] - free[ends - 1])
    keep = np.ones(len(free), dtype=np.bool_)
    keep[ends[free[ends] - breaks <= near]] = False
    keep[ends[breaks - free[ends - 1] <= near] - 1] = False
    return np.union1d(free[keep], breaks)
