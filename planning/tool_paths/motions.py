"""The lines and arcs that a request asks for."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidGoal, InvalidOption
from kinematics.forward import forward
from kinematics.model.chain import Chain
from kinematics.pose import transform
from kinematics.rounding import TOLD, rounding
from kinematics.trajectory.trajectory import Trajectory
from planning.options import CartesianOptions, ToolMotionOptions
from planning.result import ToolMotionReport
from planning.tool_motions.tool_motion import ToolMotion, arc_about, arc_via, line
from planning.tool_paths.tool_deviation import places_at

#: Instants that are drawn over all motions together.
INSTANTS = 64


@dataclass(frozen=True, slots=True)
class WrittenArc:
    """An arc about a centre, as a request gives it.

    Args:
        T_start: Beginning of the motion, shape (4, 4).
        T_end: End of the motion, shape (4, 4).
        center: Shape (3,) [m].
        normal: Axis to turn about by the right hand, shape (3,); None for the shorter arc.
        start_rounding: Rounding of each coordinate of the start [m]; 0 where the arm stands there.
    """

    T_start: Array
    T_end: Array
    center: Array
    normal: Sequence[float] | None
    start_rounding: float

    def motion(self, max_deviation: float) -> ToolMotion:
        """The arc.

        Args:
            max_deviation: Distance that the arc may be off the circle that is asked for, or more by
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
        # Arcs are moved by this part of their radius at most, however few decimals they are written
        # with.
        if not moved <= 0.1 * float(np.linalg.norm(p - c)):
            return None
        return arc_about(self.T_start, T_end, c, normal)

    def _miss(self, motion: ToolMotion) -> float:
        """How far an arc is off the circle that is asked for, at most [m]."""
        # Points of an arc that are compared with the circle that was asked for.
        away = motion.poses(np.linspace(0.0, 1.0, 33))[:, :3, 3] - self.center
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


def tool_motions(
    T_start: Array, options: CartesianOptions, target: Array | None = None
) -> tuple[ToolMotion, ...]:
    """Return the motions that options ask for, each from where it begins, or the one before ends.

    Args:
        T_start: Pose of the tool at the start, shape (4, 4).
        options: The motions asked for.
        target: The goal's pose, shape (4, 4): what one line leads to if no motions are asked for.

    Raises:
        InvalidGoal: An arc whose points name no circle; the message says which motion.
        InvalidOption: There are neither motions nor a goal.
    """
    if not options.motions:
        if target is None:
            raise InvalidOption("there is no motion to be carried out")
        return (line(T_start, target),)
    motions: list[ToolMotion] = []
    T = T_start
    for i, item in enumerate(options.motions):
        motions.append(tool_motion(T, item, i, options.max_deviation))
        T = motions[-1].T_end
    return tuple(motions)


def tool_motion(
    T_start: Array, item: ToolMotionOptions, index: int, max_deviation: float
) -> ToolMotion:
    """Return one motion that is asked for.

    Args:
        T_start: Beginning of the motion, unless it says so itself, shape (4, 4).
        item: The motion.
        index: Index in the request, for messages.
        max_deviation: Distance that an arc may be off the circle that is asked for, or more by
            rounding [m].

    Raises:
        InvalidGoal: An arc whose points name no circle.
    """
    T, end = T_start, np.array(item.T_base_tip)
    if item.T_base_start is not None:
        T = np.array(item.T_base_start)
    # The first begins where the arm stands, which nobody wrote.
    written = index > 0 or item.T_base_start is not None
    start_rounding = rounding(T[:3, 3]) if written else 0.0
    try:
        if item.kind == "lin":
            motion = line(T, end)
        elif item.via is not None:
            motion = arc_via(T, end, item.via)
        else:
            assert item.center is not None
            arc = WrittenArc(T, end, np.array(item.center), item.normal, start_rounding)
            motion = arc.motion(max_deviation)
        # Angle below which a rotation has no axis [rad].
        if item.longer and motion.angle < 1e-6:
            raise InvalidGoal(
                "the tool does not turn, so that no rotation is the longer one",
                hint="Give the axis by a motion of half a turn, and another one.",
            )
        return replace(motion, longer=item.longer)
    except InvalidGoal as error:
        raise InvalidGoal(
            f"motions[{index}]: {error.message}", hint=error.hint, motion=index, **error.details
        ) from None


def repairs(options: CartesianOptions, motions: tuple[ToolMotion, ...]) -> tuple[str, ...]:
    """Notes on the arcs that are not quite the ones that were asked for.

    Args:
        options: The motions asked for.
        motions: The motions.
    """
    notes = []
    for i, (item, motion) in enumerate(zip(options.motions, motions, strict=False)):
        end = float(np.linalg.norm(motion.T_end[:3, 3] - item.T_base_tip[:3, 3]))
        center = 0.0 if item.center is None else float(np.linalg.norm(motion.center - item.center))
        if max(end, center) > TOLD:
            moved = f"its center was moved by {center:.2g} m"
            moved = moved if end <= TOLD else f"{moved}, its end to its start by {end:.2g} m"
            notes.append(f"motions[{i}] is a circle within rounding only: {moved}.")
    return tuple(notes)


class ReferencePose(NamedTuple):
    """The pose that the tool is held to at an instant.

    Args:
        time: The instant [s].
        motion: Index among the tool motions.
        T: T_base_tool, shape (4, 4).
    """

    time: float
    motion: int
    T: Array


def tool_reference(
    chain: Chain, trajectory: Trajectory, reports: Sequence[ToolMotionReport], seed: int
) -> tuple[ReferencePose, ...]:
    """The reference at instants drawn uniformly over the times of tool motions, in their order.

    Args:
        chain: The robot; its tip is the tool.
        trajectory: Trajectory of all its joints, in its order.
        reports: The motions with their times; none gives no instants.
        seed: Seed of the draw.
    """
    spans = np.array([max(report.ends - report.begins, 0.0) for report in reports])
    if not spans.sum() > 0.0:
        return ()
    drawn = np.sort(np.random.default_rng(seed).uniform(0.0, float(spans.sum()), INSTANTS))
    sums = np.cumsum(spans)
    owners = np.minimum(np.searchsorted(sums, drawn, side="right"), len(reports) - 1)
    begins = np.array([report.begins for report in reports])
    times = np.minimum(begins[owners] + drawn - (sums - spans)[owners], trajectory.duration)
    poses = forward(chain, trajectory.sample(times))
    return tuple(
        ReferencePose(time, k, reports[k].motion.pose(places_at(reports[k].motion, T[None])[0]))
        for time, k, T in zip(times.tolist(), owners.tolist(), poses, strict=True)
    )
