"""Smooth curves that stand for a path within a tolerance: cubic splines with continuous curvature.

The path is simplified within a part of the tolerance. A spline is fitted to it by least squares,
with as few knots as do, spread as its corners are: they are dense where it bends. The two are
matched by the path's length. Between knots and corners their difference is a cubic, whose Bernstein
coefficients bound it: the curve is within the tolerance at every place, in the path's order, and
nothing is sampled.
"""

import numpy as np
from scipy.interpolate import BSpline, make_lsq_spline

from kinematics.arrays import Array
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
# Powers of a parameter from 0 to 1 in Bernstein polynomials of degree 3, a row for each of these.
_BERNSTEIN = np.array(
    [[1.0, 0.0, 0.0, 0.0], [1.0, 1 / 3, 0.0, 0.0], [1.0, 2 / 3, 1 / 3, 0.0], [1.0, 1.0, 1.0, 1.0]]
)


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
    line = BSpline(np.concatenate([along[:1], along, along[-1:]]), corners, 1)
    for share in _SPANS:
        spans = max(int(share * len(steps)), 2)
        knots = np.interp(np.linspace(0.0, len(steps), spans + 1), legs, along)
        fractions = np.linspace(0.0, spans, _PLACES * spans + 1)
        places = np.interp(fractions, np.arange(spans + 1.0), knots)
        ends = np.repeat(along[[0, -1]], 3)
        all_knots = np.concatenate([ends[:3], knots, ends[3:]])
        fitted = make_lsq_spline(places, line(places), all_knots, 3)
        # The ends are met exactly.
        fitted.c[[0, -1]] = corners[[0, -1]]
        distance = _distance(fitted, line, norm)
        if distance <= left:
            return JointPath(_powers(fitted, knots[:-1]), np.diff(knots)), off + distance
    return None


def _powers(spline: BSpline, starts: Array) -> Array:
    """Coefficients of the polynomials from some places on, in ascending powers, shape (m, n, 4)."""
    factorials = (1.0, 1.0, 2.0, 6.0)
    orders = [spline(starts, nu=order) / factor for order, factor in enumerate(factorials)]
    return np.ascontiguousarray(np.stack(orders, axis=-1))


def _distance(curve: BSpline, line: BSpline, norm: float) -> float:
    """A bound of the distance of two splines at the same parameter."""
    places = np.unique(np.concatenate([curve.t, line.t]))
    starts, lengths = places[:-1], np.diff(places)
    powers = _powers(curve, starts)
    # On a straight leg up to rounding: its slope is right of each place.
    powers[..., 0] -= line(starts)
    powers[..., 1] -= line(starts, nu=1)
    scaled = powers * lengths[:, None, None] ** np.arange(4.0)
    return float(np.linalg.norm(np.abs(scaled @ _BERNSTEIN.T).max(axis=2), ord=norm, axis=1).max())
