"""The path of a seam: runs of lines and arcs through its waypoints, and places along them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from kinematics.arrays import Array, Indices, frozen
from kinematics.errors import InvalidGoal
from planning.tool_motions.tool_motion import ToolMotion, arc_via, line, naming, without_spin
from planning.tool_motions.tool_path import ToolRun
from planning.tool_motions.tool_tolerance import SeamOptions, SeamWaypoint, ToolTolerance
from planning.tool_paths.blending import runs
from planning.tool_paths.projection import pack_tolerance


@dataclass(frozen=True, eq=False)
class SeamPlaces:
    """Places along a seam where configurations are searched for (k of them).

    Args:
        runs: The runs from rest to rest.
        run: Index of the run of each place, of the later one where two meet, shape (k,).
        s: Place on that run, shape (k,).
        nominal: Poses asked for, shape (k, 4, 4).
        tolerances: Tolerances there.
        directions: Unit tangents of the path, shape (k, 3).
        along: Length of the seam up to each place [m], shape (k,).
        turned: Angle that the path turns by up to each place [rad], shape (k,).
        waypoint: Index of the waypoint at or before each place, shape (k,).
        ends: Index of the last place of each run.
    """

    runs: tuple[ToolRun, ...]
    run: Indices
    s: Array
    nominal: Array
    tolerances: tuple[ToolTolerance, ...]
    directions: Array
    along: Array
    turned: Array
    waypoint: Indices
    ends: tuple[int, ...]
    boxes: Array = field(init=False)

    def __post_init__(self) -> None:
        # Tolerances as kernels read them, shape (k, 23).
        packed = {tolerance: pack_tolerance(tolerance) for tolerance in set(self.tolerances)}
        object.__setattr__(self, "boxes", np.array([packed[one] for one in self.tolerances]))

    @property
    def bent(self) -> Array:
        """Angle that the direction of the path turns by up to each place, shape (k,) [rad]."""
        cosines = np.einsum("ki,ki->k", self.directions[1:], self.directions[:-1])
        return np.concatenate([[0.0], np.cumsum(np.arccos(np.clip(cosines, -1.0, 1.0)))])

    def layers(self, every: bool = False) -> NDArray[np.int64]:
        """Indices of the places that the search checks: all of them, or some on the way."""
        if every:
            return np.arange(len(self.s))
        # Way between two layers of the search, where waypoints are nearer together [m].
        # Turn between two layers, likewise [rad].
        measure = np.maximum(self.along / 0.04, self.turned / 0.25)
        return np.array(spaced(measure))

    @property
    def length(self) -> float:
        """Length of the whole [m]."""
        return float(self.along[-1])


def seam_runs(options: SeamOptions, blend: float) -> tuple[ToolRun, ...]:
    """The path of a seam without deviation, corners rounded or flat.

    Args:
        options: The seam.
        blend: Distance from sharp corners at which the tool may leave its way [m]; 0 for a rest.

    Raises:
        InvalidGoal: Two waypoints at one place, or an arc that names no circle.
    """
    points = options.waypoints
    motions, axis_only = _ways(points), [point.axis_only for point in points[1:]]
    blends = [point.blend if point.blend is not None else blend for point in points[1:]]
    rounded = runs(motions, blends, arcs=True, axis_only=axis_only)
    boxes, speeds = [point.tolerance or options.tolerance for point in points], options.speeds
    return tuple(
        replace(
            run,
            tolerances=tuple(boxes[asked + 1] for asked in run.asked),
            tool_speeds=tuple(speeds[asked] for asked in run.asked) if speeds else (),
            name="seam",
        )
        for run in rounded
    )


def _ways(points: Sequence[SeamWaypoint]) -> list[ToolMotion]:
    """The motions between waypoints.

    Where one of the two says the tool's axis z alone, that alone is interpolated, along the great
    circle: the other axes are carried along without a spin, from the pose that says them.
    """
    ways: list[ToolMotion] = []
    T = points[0].T_base_tip
    for k, (first, last) in enumerate(pairwise(points)):
        T_end = last.T_base_tip
        # Waypoints nearer to each other than this are the same place [m].
        if np.linalg.norm(T_end[:3, 3] - T[:3, 3]) < 1e-6:
            raise InvalidGoal(
                f"waypoints[{k + 1}] is at the place of waypoints[{k}]",
                hint="Leave one of them out; for a turn on the spot give motions.",
                waypoint=k + 1,
            )
        with naming(f"between waypoints[{k}] and waypoints[{k + 1}]", waypoint=k + 1):
            if last.axis_only:
                T_end = without_spin(T, T_end)
            elif first.axis_only:
                T = without_spin(T_end, first.T_base_tip)
            way = line(T, T_end) if last.via is None else arc_via(T, T_end, last.via)
        ways.append(way)
        T = T_end
    return ways


def through_spline(seam: SeamOptions) -> tuple[SeamOptions, float]:
    """A seam with arcs through the middles of a cubic spline by the length of the chords.

    Corners above 60 degrees stay, and so do arcs that waypoints ask for.

    Args:
        seam: The seam.

    Returns:
        The seam, and how far the arcs leave the lines between its waypoints [m].
    """
    points = np.array([point.T_base_tip[:3, 3] for point in seam.waypoints])
    ways = np.diff(points, axis=0)
    lengths = np.maximum(np.linalg.norm(ways, axis=1), 1e-9)
    cosines = np.einsum("ki,ki->k", ways[1:], ways[:-1]) / (lengths[1:] * lengths[:-1])
    arcs = np.array([point.via is not None for point in seam.waypoints[1:]])
    cuts = np.flatnonzero((cosines < 0.5) | arcs[1:] | arcs[:-1]) + 1
    waypoints, most = list(seam.waypoints), 0.0
    for first, last in pairwise([0, *cuts.tolist(), len(points) - 1]):
        knots = np.arange(first, last + 1)
        at = np.concatenate([[0.0], np.cumsum(lengths[first:last])])
        if len(knots) < 3:
            continue
        middles = scipy.interpolate.CubicSpline(at, points[knots])(0.5 * (at[1:] + at[:-1]))
        away = np.linalg.norm(middles - 0.5 * (points[knots[1:]] + points[knots[:-1]]), axis=1)
        # Middles nearer to a chord than this name no arc [m].
        for k in np.flatnonzero(away > 1e-7 + 1e-5 * lengths[knots[:-1]]):
            waypoints[knots[k + 1]] = replace(waypoints[knots[k + 1]], via=middles[k])
            most = max(most, float(away[k]))
    return replace(seam, waypoints=tuple(waypoints), through="polyline"), most


def spaced(measure: Array) -> list[int]:
    """Indices of the fewest of some places, in order, that a measure (k,) has 1 apart at most."""
    chosen, last = [0], len(measure) - 1
    for k in range(1, last):
        if measure[k + 1] - measure[chosen[-1]] > 1.0:
            chosen.append(k)
    return [*chosen, last]


def seam_places(runs: tuple[ToolRun, ...]) -> SeamPlaces:
    """Places along runs: where motions meet, and as many between as the steps ask for.

    Args:
        runs: Runs from rest to rest, each from where the one before ends.
    """
    rows: list[tuple[int, float, ToolTolerance, Array, float, float, int]] = []
    ends: list[int] = []
    along = turned = 0.0
    for number, run in enumerate(runs):
        parts = run.parts
        # Places of a run at least.
        least = -(-8 // len(parts))
        for part in parts:
            assert part.tolerance is not None
            length, angle = part.motion.length, part.motion.angle
            # Longest way between two places of a seam [m].
            # Largest turn between two places [rad].
            steps = max(length / 0.015, angle / 0.075, float(least))
            count = math.ceil(steps - 1e-9)
            for i in range(count):
                share = i / count
                s = part.begin + share * (part.end - part.begin)
                direction = part.motion.direction(share)
                row = (direction, along + share * length, turned + share * angle, part.asked)
                rows.append((number, s, part.tolerance, *row))
            along, turned = along + length, turned + angle
        ends.append(len(rows))
    last = runs[-1].parts[-1]
    assert last.tolerance is not None
    ahead = last.motion.direction(1.0)
    rows.append((len(runs) - 1, 1.0, last.tolerance, ahead, along, turned, last.asked + 1))
    numbers, places, tolerances, directions, lengths, angles, waypoint = zip(*rows, strict=True)
    return SeamPlaces(
        runs,
        np.array(numbers),
        frozen(places),
        np.concatenate(
            [run.poses(frozen(places)[np.array(numbers) == k]) for k, run in enumerate(runs)]
        ),
        tolerances,
        frozen(directions),
        frozen(lengths),
        frozen(angles),
        np.array(waypoint),
        tuple(ends),
    )
