"""Straight and circular motions of the tool, as shapes without time.

A line takes the tool's origin from p_0 to p_1, an arc turns it about an axis by an angle, both at a
place s from 0 to 1 that is proportional to the length. Orientation turns about one axis that keeps
still, by an angle proportional to s (slerp): R(s) = exp(s theta [a]) R_0 with theta a the rotation
vector of R_1 R_0^T, the shorter way round unless the longer one is asked for.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidGoal
from kinematics.pose import from_axis_angle, rotation_error, skew, transform

Kind = Literal["lin", "circ"]

#: Three points of which one is nearer to the line through the others than this part of their
#: distance name no plane: a thousandth of it would already be a matter of rounding in the text.
_COLLINEAR = 1e-6
#: Below these a way has no length [m] and a turn no axis [rad].
_NO_LENGTH = 1e-9
_NO_ANGLE = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class ToolMotion:
    """One motion of the tool.

    Args:
        kind: "lin" or "circ".
        T_start: Pose at s = 0, shape (4, 4).
        T_end: Pose at s = 1, shape (4, 4).
        center: Center of an arc, shape (3,) [m].
        normal: Axis that an arc turns about, by the right hand, of length 1, shape (3,).
        sweep: Angle of an arc [rad], positive.
        longer: Whether the tool turns the longer way round.
    """

    kind: Kind
    T_start: Array
    T_end: Array
    center: Array
    normal: Array
    sweep: float
    longer: bool = False

    def __post_init__(self) -> None:
        for name in ("T_start", "T_end", "center", "normal"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def radius(self) -> float:
        """Radius of an arc [m]; 0 of a line."""
        if self.kind == "lin":
            return 0.0
        return float(np.linalg.norm(self.T_start[:3, 3] - self.center))

    @property
    def length(self) -> float:
        """Length of the path of the tool's origin [m]."""
        if self.kind == "circ":
            return self.radius * self.sweep
        return float(np.linalg.norm(self.T_end[:3, 3] - self.T_start[:3, 3]))

    @property
    def turn(self) -> Array:
        """Rotation vector theta a of the whole motion, shape (3,) [rad]."""
        turn = np.asarray(rotation_error(self.T_start[:3, :3], self.T_end[:3, :3]))
        return turn * (1.0 - 2.0 * math.pi / np.linalg.norm(turn)) if self.longer else turn

    @property
    def angle(self) -> float:
        """Angle that the tool turns by [rad]."""
        return float(np.linalg.norm(self.turn))

    def pose(self, s: float) -> Array:
        """T_base_tool at a place from 0 to 1, shape (4, 4)."""
        return np.asarray(self.poses(np.array([s]))[0])

    def direction(self, s: float) -> Array:
        """Unit tangent of the path at a place from 0 to 1, shape (3,)."""
        return np.asarray(self.directions(np.array([s]))[0])

    def directions(self, places: Array) -> Array:
        """Unit tangents at places from 0 to 1 (k,), shape (k, 3)."""
        s = np.asarray(places, dtype=np.float64)
        if self.kind == "lin":
            way = self.T_end[:3, 3] - self.T_start[:3, 3]
            return np.tile(way / np.linalg.norm(way), (len(s), 1))
        first = np.cross(self.normal, self.T_start[:3, 3] - self.center) / self.radius
        return np.asarray(_turns(self.sweep * self.normal, s) @ first)

    def poses(self, places: Array) -> Array:
        """T_base_tool at places from 0 to 1 (k,), shape (k, 4, 4)."""
        s, T = np.asarray(places, dtype=np.float64), np.tile(np.eye(4), (len(places), 1, 1))
        T[:, :3, :3] = _turns(self.turn, s) @ self.T_start[:3, :3]
        start = self.T_start[:3, 3]
        if self.kind == "lin":
            T[:, :3, 3] = start + s[:, None] * (self.T_end[:3, 3] - start)
        else:
            spoke = start - self.center
            T[:, :3, 3] = self.center + _turns(self.sweep * self.normal, s) @ spoke
        return T

    def places(self, points: Array) -> Array:
        """The place from 0 to 1 that is nearest to each of some points (k, 3), shape (k,)."""
        start = self.T_start[:3, 3]
        if self.kind == "lin":
            way = self.T_end[:3, 3] - start
            return np.clip((points - start) @ way / (way @ way), 0.0, 1.0)
        first = (start - self.center) / self.radius
        away = points - self.center
        angle = np.arctan2(away @ np.cross(self.normal, first), away @ first)
        # The turn of the angle that is nearest to the middle of the arc.
        middle = 0.5 * self.sweep
        angle -= 2.0 * np.pi * np.round((angle - middle) / (2.0 * np.pi))
        return np.clip(angle / self.sweep, 0.0, 1.0)


@contextmanager
def naming(where: str, **details: int) -> Iterator[None]:
    """A refusal within the block names where in the request it is."""
    try:
        yield
    except InvalidGoal as error:
        raise InvalidGoal(
            f"{where}: {error.message}", hint=error.hint, **details, **error.details
        ) from None


def line(T_start: Array, T_end: Array) -> ToolMotion:
    """The straight motion between two poses (4, 4); a turn on the spot where they share a place."""
    return ToolMotion("lin", T_start, T_end, np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.0)


def without_spin(T_start: Array, T_end: Array) -> Array:
    """The pose at an end (4, 4) with its axis z, turned there from a start (4, 4) the least way.

    The tool's axis z then runs along the great circle between the two.

    Raises:
        InvalidGoal: The two axes are opposite, and no way is the shortest.
    """
    z, w = T_start[:3, 2], T_end[:3, 2]
    axis, cosine = np.cross(z, w), float(z @ w)
    sine = float(np.linalg.norm(axis))
    # Sine of the angle between two axes from which on they count as opposite.
    if sine < 1e-6 and cosine < 0.0:
        raise InvalidGoal(
            "the tool's axis is turned to the opposite: no way there is the shortest",
            hint="Put a waypoint between that says by which way, or give both a direction.",
        )
    R = T_start[:3, :3]
    if sine > 0.0:
        R = from_axis_angle(axis / sine, math.atan2(sine, cosine)) @ R
    return np.asarray(transform(R, T_end[:3, 3]))


def arc_via(T_start: Array, T_end: Array, via: ArrayLike) -> ToolMotion:
    """The arc between two poses (4, 4) through a point ``via`` (3,) [m].

    Its centre is that of the circle through the three points: with a = start - via and
    b = end - via, c = via + ((|a|^2 b - |b|^2 a) x (a x b)) / (2 |a x b|^2).

    Raises:
        InvalidGoal: The three points lie on a line, or two of them are the same.
    """
    p, q, r = T_start[:3, 3], _point(via, "via"), T_end[:3, 3]
    a, b = p - q, r - q
    across = np.cross(a, b)
    square = float(across @ across)
    longest = max(float(np.linalg.norm(x)) for x in (a, b, r - p))
    if math.sqrt(square) <= _COLLINEAR * longest * longest or np.linalg.norm(r - p) < _NO_LENGTH:
        whole = np.linalg.norm(r - p) < _NO_LENGTH
        raise InvalidGoal(
            "the start, via and end of a circular motion "
            + ("name no circle: start and end are the same" if whole else "lie on one line"),
            hint="Give center and normal for a full circle."
            if whole
            else "Move via off the line, or ask for a motion of type lin.",
            start=p.tolist(),
            via=q.tolist(),
            end=r.tolist(),
        )
    center = q + np.cross((a @ a) * b - (b @ b) * a, across) / (2.0 * square)
    # Turning about this normal, the three points follow each other in this order.
    normal = np.cross(q - p, r - q)
    normal /= np.linalg.norm(normal)
    return ToolMotion("circ", T_start, T_end, center, normal, _sweep(p, r, center, normal))


def arc_about(
    T_start: Array, T_end: Array, center: ArrayLike, normal: ArrayLike | None = None
) -> ToolMotion:
    """The arc between two poses (4, 4) about a centre (3,) [m].

    Args:
        T_start: Beginning of the motion.
        T_end: End, as far from the centre; where it begins, for a full circle.
        center: Center of the circle [m].
        normal: Axis (3,) to turn about by the right hand, up to a whole turn. Where none is given
            the shorter of the two arcs is taken.

    Raises:
        InvalidGoal: Start and end are not equally far from the centre or not across the normal,
            or no normal is given and half a circle or a full one is asked for.
    """
    p, r, c = T_start[:3, 3], T_end[:3, 3], _point(center, "center")
    near, far = float(np.linalg.norm(p - c)), float(np.linalg.norm(r - c))
    told = {"start": p.tolist(), "center": c.tolist(), "end": r.tolist()}
    # Start and end may be this much unequally far from the centre of an arc, as part of its radius;
    # the arc then has the start's radius and the end is off by so much.
    unequal = 1e-6
    if near < _NO_LENGTH or abs(far - near) > unequal * near:
        raise InvalidGoal(
            f"a circular motion starts {near:.6g} m from its center and ends {far:.6g} m from it",
            hint="Give a center that is equally far from both and not on them, with more decimals, "
            "or a point on the arc (via).",
            **told,
        )
    if normal is None:
        axis = np.cross(p - c, r - c)
        if np.linalg.norm(axis) <= _COLLINEAR * near * far:
            whole = np.linalg.norm(r - p) < near
            raise InvalidGoal(
                "the center of a circular motion lies on one line with its start and end: "
                + ("a full circle" if whole else "half a circle")
                + " has no plane of its own",
                hint="Give normal, the axis to turn about by the right hand.",
                **told,
            )
    else:
        axis = _point(normal, "normal")
    if not (size := float(np.linalg.norm(axis))) > 0.0:
        raise InvalidGoal("the normal of a circular motion has no direction")
    axis = axis / size
    tilt = max(abs(float(axis @ (p - c))), abs(float(axis @ (r - c))))
    if tilt > unequal * near:
        raise InvalidGoal(
            f"the start or end of a circular motion is {tilt:.6g} m off the plane across its "
            "normal through its center",
            hint="Give a center and a normal whose plane holds both, with more decimals.",
            **told,
        )
    return ToolMotion("circ", T_start, T_end, c, axis, _sweep(p, r, c, axis))


def _turns(turn: Array, shares: Array) -> Array:
    """Rotations exp(s [turn]) for shares s (k,) of a rotation vector (3,), shape (k, 3, 3)."""
    angle = float(np.linalg.norm(turn))
    if angle <= _NO_ANGLE:
        return np.tile(np.eye(3), (len(shares), 1, 1))
    K = skew(turn / angle)
    sine, cosine = np.sin(shares * angle)[:, None, None], np.cos(shares * angle)[:, None, None]
    return np.asarray(np.eye(3) + sine * K + (1.0 - cosine) * (K @ K))


def _sweep(start: Array, end: Array, center: Array, normal: Array) -> float:
    """Angle from start to end about the normal, in (0, 2 pi]; 2 pi where they are the same."""
    a, b = start - center, end - center
    angle = math.atan2(float(normal @ np.cross(a, b)), float(a @ b)) % (2.0 * math.pi)
    least = _NO_LENGTH / float(np.linalg.norm(a))
    return 2.0 * math.pi if angle <= least or 2.0 * math.pi - angle <= least else angle


def _point(values: ArrayLike, name: str) -> Array:
    point = np.asarray(values, dtype=np.float64)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise InvalidGoal(f"{name} of a circular motion must be three finite numbers")
    return point
