"""Tool motions that follow each other without a rest, as one motion with one place s.

The place runs from 0 to 1 and is proportional to the length of the whole: motion k with length l_k
takes the part l_k / sum l of it.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from kinematics.arrays import Array, frozen
from planning.tool_motions.tool_corner import CurveKind, ToolCurve
from planning.tool_motions.tool_tolerance import ToolTolerance

#: Of what a motion is a part: a list of motions, or a seam with what leads to it and from it.
PartName = Literal["motion", "approach", "seam", "retreat"]


class RunPart(NamedTuple):
    """One motion of a run.

    Args:
        motion: The motion.
        begin: Place of the run where it begins.
        end: Place of the run where it ends.
        asked: Index of the motion of the request that it is a part of.
        blends: Whether it rounds the corner at the end of that motion.
        tolerance: Box that the tool may be in; None where it is to follow the motion.
        tool_speed: Speed to be kept [m/s]; None for none.
    """

    motion: ToolCurve
    begin: float
    end: float
    asked: int
    blends: bool
    tolerance: ToolTolerance | None
    tool_speed: float | None


@dataclass(frozen=True, slots=True, eq=False)
class ToolRun:
    """Tool motions from rest to rest.

    Args:
        motions: In order, each from where the one before ends; of positive length where there are
            several.
        asked: Index of the motion of the request that each is a part of.
        blends: Whether each rounds the corner at the end of that motion.
        tolerances: Of each motion the box that the tool may be in; empty where it is to follow the
            motions.
        tool_speeds: Of each motion the speed to be kept [m/s]; empty for the largest that the
            limits allow.
        name: Of what it is a part.
    """

    motions: tuple[ToolCurve, ...]
    asked: tuple[int, ...]
    blends: tuple[bool, ...]
    tolerances: tuple[ToolTolerance, ...] = ()
    tool_speeds: tuple[float, ...] = ()
    name: PartName = "motion"

    @classmethod
    def of(cls, motion: ToolCurve, asked: int = 0) -> "ToolRun":
        """A run of one motion."""
        return cls((motion,), (asked,), (False,))

    @property
    def kind(self) -> CurveKind:
        """Kind of the first motion."""
        return self.motions[0].kind

    @property
    def breaks(self) -> Array:
        """Places where motions begin, and 1, shape (k + 1,)."""
        if len(self.motions) == 1:
            return frozen([0.0, 1.0])
        lengths = np.cumsum([motion.length for motion in self.motions])
        return frozen(np.concatenate([[0.0], lengths[:-1] / lengths[-1], [1.0]]))

    @property
    def parts(self) -> tuple[RunPart, ...]:
        """The motions with their places."""
        breaks = self.breaks.tolist()
        boxes = self.tolerances or (None,) * len(self.motions)
        speeds = self.tool_speeds or (None,) * len(self.motions)
        columns = (self.motions, breaks[:-1], breaks[1:], self.asked, self.blends, boxes, speeds)
        return tuple(RunPart(*row) for row in zip(*columns, strict=True))

    @property
    def length(self) -> float:
        """Length of the path of the tool's origin [m]."""
        return sum(motion.length for motion in self.motions)

    @property
    def angle(self) -> float:
        """Sum of the angles that the tool turns by [rad]."""
        return sum(motion.angle for motion in self.motions)

    def locate(self, s: float) -> tuple[ToolCurve, float]:
        """The motion at a place of the run, and the place on that motion."""
        breaks = self.breaks
        k = min(int(np.searchsorted(breaks, s, side="right")) - 1, len(self.motions) - 1)
        return self.motions[k], float((s - breaks[k]) / (breaks[k + 1] - breaks[k]))

    def pose(self, s: float) -> Array:
        """T_base_tool at a place from 0 to 1, shape (4, 4)."""
        if len(self.motions) == 1:
            return self.motions[0].pose(s)
        motion, at = self.locate(s)
        return motion.pose(at)

    def poses(self, places: Array) -> Array:
        """T_base_tool at places from 0 to 1 (k,), shape (k, 4, 4)."""
        s, breaks = np.asarray(places, dtype=np.float64), self.breaks
        owner = np.searchsorted(breaks[1:-1], s, side="right")
        poses = np.empty((len(s), 4, 4))
        for k in np.unique(owner):
            mine = owner == k
            at = (s[mine] - breaks[k]) / (breaks[k + 1] - breaks[k])
            poses[mine] = self.motions[k].poses(at)
        return poses

    def parts_until(self, reached: float) -> tuple[RunPart, ...]:
        """The parts that begin before a place of the run; the first one always."""
        return tuple(part for part in self.parts if part.begin < reached or part.begin == 0.0)


def run_of(motion: ToolCurve | ToolRun, asked: int = 0) -> ToolRun:
    """A motion as a run of its own; a run as it is.

    Args:
        motion: A motion or a run.
        asked: Index of the motion of the request, for a motion.
    """
    return motion if isinstance(motion, ToolRun) else ToolRun.of(motion, asked)
