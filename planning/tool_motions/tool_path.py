"""Joint paths that lead the tool along lines and arcs, before they are timed."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import accumulate
from typing import Any, Literal, NamedTuple

import numpy as np

from kinematics.arrays import Array, frozen
from kinematics.pose import transform
from planning.timing.path.path import JointPath
from planning.tool_motions.tool_corner import ToolCurve
from planning.tool_motions.tool_motion import line
from planning.tool_motions.tool_tolerance import ToolTolerance

#: Of what a motion is a part: a list of motions, or a seam with what leads to it and from it.
PartName = Literal["motion", "approach", "seam", "retreat"]
Reason = Literal["limit", "singularity", "unreachable", "branch", "collision", "deviation", "time"]


class RunPart(NamedTuple):
    """One motion of a run.

    Args:
        motion: The motion.
        begin: Place of the run where it begins.
        end: Place of the run where it ends.
        asked: Index of the motion of the request that it is a part of.
        blends: Whether the motion rounds the corner at the end of that motion.
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
        motions: Motions in order, each from where the one before ends; of positive length where
            there are several.
        asked: Index of the motion of the request that each is a part of.
        blends: Whether each rounds the corner at the end of that motion.
        tolerances: Tolerances of each motion the box that the tool may be in; empty where it is to
            follow the motions.
        tool_speeds: Tool speeds of each motion the speed to be kept [m/s]; empty for the largest
            that the limits allow.
        name: Name of what it is a part.
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

    @classmethod
    def straight(cls, T_start: Array, way: Array) -> "ToolRun":
        """A run along one line from a pose (4, 4) by a way (3,) [m], without a turn."""
        return cls.of(line(T_start, transform(T_start[:3, :3], T_start[:3, 3] + way)))

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

    def pose(self, s: float) -> Array:
        """T_base_tool at a place from 0 to 1, shape (4, 4)."""
        return np.asarray(self.poses(np.array([s]))[0])

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


@dataclass(frozen=True, slots=True)
class Stop:
    """Reason why a motion can be followed no further.

    Args:
        reason: Reason in a word.
        message: One sentence.
        details: Values a program can use.
    """

    reason: Reason
    message: str
    details: dict[str, Any]


@dataclass(frozen=True, slots=True, eq=False)
class ToolSegment:
    """A joint path that keeps the tool on its motion.

    Args:
        path: Path with s for its parameter; None where the joints do not move at all.
        start: Configuration it begins with, shape (n,).
        end: Configuration it ends with, shape (n,).
        reached: Place on the motion where it ends.
        stop: Why it ends before 1; None where it does not.
    """

    path: JointPath | None
    start: Array
    end: Array
    reached: float
    stop: Stop | None

    def reverse(self) -> "ToolSegment":
        """Return the whole joint path backwards."""
        path = None if self.path is None else self.path.reverse()
        return ToolSegment(path, self.end, self.start, 1.0, None)

    def cut(self, at: float, stop: Stop) -> "ToolSegment":
        """Return the part up to a place on the motion, with the stop there."""
        if self.path is None or at >= self.reached:
            return replace(self, stop=stop)
        breaks = self.path.breaks
        last = int(np.searchsorted(breaks, at, side="left")) - 1
        if last < 0:
            return ToolSegment(None, self.start, self.start, 0.0, stop)
        lengths = np.append(self.path.lengths[:last], at - breaks[last])
        path = JointPath(self.path.coefficients[: last + 1], lengths)
        return ToolSegment(path, self.start, path.sample([path.length])[0], at, stop)


@dataclass(frozen=True, slots=True)
class Tolerances:
    """Largest deviations of the tool from its motion.

    Args:
        position: Largest deviation of the origin [m].
        orientation: Largest deviation of the orientation [rad]; None where that is free.
        share: Part of both that joint paths use at samples: the rest is left to what lies between
            them, and to the bounds of the proof.
    """

    position: float
    orientation: float | None
    share: float = 0.9

    @property
    def pair(self) -> tuple[float, float]:
        """Both tolerances, infinite where the orientation is free [m], [rad]."""
        return self.position, np.inf if self.orientation is None else self.orientation


@dataclass(frozen=True, slots=True, eq=False)
class ToolPath:
    """Joint paths that lead the tool along its motions.

    Args:
        runs: Motions from rest to rest that were begun.
        segments: The joint path of each.
        fraction: How much of all motions asked for was carried out: those that were completed,
            and the share of the one that was not, over their number.
        stop: Why it ends early; None where it does not.
        tolerances: How far the tool may be off its motions.
        transits: Free motions before some of the motions: the index of the motion that each leads
            to, and its waypoints, shape (k, n).
        speed_band: Largest difference from the speeds that runs ask for, as part of them; None
            where none is asked for.
    """

    runs: tuple[ToolRun, ...]
    segments: tuple[ToolSegment, ...]
    fraction: float
    stop: Stop | None
    tolerances: Tolerances
    transits: tuple[tuple[int, Array], ...] = ()
    speed_band: float | None = None

    @classmethod
    def joined(cls, paths: "Sequence[ToolPath]") -> "ToolPath":
        """Complete paths of one tolerance, one after the other."""
        firsts = accumulate((len(path.runs) for path in paths), initial=0)
        return replace(
            paths[0],
            runs=tuple(run for path in paths for run in path.runs),
            segments=tuple(segment for path in paths for segment in path.segments),
            transits=tuple(
                (first + k, waypoints)
                for first, path in zip(firsts, paths, strict=False)
                for k, waypoints in path.transits
            ),
        )

    def reverse(self) -> "ToolPath":
        """Path of one completed line, backwards."""
        (run,), (segment,) = self.runs, self.segments
        back = line(run.motions[0].T_end, run.motions[0].T_start)
        return replace(self, runs=(replace(run, motions=(back,)),), segments=(segment.reverse(),))

    @property
    def waypoints(self) -> Array:
        """The configurations that the curves go through, shape (k, n)."""
        transits = dict(self.transits)
        rows = [] if 0 in transits else [self.segments[0].start]
        for k, item in enumerate(self.segments):
            rows += list(transits[k][1 if k > 0 else 0 :]) if k in transits else []
            if item.path is not None:
                rows += [*item.path.coefficients[1:, :, 0], item.end]
        return np.array(rows)

    @property
    def moving(self) -> list[tuple[ToolRun, JointPath]]:
        """The runs in which the joints move, with their joint paths."""
        pairs = zip(self.runs, self.segments, strict=True)
        return [(run, segment.path) for run, segment in pairs if segment.path is not None]
