"""Arcs about a centre as people write them: start, end, centre and normal with few decimals.

A circle through the start, which is where the arm stands, and the end has its centre c on the plane
that halves the chord d, and its normal n across d. What is written misses that by rounding:
c and n are moved there, c' = c + ((m - c).d) d with m between start and end, and n' = n - (n.d) d;
then either n' is turned about d, or c' moved along n', until both ends lie in the plane. The arc is
taken where it stays as near to the circle that was asked for as rounding, or the deviation that
is allowed, explains.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidGoal
from kinematics.pose import transform
from kinematics.rounding import rounding
from planning.tool_motions.tool_motion import ToolMotion, arc_about

#: Arcs are moved by this part of their radius at most, however few decimals they are written with.
_MOST_MOVED = 0.1
#: Points of an arc that are compared with the circle that was asked for.
_COMPARED = 33


@dataclass(frozen=True, slots=True)
class WrittenArc:
    """An arc about a centre, as a request gives it.

    Args:
        T_start: Where it begins, shape (4, 4).
        T_end: Where it ends, shape (4, 4).
        center: Shape (3,) [m].
        normal: Axis to turn about by the right hand, shape (3,); None for the shorter arc.
        start_rounding: Of each coordinate of the start [m]; 0 where the arm stands there.
    """

    T_start: Array
    T_end: Array
    center: Array
    normal: Sequence[float] | None
    start_rounding: float

    def motion(self, max_deviation: float) -> ToolMotion:
        """The arc.

        Args:
            max_deviation: So much it may be off the circle that is asked for, or more by
                rounding [m].

        Raises:
            InvalidGoal: Start, end and centre name no circle within these.
        """
        p, r, c = self.T_start[:3, 3], self.T_end[:3, 3], self.center
        of_ends, T_end = self.start_rounding + rounding(r), self.T_end
        if self.normal is None:
            across, along = _across_and_along(p, r, c)
            if across <= 2.0 * max(of_ends + rounding(c), along):
                c = 0.5 * (p + r)  # on their line to rounding: no plane is meant
        elif np.abs(r - p).max() <= of_ends:
            T_end = transform(T_end[:3, :3], p)  # a whole turn
        try:
            return arc_about(self.T_start, T_end, c, self.normal)
        except InvalidGoal:
            motion = self._nearest(T_end, c)
            if motion is None or self._miss(motion) > max(max_deviation, self._rounding()):
                raise
            return motion

    def _nearest(self, T_end: Array, c: Array) -> ToolMotion | None:
        """The nearest arc through start and end; None where there is none near."""
        p, r = self.T_start[:3, 3], T_end[:3, 3]
        chord, normal = r - p, None
        length = float(np.linalg.norm(chord))
        d = chord / length if length > 0.0 else chord
        c = c + float((0.5 * (p + r) - c) @ d) * d
        if self.normal is not None:
            n = np.array(self.normal) / math.hypot(*self.normal)
            n -= float(n @ d) * d
            n /= np.linalg.norm(n)
            spoke = 0.5 * (p + r) - c
            rise, size = float(n @ spoke), float(np.linalg.norm(spoke))
            if abs(rise) <= self._tilt() * size:
                n -= rise / size**2 * spoke
            else:
                c = c + rise * n
            normal = n
        moved = float(np.linalg.norm(c - self.center))
        if not moved <= _MOST_MOVED * float(np.linalg.norm(p - c)):
            return None
        return arc_about(self.T_start, T_end, c, normal)

    def _miss(self, motion: ToolMotion) -> float:
        """How far an arc is off the circle that is asked for, at most [m]."""
        away = motion.poses(np.linspace(0.0, 1.0, _COMPARED))[:, :3, 3] - self.center
        miss = float(np.abs(np.linalg.norm(away, axis=1) - np.linalg.norm(away[0])).max())
        if self.normal is None:
            return miss
        rises = away @ np.array(self.normal) / math.hypot(*self.normal)
        return max(miss, float(np.abs(rises).max()))

    def _tilt(self) -> float:
        """Angle by which rounding turns the normal, at most [rad]."""
        assert self.normal is not None
        return math.sqrt(3.0) * rounding(self.normal) / math.hypot(*self.normal)

    def _rounding(self) -> float:
        """How far rounding moves the ends off the circle, at most [m], to first order."""
        p, r, c = self.T_start[:3, 3], self.T_end[:3, 3], self.center
        of_start, of_end, of_center = self.start_rounding, rounding(r), rounding(c)
        radius = float(np.linalg.norm(p - c))
        errors = of_start * np.abs(p - c) + of_end * np.abs(r - c) + of_center * np.abs(r - p)
        radial = float(errors.sum()) / radius
        if self.normal is None:
            return radial
        off_plane = math.sqrt(3.0) * (max(of_start, of_end) + of_center) + self._tilt() * radius
        return max(radial, off_plane)


def _across_and_along(p: Array, r: Array, c: Array) -> tuple[float, float]:
    """How far a centre is off the line through start and end, and from the middle along it [m]."""
    length = float(np.linalg.norm(r - p))
    spoke = c - 0.5 * (p + r)
    along = float(spoke @ (r - p)) / length if length > 0.0 else 0.0
    return math.sqrt(max(float(spoke @ spoke) - along * along, 0.0)), abs(along)
