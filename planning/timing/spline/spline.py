"""Cubic splines through waypoints at given times (or other knots): natural and clamped.

On the interval [t_i, t_(i+1)] of length h_i, with u = t - t_i and d_i = (q_(i+1) - q_i) / h_i,

    q(u) = q_i + (d_i - h_i (2 m_i + m_(i+1)) / 6) u + m_i / 2 u^2 + (m_(i+1) - m_i) / (6 h_i) u^3,

where m_i is the second derivative at knot i. This meets all waypoints and makes the second
derivative continuous; that the first one is too asks at the inner knots

    h_(i-1) m_(i-1) + 2 (h_(i-1) + h_i) m_i + h_i m_(i+1) = 6 (d_i - d_(i-1)),

and each end adds one equation: m = 0 (natural: no acceleration) or, with a velocity v there
(clamped), 2 h_0 m_0 + h_0 m_1 = 6 (d_0 - v) and its mirror image. The system is tridiagonal and
diagonally dominant, so it always has one solution.

A smooth curve that stands for a path within a tolerance is fitted by least squares to the path,
simplified within a part of it, with few knots, spread as its corners are: they are dense where it
bends. The two are matched by the path's length. Between knots and corners their difference is a
cubic, whose Bernstein coefficients bound it: the curve is within the tolerance at every place, in
the path's order, and nothing is sampled.
"""

from collections.abc import Sequence
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
import scipy
from numpy.typing import ArrayLike

from kinematics.arrays import Array, Indices
from kinematics.errors import InvalidOption, InvalidTrajectory
from kinematics.trajectory.trajectory import Trajectory
from planning.timing.path.path import JointPath
from planning.timing.path.simplification import fewest_waypoints

# Parts of the tolerance that the simplified path may be off, in turn; the rest is the curve's. The
# first is for exact paths, the last for noise.
_SIMPLIFIED = (0.1, 0.5)
# Spans of the spline for each leg of the simplified path, in turn.
_SPANS = (0.125, 0.25, 0.5, 1.0, 2.0)
# Legs beyond which a path is no smooth one.
_MOST_LEGS = 1000
# Places in each span that it is fitted to.
_PLACES = 6
# Samples of a motion that cubics are fitted to.
_FEWEST = 4
# Powers of a parameter from 0 to 1 in Bernstein polynomials of degree 3, a row for each of these.
_BERNSTEIN = np.array(
    [[1.0, 0.0, 0.0, 0.0], [1.0, 1 / 3, 0.0, 0.0], [1.0, 2 / 3, 1 / 3, 0.0], [1.0, 1.0, 1.0, 1.0]]
)

Ends = Literal["natural", "clamped"]
#: Velocities at the start and the end, each (n,); None at an end that has none of its own.
EndVelocities: TypeAlias = tuple[Array | None, Array | None]


def spline_trajectory(
    joint_names: Sequence[str],
    waypoints: ArrayLike,
    times: ArrayLike,
    ends: Ends = "natural",
    velocities: EndVelocities = (None, None),
) -> Trajectory:
    """The cubic spline q(t) that is at each waypoint at its time.

    Args:
        joint_names: n names.
        waypoints: Shape (k, n), k >= 2.
        times: Shape (k,), strictly increasing from 0 [s].
        ends: "natural" for zero acceleration at both ends, "clamped" for zero velocity.
        velocities: Velocities at the ends: an end that is given one is clamped to it.

    Raises:
        InvalidTrajectory: Waypoints and times do not fit, or times do not increase from 0.
        InvalidOption: There is no such kind of ends.
    """
    points, knots = _check_samples(waypoints, times)
    if knots[0] != 0.0:
        raise InvalidTrajectory(
            f"the first time is {knots[0]} s", hint="Give times that start at 0."
        )
    return Trajectory(tuple(joint_names), knots, _coefficients(points, knots, ends, velocities))


def spline_path(waypoints: ArrayLike, knots: ArrayLike, ends: Ends = "natural") -> JointPath:
    """The cubic spline through the waypoints as a shape without time, to be timed afterwards.

    Args:
        waypoints: Shape (k, n), k >= 2.
        knots: Values of the path parameter at the waypoints, strictly increasing, shape (k,).
        ends: "natural" or "clamped".

    Raises:
        InvalidTrajectory: Waypoints and knots do not fit, or knots do not increase.
        InvalidOption: There is no such kind of ends.
    """
    points, values = _check_samples(waypoints, knots)
    return JointPath(_coefficients(points, values, ends), np.diff(values))


def led_by(waypoints: Array) -> Indices:
    """Numbers of the waypoints that lead a spline: all but those nearly at the one before.

    Between two that are nearly the same a spline turns within their distance, and can only be run
    through as slowly. The ends always stay.

    Args:
        waypoints: Shape (k, n), k >= 2, at least two of them distinct.
    """
    steps = np.linalg.norm(np.diff(waypoints, axis=0), axis=1)
    # Waypoints that are nearer than this part of the mean step are nearly the same [-].
    kept, least = [0], 1e-3 * float(steps.mean())
    for i in range(1, len(waypoints)):
        if np.linalg.norm(waypoints[i] - waypoints[kept[-1]]) > least:
            kept.append(i)
    if len(kept) > 1:
        kept.pop()
    return np.array([*kept, len(waypoints) - 1], dtype=np.int64)


def chord_knots(waypoints: ArrayLike) -> Array:
    """Knots from 0 that advance by the joint-space distance of the waypoints, shape (k,).

    Raises:
        InvalidTrajectory: A waypoint repeats its predecessor, or they are malformed.
    """
    points = np.asarray(waypoints, dtype=np.float64)
    if points.ndim != 2:
        raise InvalidTrajectory(f"waypoints of shape {points.shape} describe no path")
    knots = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    if not (np.diff(knots) > 0.0).all():
        place = int(np.argmin(np.diff(knots) > 0.0))
        raise InvalidTrajectory(
            f"waypoint {place + 1} repeats waypoint {place}, or one is not finite",
            hint="Remove repeated waypoints, or give knots or times.",
        )
    return knots


def _check_samples(waypoints: ArrayLike, knots: ArrayLike) -> tuple[Array, Array]:
    try:
        points = np.array(waypoints, dtype=np.float64)
        values = np.array(knots, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidTrajectory(f"waypoints and times must be numbers: {error}") from None
    if points.ndim != 2 or points.shape[0] < 2 or points.shape[1] < 1:
        raise InvalidTrajectory(
            f"waypoints of shape {points.shape} can't be joined by a spline",
            hint="Give a list of at least two joint vectors.",
        )
    if values.shape != points.shape[:1]:
        raise InvalidTrajectory(
            f"{len(points)} waypoints with {values.size} times", hint="Give one for each waypoint."
        )
    if not (np.isfinite(points).all() and np.isfinite(values).all()):
        raise InvalidTrajectory("the waypoints or their times are not all finite")
    if not (np.diff(values) > 0.0).all():
        place = int(np.argmin(np.diff(values) > 0.0))
        raise InvalidTrajectory(
            f"time {place + 1} ({values[place + 1]}) is not after time {place} ({values[place]})",
            hint="Give strictly increasing times.",
        )
    return points, values


def _coefficients(
    points: Array, knots: Array, ends: Ends, velocities: EndVelocities = (None, None)
) -> Array:
    if ends not in get_args(Ends):
        raise InvalidOption(
            f"there are no spline ends {ends!r}", hint="Choose from natural, clamped."
        )
    rest = np.zeros(points.shape[1]) if ends == "clamped" else None
    start, end = (rest if given is None else given for given in velocities)
    if any(given is not None and given.shape != points.shape[1:] for given in (start, end)):
        raise InvalidTrajectory(f"boundary velocities must be {points.shape[1]} numbers each")
    natural = (2, np.zeros(points.shape[1]))
    ends_of: Any = [natural if given is None else (1, given) for given in (start, end)]
    spline = scipy.interpolate.CubicSpline(knots, points, bc_type=tuple(ends_of))
    coefficients = np.ascontiguousarray(np.moveaxis(spline.c[::-1], 0, 2))
    if start is not None:
        # Exactly, not but for what solving the system rounds off.
        coefficients[0, :, 1] = start
    return coefficients


def smooth_curve(points: Array, tolerance: float, norm: float) -> tuple[JointPath, float] | None:
    """The curve with about the fewest knots near a path, and a bound of its distance.

    None where none is found within the tolerance.

    Args:
        points: Shape (k, n), k >= 2 [rad or m].
        tolerance: Largest distance from the path at every place [rad or m].
        norm: 2 for the Euclidean distance, inf for that of the joint that is farthest off.
    """
    found = [_near_simplified(points, part, tolerance, norm) for part in _SIMPLIFIED]
    curves = [one for one in found if one is not None]
    return min(curves, key=lambda one: len(one[0].lengths), default=None)


def smooth_motion(
    joint_names: Sequence[str], times: ArrayLike, points: ArrayLike, tolerance: float, rest: bool
) -> tuple[Trajectory, float]:
    """The motion of few cubics near a recorded one, and a bound of their distance at every instant.

    Spans in which it is farther are halved, until none is or samples are too few; then a spline
    through all samples may be nearer.

    Args:
        joint_names: n names.
        times: Of the samples, shape (k,), strictly increasing [s].
        points: Samples, shape (k, n), k >= 4; between them joints move evenly [rad or m].
        tolerance: Largest distance of any joint, sought [rad or m].
        rest: Whether it begins and ends without velocity.

    Raises:
        InvalidTrajectory: Samples and times do not fit, or times do not increase.
    """
    q, t = _check_samples(points, times)
    if len(t) < _FEWEST:
        raise InvalidTrajectory(f"{len(t)} samples", hint=f"Give at least {_FEWEST}.")
    t = t - t[0]
    line = scipy.interpolate.BSpline(np.concatenate([t[:1], t, t[-1:]]), q, 1)
    breaks, closest = np.array([0, len(t) - 1]), np.inf
    while True:
        ends = np.repeat(t[[0, -1]], 3)
        knots = np.concatenate([ends[:3], t[breaks], ends[3:]])
        fitted = scipy.interpolate.make_lsq_spline(t, q, knots, 3)
        fitted.c[[0, -1]] = q[[0, -1]]
        if rest:
            fitted.c[[1, -2]] = q[[0, -1]]
        places, bounds = _distances(fitted, line, np.inf)
        if bounds.max() < closest:
            motion = Trajectory(tuple(joint_names), t[breaks], _powers(fitted, t[breaks[:-1]]))
            closest = float(bounds.max())
        wide = np.flatnonzero(np.diff(breaks) > 2)
        off = np.unique(np.searchsorted(t[breaks], places[bounds > tolerance], "right") - 1)
        split = np.intersect1d(off, wide)
        # A spline has two coefficients more than breaks, and no more of them than samples.
        if not len(split) or len(breaks) + len(split) + 2 > len(t):
            break
        breaks = np.unique(np.concatenate([breaks, (breaks[split] + breaks[split + 1]) // 2]))
    if closest > tolerance:
        through = scipy.interpolate.make_interp_spline(
            t, q, 3, bc_type="clamped" if rest else "natural"
        )
        nearest = float(_distances(through, line, np.inf, 8)[1].max())
        if nearest < closest:
            return Trajectory(tuple(joint_names), t, _powers(through, t[:-1])), nearest
    return motion, closest


def _near_simplified(
    points: Array, part: float, tolerance: float, norm: float
) -> tuple[JointPath, float] | None:
    """The curve near a path that is simplified within a part of the tolerance."""
    numbers, off = fewest_waypoints(points, part * tolerance, norm)
    corners, left = points[numbers], tolerance - off
    steps = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    if len(steps) > _MOST_LEGS or not (steps > 0.0).all():
        return None
    along, legs = np.concatenate([[0.0], np.cumsum(steps)]), np.arange(len(corners))
    line = scipy.interpolate.BSpline(np.concatenate([along[:1], along, along[-1:]]), corners, 1)
    for share in _SPANS:
        spans = max(int(share * len(steps)), 2)
        knots = np.interp(np.linspace(0.0, len(steps), spans + 1), legs, along)
        fractions = np.linspace(0.0, spans, _PLACES * spans + 1)
        places = np.interp(fractions, np.arange(spans + 1.0), knots)
        ends = np.repeat(along[[0, -1]], 3)
        all_knots = np.concatenate([ends[:3], knots, ends[3:]])
        fitted = scipy.interpolate.make_lsq_spline(places, line(places), all_knots, 3)
        # The ends are met exactly.
        fitted.c[[0, -1]] = corners[[0, -1]]
        distance = float(_distances(fitted, line, norm)[1].max())
        if distance <= left:
            return JointPath(_powers(fitted, knots[:-1]), np.diff(knots)), off + distance
    return None


def _powers(spline: "scipy.interpolate.BSpline", starts: Array) -> Array:
    """Coefficients of the polynomials from some places on, in ascending powers, shape (m, n, 4)."""
    factorials = (1.0, 1.0, 2.0, 6.0)
    orders = [spline(starts, nu=order) / factor for order, factor in enumerate(factorials)]
    return np.ascontiguousarray(np.stack(orders, axis=-1))


def _distances(
    curve: "scipy.interpolate.BSpline",
    line: "scipy.interpolate.BSpline",
    norm: float,
    cuts: int = 1,
) -> tuple[Array, Array]:
    """Places from which on two splines are polynomials, and bounds of their distance from each on.

    The distance is that at the same parameter; its bounds are the sharper the more ``cuts`` each
    polynomial is in.
    """
    places = np.unique(np.concatenate([curve.t, line.t]))
    if cuts > 1:
        last = len(places) - 1
        places = np.interp(np.linspace(0.0, last, cuts * last + 1), np.arange(last + 1.0), places)
    starts, lengths = places[:-1], np.diff(places)
    powers = _powers(curve, starts)
    # On a straight leg up to rounding: its slope is right of each place.
    powers[..., 0] -= line(starts)
    powers[..., 1] -= line(starts, nu=1)
    scaled = powers * lengths[:, None, None] ** np.arange(4.0)
    bounds = np.linalg.norm(np.abs(scaled @ _BERNSTEIN.T).max(axis=2), ord=norm, axis=1)
    return starts, np.asarray(bounds)
