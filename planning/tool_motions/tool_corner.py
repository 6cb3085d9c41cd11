"""Corners between two tool motions, rounded without a jump of curvature.

Before the corner the tool leaves the first motion, its first leg, and joins the second one behind
it, its second leg. Between them both motions are superposed: the first one slows down to the
corner, h(u) from 0 to 1, while the second one sets out from it, g(u) = 1 - h(1 - u),

    p(u) = p_1(h(u)) + p_2(g(u)) - p_corner,    R(u) = R_2(g(u)) R_corner^T R_1(h(u)),
    h(u) = a (u - 6 u^3 + 8 u^4 - 3 u^5) + 10 u^3 - 15 u^4 + 6 u^5.

h'' and the first two derivatives of h at 1 vanish at the ends, so that position and orientation
join both motions with continuous first and second derivatives by the length: tangent, curvature,
axis and rate of turning. Between lines the curve is a quintic Bezier curve inside the triangle of
its ends and the corner. The slope a is the one that makes the largest change of curvature by the
length about as small as it can be: a fifth above that of two clothoids at most.

Source: "A curvature optimal sharp corner smoothing algorithm for
high-speed feed motion generation of NC systems along linear tool paths" (2015).
"""

import math
from dataclasses import dataclass, field
from functools import cache
from typing import Literal

import numpy as np

from kinematics.arrays import Array, frozen
from planning.tool_motions.tool_motion import ToolMotion

#: Stretches on which the length is summed up, and points of Gauss and Legendre on each.
_STRETCHES = 64
_POINTS = 8


@dataclass(frozen=True, slots=True, eq=False)
class ToolCorner:
    """A rounded corner.

    Args:
        first: Leg of the motion before, from where the tool leaves it to the corner.
        second: Leg of the motion after, from the corner to where the tool joins it; as long as the
            first one.
        slope: Slope a of h at u = 0, in (0, 2.5].
    """

    first: ToolMotion
    second: ToolMotion
    slope: float
    _lengths: Array = field(init=False, repr=False)
    _node_speeds: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        nodes, weights = _rule()
        starts = np.linspace(0.0, 1.0, _STRETCHES, endpoint=False)
        speeds = self._speeds((starts[:, None] + nodes / _STRETCHES).ravel())
        parts = speeds.reshape(_STRETCHES, _POINTS) @ weights / _STRETCHES
        object.__setattr__(self, "_lengths", frozen(np.concatenate([[0.0], np.cumsum(parts)])))
        object.__setattr__(self, "_node_speeds", frozen(self._speeds(np.append(starts, 1.0))))

    @property
    def kind(self) -> Literal["corner"]:
        """Kind of motion."""
        return "corner"

    @property
    def T_start(self) -> Array:
        """Pose at the start, shape (4, 4)."""
        return self.first.T_start

    @property
    def T_corner(self) -> Array:
        """Pose that both motions share and the tool passes by, shape (4, 4)."""
        return self.first.T_end

    @property
    def T_end(self) -> Array:
        """Pose at the end, shape (4, 4)."""
        return self.second.T_end

    @property
    def length(self) -> float:
        """Length of the path of the tool's origin [m]."""
        return float(self._lengths[-1])

    @property
    def angle(self) -> float:
        """Sum of the angles that the tool turns by on both legs [rad]."""
        return self.first.angle + self.second.angle

    def pose(self, s: float) -> Array:
        """T_base_tool at a place from 0 to 1, shape (4, 4)."""
        return np.asarray(self.poses(np.array([s]))[0])

    def direction(self, s: float) -> Array:
        """Unit tangent of the path at a place from 0 to 1, shape (3,)."""
        rate = self._rates(self._parameters(np.array([s])))[0]
        return np.asarray(rate / np.linalg.norm(rate))

    def poses(self, places: Array) -> Array:
        """T_base_tool at places from 0 to 1 (k,), proportional to the length, (k, 4, 4)."""
        u = self._parameters(np.asarray(places, dtype=np.float64))
        one = self.first.poses(ramp(self.slope, u))
        other = self.second.poses(1.0 - ramp(self.slope, 1.0 - u))
        T = np.tile(np.eye(4), (len(u), 1, 1))
        T[:, :3, 3] = one[:, :3, 3] + other[:, :3, 3] - self.T_corner[:3, 3]
        T[:, :3, :3] = other[:, :3, :3] @ self.T_corner[:3, :3].T @ one[:, :3, :3]
        return T

    def places(self, points: Array) -> Array:
        """The place from 0 to 1 that is nearest to each of some points (k, 3), shape (k,)."""
        grid = np.linspace(0.0, 1.0, 129)
        apart = points[:, None] - self.poses(grid)[None, :, :3, 3]
        s = grid[np.einsum("kgi,kgi->kg", apart, apart).argmin(axis=1)]
        # From there along the tangent: what is left is a part of the distance times the curvature.
        for _ in range(4):
            rates = self._rates(self._parameters(s))
            tangents = rates / np.linalg.norm(rates, axis=1)[:, None]
            ahead = np.einsum("ki,ki->k", points - self.poses(s)[:, :3, 3], tangents)
            s = np.clip(s + ahead / self.length, 0.0, 1.0)
        return np.asarray(s)

    def _rates(self, u: Array) -> Array:
        """dp/du at parameters (k,), shape (k, 3)."""
        one = _leg_rates(self.first, ramp(self.slope, u), ramp_slope(self.slope, u))
        back = 1.0 - u
        other = _leg_rates(self.second, 1.0 - ramp(self.slope, back), ramp_slope(self.slope, back))
        return one + other

    def _speeds(self, u: Array) -> Array:
        return np.asarray(np.linalg.norm(self._rates(u), axis=1))

    def _parameters(self, places: Array) -> Array:
        """The u at places (k,) that are proportional to the length."""
        lengths, speeds = self._lengths, self._node_speeds
        wanted = np.clip(places, 0.0, 1.0) * self.length
        k = np.clip(np.searchsorted(lengths, wanted, side="right") - 1, 0, _STRETCHES - 1)
        # Hermite's cubic of u by the length, then one step of Newton's method.
        step = lengths[k + 1] - lengths[k]
        x = (wanted - lengths[k]) / step
        first, last = step / speeds[k], step / speeds[k + 1]
        rise = x * x * (3.0 - 2.0 * x) / _STRETCHES
        rest = rise + x * (1.0 - x) * ((1.0 - x) * first - x * last)
        start = k / _STRETCHES
        nodes, weights = _rule()
        looks = np.append(nodes, 1.0)
        rates = self._speeds((start[:, None] + rest[:, None] * looks).ravel())
        rates = rates.reshape(-1, _POINTS + 1)
        reached = lengths[k] + rest * (rates[:, :-1] @ weights)
        u = start + rest + (wanted - reached) / rates[:, -1]
        return np.asarray(np.clip(u, 0.0, 1.0))


#: Motions of the tool of every kind.
ToolCurve = ToolMotion | ToolCorner


def best_slope(angle: float) -> float:
    """The slope a with nearly the least largest change of curvature by the length.

    A fit to the minima between lines that turn by 1 to 170 degrees: it is within 2 % of them.

    Args:
        angle: Angle that the direction turns by at the corner, in [0, pi) [rad].
    """
    c = math.cos(0.5 * angle)
    return c * (2.778 + 1.829 * c) / (0.508 + c + 0.692 * c * c)


def ramp(slope: float, u: Array) -> Array:
    """Place h on the first leg at parameters u, of the same shape."""
    start = u * (1.0 + u * u * (-6.0 + u * (8.0 - 3.0 * u)))
    return np.asarray(slope * start + u**3 * (10.0 + u * (-15.0 + 6.0 * u)))


def ramp_slope(slope: float, u: Array) -> Array:
    """dh/du at parameters u, of the same shape."""
    start = 1.0 + u * u * (-18.0 + u * (32.0 - 15.0 * u))
    return np.asarray(slope * start + 30.0 * (u * (1.0 - u)) ** 2)


def _leg_rates(leg: ToolMotion, places: Array, rates: Array) -> Array:
    """Velocity on a leg at places (k,) that change at rates (k,), shape (k, 3)."""
    if leg.kind == "lin":
        return np.asarray(np.outer(rates, leg.T_end[:3, 3] - leg.T_start[:3, 3]))
    return np.asarray((rates * leg.length)[:, None] * leg.directions(places))


def rounded_corner(first: ToolMotion, second: ToolMotion, distance: float) -> ToolCorner:
    """The corner from a distance before the end of a motion to the same behind it [m]."""
    s, t = 1.0 - distance / first.length, distance / second.length
    one, other = part_of(first, s, 1.0), part_of(second, 0.0, t)
    angle = angle_between(one.direction(1.0), other.direction(0.0))
    return ToolCorner(one, other, best_slope(angle))


def angle_between(a: Array, b: Array) -> float:
    """Angle between unit vectors (3,) [rad]."""
    return math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))


def part_of(motion: ToolMotion, begin: float, end: float) -> ToolMotion:
    """The part of a motion between two places."""
    T_begin = motion.T_start if begin == 0.0 else motion.pose(begin)
    T_end = motion.T_end if end == 1.0 else motion.pose(end)
    sweep = motion.sweep * (end - begin)
    # What is left of a longer rotation may be the shorter one.
    longer = motion.longer and (end - begin) * motion.angle > math.pi
    return ToolMotion(motion.kind, T_begin, T_end, motion.center, motion.normal, sweep, longer)


@cache
def _rule() -> tuple[Array, Array]:
    """Nodes and weights of Gauss and Legendre on [0, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(_POINTS)
    return frozen(0.5 * (nodes + 1.0)), frozen(0.5 * weights)
