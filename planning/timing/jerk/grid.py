"""Limits of velocity, acceleration and jerk on a path, on a grid made for jerk-limited motion.

From rest, at constant jerk j, s grows as j t^3 / 6. In s the squared speed then has no derivatives
at the ends. So the path is described by a parameter tau of its own, s = phi(tau), that leaves rest
the same way: with phi' = u^2 (6 - 8 u + 3 u^2), u = tau / T from 0 to 1, which goes over into
phi' = 1 with two continuous derivatives. Of c = (dtau/dt)^2 nothing is asked then at the ends, and
the motion is at rest there with no acceleration. With Q(tau) = q(phi(tau)),

    dq/dt^2 = Q'^2 c,    d2q/dt2 = Q'' c + Q' c'/2,
    d3q/dt3 = sqrt(c) (Q''' c + 3 Q'' c'/2 + Q' c''/2).

With x = c(tau) the square of dtau/dt on a path q(tau), each limit of velocity, acceleration or jerk
is one of

    low - m c^(-1/2) <= w c + r c' + p c'' <= high + m c^(-1/2),

with m = 1 for the jerk and 0 for the others, and the time is the integral of c^(-1/2). Let c be a
quadratic B-spline: with cell lengths h_k, the unknown z_k belonging to cell k, and knot i between
the cells i and i + 1,

    C_i = (h_(i+1) z_i + h_i z_(i+1)) / (h_i + h_(i+1)),
    D_i = 2 (z_(i+1) - z_i) / (h_i + h_(i+1))

are c and c' at the knot, and c'' = (D_k - D_(k-1)) / h_k all over cell k. Two cells of length 0 at
the ends carry c at the ends. Limits stand at places, the two ends of each cell in turn; those of
velocity and acceleration, which do not ask for c'', at one place of each knot.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from planning.timing.jerk.double_s import ramp_length
from planning.timing.path.path import JointPath
from planning.timing.speed.effort_limits import Extra, KnotLimits


class JerkLimits(NamedTuple):
    """Limits on c over N cells.

    Args:
        lengths: Lengths of the cells, 0 at both ends, shape (N + 2,).
        maps: Matrices from z of a place's cell and of the two beside it to c, c' and c'', shape
            (2 N, 3, 3).
        rows: (w, r, p, low, high, m) of the limits at each place, shape (2 N, R, 6). The first row
            of a knot is that of the velocity.
        counts: Number of rows of each place, shape (2 N,).
        pulls: Time that c at the two ends is made to stand for, so that it is as large as can be
            although it hardly matters for the true time, shape (2,).
    """

    lengths: Array
    maps: Array
    rows: Array
    counts: NDArray[np.int64]
    pulls: Array


@kernel(allocates=False)
def place_kernel(maps: Array, z: Array, i: int) -> tuple[float, float, float]:
    """c, c' and c'' at place i."""
    m, k = maps[i], i // 2
    a, b, c = z[k], z[k + 1], z[k + 2]
    return (
        m[0, 0] * a + m[0, 1] * b + m[0, 2] * c,
        m[1, 0] * a + m[1, 1] * b + m[1, 2] * c,
        m[2, 0] * a + m[2, 1] * b + m[2, 2] * c,
    )


@kernel(allocates=False)
def value_kernel(row: Array, c: float, d: float, e: float) -> float:
    """W c + r c' + p c'' of a row."""
    value: float = row[0] * c + row[1] * d + row[2] * e
    return value


@kernel(allocates=False)
def slacks_kernel(row: Array, value: float, root: float) -> tuple[float, float]:
    """How far a row's value is above its lower and below its upper bound, with c^(-1/2)."""
    low: float = value - row[3] + row[5] * root
    high: float = row[4] - value + row[5] * root
    return low, high


@kernel(allocates=False)
def inside_kernel(limits: JerkLimits, z: Array) -> bool:
    """Whether every limit is kept strictly."""
    for k in range(z.shape[0]):
        if not z[k] > 0.0:
            return False
    for i in range(limits.counts.shape[0]):
        c, d, e = place_kernel(limits.maps, z, i)
        root = 1.0 / math.sqrt(c)
        for k in range(limits.counts[i]):
            row = limits.rows[i, k]
            low, high = slacks_kernel(row, value_kernel(row, c, d, e), root)
            if not (low > 0.0 and high > 0.0):
                return False
    return True


@kernel
def decisive_kernel(limits: JerkLimits, z: Array, share: float) -> JerkLimits:
    """The limits of which more than a share is used at z, and those of the velocity."""
    rows, counts = np.empty_like(limits.rows), np.zeros_like(limits.counts)
    for i in range(counts.shape[0]):
        c, d, e = place_kernel(limits.maps, z, i)
        root, steepest = 1.0 / math.sqrt(c), 0.0
        for k in range(limits.counts[i]):
            steepest = max(steepest, abs(limits.rows[i, k, 2]))
        for k in range(limits.counts[i]):
            row = limits.rows[i, k]
            value = value_kernel(row, c, d, e)
            most = max(value / (row[4] + row[5] * root), value / (row[3] - row[5] * root))
            # The jerk of the joint that moves most always counts: nothing else keeps c from
            # swinging.
            leads = row[5] > 0.0 and abs(row[2]) == steepest
            if leads or most > share or (row[1] == 0.0 and row[2] == 0.0):
                rows[i, counts[i]] = row
                counts[i] += 1
    return JerkLimits(limits.lengths, limits.maps, rows, counts, limits.pulls)


@kernel
def tightened_kernel(limits: JerkLimits, ratios: Array) -> JerkLimits:
    """The limits, lower where the motion between its knots exceeds them by the ratios (3, N)."""
    rows, last = limits.rows.copy(), ratios.shape[1] - 1
    for i in range(rows.shape[0]):
        velocity, acceleration, knot = 1.0, 1.0, (i + 1) // 2
        for cell in range(max(knot - 1, 0), min(knot, last) + 1):
            velocity *= max(ratios[0, cell], 1.0) ** 2
            acceleration *= max(ratios[1, cell], 1.0)
        for k in range(limits.counts[i]):
            factor = velocity if k == 0 else acceleration
            if rows[i, k, 5] > 0.0:
                factor = max(ratios[2, i // 2], 1.0)
            for m in range(3):
                rows[i, k, m] *= factor
    return JerkLimits(limits.lengths, limits.maps, rows, limits.counts, limits.pulls)


@kernel(allocates=False)
def time_kernel(limits: JerkLimits, z: Array) -> float:
    """The time that is made the least: the integral of c^(-1/2), each cell at its own z."""
    time = 0.0
    for k in range(z.shape[0]):
        time += weight_kernel(limits, k) / math.sqrt(z[k])
    return time


@kernel(allocates=False)
def weight_kernel(limits: JerkLimits, k: int) -> float:
    """Weight of z_k in the integral over tau."""
    weight: float = limits.lengths[k]
    if k == 0:
        weight = limits.pulls[0]
    elif k == limits.lengths.shape[0] - 1:
        weight = limits.pulls[1]
    return weight


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
def scale_kernel(limits: JerkLimits, z: Array, inside: float) -> bool:
    """Make z the part ``inside`` of its largest multiple inside all limits; False if none is."""
    low, high = -1.0, 1.0
    while not inside_kernel(limits, z * math.exp(low)):
        low *= 2.0
        if not low > -500.0:
            return False
    for _ in range(8):
        middle = 0.5 * (low + high)
        if inside_kernel(limits, z * math.exp(middle)):
            low = middle
        else:
            high = middle
    z *= inside * math.exp(low)
    return True


@kernel
def start_kernel(limits: JerkLimits, z: Array) -> bool:
    """Write a shape between constant and as fast as the limits allow place by place, inside all.

    Args:
        limits: The limits.
        z: Filled, shape (N + 2,).

    Returns:
        False where not even standing nearly still is inside.
    """
    caps, rises = np.empty(z.shape[0] - 1), np.empty(z.shape[0] - 1)
    _still_kernel(limits, caps, rises)
    last, shape = z.shape[0] - 1, np.empty(z.shape[0])
    for k in range(1, last):
        shape[k] = min(caps[k - 1], caps[k])
    shape[0], shape[last] = shape[1], shape[last - 1]
    envelope_kernel(limits.lengths, rises, shape)
    best, found = np.inf, False
    # First guesses are these powers of the highest speeds place by place, as fast as stays inside.
    for power in (1.0, 0.7, 0.4, 0.0):
        trial = shape**power
        if not scale_kernel(limits, trial, 0.7):
            continue
        time = time_kernel(limits, trial)
        if not found or time < best:
            best, found = time, True
            z[:] = trial
    return found


@kernel(allocates=False)
def _still_kernel(limits: JerkLimits, caps: Array, rises: Array) -> None:
    """Write the largest c at each knot where c stands still, and its largest change to the next."""
    caps[:], rises[:] = np.inf, np.inf
    for i in range(limits.counts.shape[0]):
        knot = (i + 1) // 2
        for k in range(limits.counts[i]):
            w, r, _, low, high, root = limits.rows[i, k]
            if w != 0.0:
                cap = abs(w) ** (-2.0 / 3.0) if root > 0.0 else max(high / w, low / w)
                caps[knot] = min(caps[knot], cap)
            if r != 0.0 and root == 0.0:
                rises[knot] = min(rises[knot], min(high, -low) / abs(r))
    for i in range(rises.shape[0]):
        rises[i] *= 0.5 * (limits.lengths[i] + limits.lengths[i + 1])


# phi(T) / T: the length of a ramp for each unit of tau.
_RAMP = 0.6


class Grid(NamedTuple):
    """Knots on a path and the limits upon them.

    Args:
        places: s at the knots, shape (N + 1,).
        speeds: ds/dtau and d2s/dtau2 at the knots, shape (2, N + 1).
        pieces: The path's piece of each cell, shape (N,).
        limits: The limits.
    """

    places: Array
    speeds: Array
    pieces: NDArray[np.int64]
    limits: JerkLimits


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
    pace, ramps, shares = _pace(path, limits, speeds)
    if cells is None:
        cells = _FEW if extra is None and straight.any() else _FINE
    # An end passed below this part of full speed has speeds near it that grow as those from rest.
    places = _knots(breaks, straight, ramps, [share < 0.03 for share in shares], cells)
    pieces = np.searchsorted(breaks, 0.5 * (places[1:] + places[:-1]), side="right") - 1
    phi = pace.derivatives(places)
    count = len(places)
    more = KnotLimits(np.full(count, np.inf), np.zeros((count, 0, 4)))
    if extra is not None:
        more = extra(path, places)
    for end, speed in ((0, speeds[0]), (-1, speeds[1])):
        if speed > 0.0:
            more.caps[end] = min(more.caps[end], speed**2)
    rows = np.zeros((2 * len(pieces), 1 + more.rows.shape[1] + 2 * path.n, 6))
    counts = np.empty(len(rows), dtype=np.int64)
    at = KnotPlaces(places, pieces, straight, phi)
    limit_rows_kernel(c, breaks, at, limits, more, rows, counts)
    lengths = np.concatenate([[0.0], np.diff(pace.tau(places)), [0.0]])
    # A speed asked for at an end counts like a tenth of the path run through at it, but for a slow
    # one no more than the path at full speed, beside which all else would be within the tolerance.
    pulls = 0.1 * float(breaks[-1]) * np.minimum(1.0, 10.0 * shares)
    on_spline = JerkLimits(lengths, _maps(lengths), rows, counts, pulls)
    return Grid(places, phi[:2], pieces.astype(np.int64), on_spline)


def _maps(h: Array) -> Array:
    """The matrices of ``JerkLimits`` on cells of lengths (N + 2,)."""
    here, before, after = h[1:-1], h[:-2] + h[1:-1], h[1:-1] + h[2:]
    maps = np.zeros((len(here), 2, 3, 3))
    maps[:, 0, 0, 0], maps[:, 0, 0, 1] = here / before, h[:-2] / before
    maps[:, 1, 0, 1], maps[:, 1, 0, 2] = h[2:] / after, here / after
    maps[:, 0, 1, 1], maps[:, 1, 1, 2] = 2.0 / before, 2.0 / after
    maps[:, 0, 1, 0], maps[:, 1, 1, 1] = -2.0 / before, -2.0 / after
    maps[:, :, 2] = ((maps[:, 1, 1] - maps[:, 0, 1]) / here[:, None])[:, None]
    return maps.reshape(-1, 3, 3)


@kernel
def limit_rows_kernel(
    coefficients: Array,
    breaks: Array,
    at: KnotPlaces,
    limits: Array,
    more: KnotLimits,
    rows: Array,
    counts: NDArray[np.int64],
) -> None:
    """Write the rows of ``JerkLimits`` and their numbers.

    Where all about a place is straight the row of the tightest joint decides for all.

    Args:
        coefficients: Coefficients of the path, shape (p, n, d + 1), d at most 3.
        breaks: Breaks of the path, shape (p + 1,).
        at: The knots.
        limits: Limits of velocity, acceleration and jerk, shape (3, n).
        more: Further limits at the knots.
        rows: Shape (2 N, R, 6).
        counts: Shape (2 N,).
    """
    n, cells = coefficients.shape[1], at.pieces.shape[0]
    slopes, Q = np.empty(n), np.empty((3, n))
    for i in range(2 * cells):
        k, knot, used = i // 2, (i + 1) // 2, 0
        piece = at.pieces[k]
        is_straight = at.straight[piece]
        p1, p2, p3 = at.pace[0, knot], at.pace[1, knot], at.pace[2, knot]
        cap = more.caps[knot] / (p1 * p1)
        for j in range(n):
            q1, q2, q3 = slopes_kernel(coefficients[piece, j], at.places[knot] - breaks[piece])
            slopes[j] = abs(q1)
            Q[0, j], Q[1, j] = q1 * p1, q2 * p1 * p1 + q1 * p2
            Q[2, j] = q3 * p1**3 + 3.0 * q2 * p1 * p2 + q1 * p3
            if Q[0, j] != 0.0:
                cap = min(cap, (limits[0, j] / Q[0, j]) ** 2)
        if i % 2 == 0 or k == cells - 1:
            rows[i, 0, 0], rows[i, 0, 3], rows[i, 0, 4] = 1.0 / cap, -np.inf, 1.0
            used = 1
            for m in range(more.rows.shape[1]):
                a, b, low, high = more.rows[knot, m]
                row = rows[i, used]
                row[0], row[1], row[3], row[4] = a * p2 + b * p1 * p1, 0.5 * a * p1, low, high
                used += 1
            alone = is_straight and (k == 0 or i % 2 == 1 or at.straight[at.pieces[k - 1]])
            first, last = _deciding(slopes, limits[1], alone)
            for j in range(first, last):
                row, most = rows[i, used], limits[1, j]
                row[0], row[1], row[3], row[4] = Q[1, j] / most, 0.5 * Q[0, j] / most, -1.0, 1.0
                used += 1
        first, last = _deciding(slopes, limits[2], is_straight)
        for j in range(first, last):
            row, most = rows[i, used], limits[2, j]
            row[0], row[1], row[2] = Q[2, j] / most, 1.5 * Q[1, j] / most, 0.5 * Q[0, j] / most
            row[5] = 1.0
            used += 1
        counts[i] = used


@kernel(allocates=False)
def _deciding(slopes: Array, limits: Array, alone: bool) -> tuple[int, int]:
    """The first joint that has a row, and the one after the last: the tightest, or all."""
    first = 0
    for j in range(slopes.shape[0]):
        if slopes[j] / limits[j] > slopes[first] / limits[first]:
            first = j
    return (first, first + 1) if alone else (0, slopes.shape[0])


@kernel(allocates=False)
def slopes_kernel(c: Array, u: float) -> tuple[float, float, float]:
    """First three derivatives of a polynomial of degree 3 at most, of its coefficients (d + 1,)."""
    c2, c3 = c[2] if c.shape[0] > 2 else 0.0, c[3] if c.shape[0] > 3 else 0.0
    return c[1] + (2.0 * c2 + 3.0 * c3 * u) * u, 2.0 * c2 + 6.0 * c3 * u, 6.0 * c3


def _pace(
    path: JointPath, limits: Array, speeds: tuple[float, float]
) -> tuple[_Pace, tuple[float, float], Array]:
    """The pace, the ways at the two ends on which speeds change most, and speeds as parts of full.

    Without a limit of the velocity every speed but 0 counts as full.
    """
    length = float(path.breaks[-1])
    slopes = np.abs(path.sample([0.0, length], 1))
    with np.errstate(divide="ignore"):
        full = (limits[0] / slopes).min(axis=1)
    asked = np.array(speeds)
    shares = np.where(np.isfinite(full), asked / full, asked > 0.0)
    # A ramp takes at most this part of the way.
    ramps = [min(_ramp(slope, limits), 0.4 * length) for slope in slopes]
    resting = [ramp if speed == 0.0 else 0.0 for ramp, speed in zip(ramps, speeds, strict=True)]
    return _Pace(length, resting[0], resting[1]), (ramps[0], ramps[1]), shares


def _ramp(slope: Array, limits: Array) -> float:
    """The way that it takes to get from rest to full speed in a straight line."""
    with np.errstate(divide="ignore"):
        v, a, j = (limits / slope).min(axis=1)
    if not np.isfinite(j):
        return np.inf
    return float(ramp_length(0.0, min(v, 1e6 * a * a / j), a, j))


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
