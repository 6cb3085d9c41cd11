"""Joint paths that lead the tool along lines and arcs, before they are timed."""

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from kinematics.arrays import Array
from planning.timing.path.path import JointPath
from planning.tool_motions.tool_motion import ToolMotion
from planning.tool_motions.tool_run import ToolRun, run_of

Reason = Literal["limit", "singularity", "unreachable", "branch", "collision", "deviation", "time"]


@dataclass(frozen=True, slots=True)
class Stop:
    """The place where a motion can be followed no further, and the reason.

    Args:
        at: Place on the motion, from 0 to 1.
        reason: What stood in the way.
        message: One sentence.
        details: Values a program can use.
    """

    at: float
    reason: Reason
    message: str
    details: dict[str, Any]


@dataclass(frozen=True, slots=True, eq=False)
class ToolSegment:
    """A joint path that keeps the tool on its motion.

    Args:
        path: With s for its parameter; None where the joints do not move at all.
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
        position: Of its origin [m].
        orientation: Of its orientation [rad]; None where that is free.
    """

    position: float
    orientation: float | None

    @property
    def pair(self) -> tuple[float, float]:
        """Both tolerances, infinite where the orientation is free [m], [rad]."""
        return self.position, np.inf if self.orientation is None else self.orientation


@dataclass(frozen=True, slots=True, eq=False)
class ToolPath:
    """Joint paths that lead the tool along its motions.

    Args:
        motions: Motions, or runs of several without a rest, that were begun.
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

    motions: tuple[ToolMotion | ToolRun, ...]
    segments: tuple[ToolSegment, ...]
    fraction: float
    stop: Stop | None
    tolerances: Tolerances
    transits: tuple[tuple[int, Array], ...] = ()
    speed_band: float | None = None

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
    def runs(self) -> tuple[ToolRun, ...]:
        """The motions as runs from rest to rest."""
        return tuple(run_of(motion, k) for k, motion in enumerate(self.motions))

    @property
    def moving(self) -> list[tuple[ToolMotion | ToolRun, JointPath]]:
        """The motions in which the joints move, with their joint paths."""
        pairs = zip(self.motions, self.segments, strict=True)
        return [(motion, segment.path) for motion, segment in pairs if segment.path is not None]
