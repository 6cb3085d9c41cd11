"""The tube around a reference that a tracked motion stays in: how far each link is displaced."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidOption
from kinematics.forward import joint_frames
from obstacles.robots.robot_geometry import RobotGeometry
from tracking.tube.displacement import (
    Points,
    displacements,
    points_of,
    reaches,
    relative_frames,
    second_order,
)
from tracking.tube.motion_bounds import MotionBounds, Quantity

#: Cells of time that are looked at together: their arrays stay in the processor's cache.
_TOGETHER = 128


@dataclass(frozen=True, slots=True)
class Displacement:
    """Largest displacement of a link from where it should be.

    Args:
        distance: A bound over all time [m].
        time: Start of the cell of time it happens in [s].
    """

    distance: float = 0.0
    time: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Tube:
    """Displacement bounds of a tracked motion.

    Args:
        joint_error: Largest |q^r - q| of each joint at any instant, shape (n,) [rad or m].
        reach: Largest motion of any point of the robot for a unit of each joint, shape (n,)
            [m/rad, or 1].
        links: Displacement of each moving link in space, by name: an obstacle comes no nearer to
            it than that.
        pairs: Displacement of the second link as the first one sees it, of the pairs that must not
            touch: they come no nearer to each other than that.
    """

    joint_error: Array
    reach: Array
    links: Mapping[str, Displacement]
    pairs: Mapping[tuple[str, str], Displacement]

    @property
    def displacement(self) -> float:
        """Largest displacement of any point of the robot in space [m]."""
        return max((item.distance for item in self.links.values()), default=0.0)


class _Cells(NamedTuple):
    """Centres and half widths of a motion's bounds (m cells, n joints).

    Args:
        times: Start of each cell, shape (m,) [s].
        actual: Joint frames in the middle of the positions' bounds, shape (m, n, 4, 4).
        wanted: Joint frames off by the middle of the errors' bounds, shape (m, n, 4, 4).
        error: Largest |e|, shape (m, n).
        error_radius: Half widths of the errors' bounds, shape (m, n).
        position_radius: Half widths of the positions' bounds, shape (m, n).
    """

    times: Array
    actual: Array
    wanted: Array
    error: Array
    error_radius: Array
    position_radius: Array


def tube(robot: RobotGeometry, bounds: MotionBounds) -> Tube:
    """The tube of a tracked motion.

    In the middle of each cell of time the displacement of every corner of every link is computed;
    what the errors change by within the cell, and what the integrator may be off, is added.

    Args:
        robot: The robot with what it holds.
        bounds: Bounds of the tracked motion, with a row for each cell of time.

    Raises:
        InvalidOption: The simulation kept no cells.
    """
    if not bounds.has_cells:
        raise InvalidOption(
            "the simulation kept no bounds in cells of time",
            hint="Simulate with the option tube=True.",
        )
    rows = bounds.visited_cells()
    lower, upper = bounds.lower[rows], bounds.upper[rows]
    middle, radius = 0.5 * (lower + upper), 0.5 * (upper - lower) + bounds.global_error[0]
    largest = np.abs(middle) + radius
    error, out = largest[:, Quantity.ERROR], largest[:, Quantity.POSITION]
    reach = reaches(robot, (out + error).max(axis=0, initial=0.0))
    q, e = middle[:, Quantity.POSITION], middle[:, Quantity.ERROR]
    cells = _Cells(
        np.asarray(rows * bounds.cell, dtype=np.float64),
        np.asarray(joint_frames(robot.chain, q)),
        np.asarray(joint_frames(robot.chain, q + e)),
        error,
        radius[:, Quantity.ERROR],
        radius[:, Quantity.POSITION],
    )
    links: dict[str, Displacement] = {}
    for joint in range(robot.chain.n):
        on_joint = np.flatnonzero(robot.joints == joint).tolist()
        if on_joint:
            links |= _displacements(cells, reach, -1, points_of(robot, on_joint))
    joint_error = error.max(axis=0, initial=0.0)
    return Tube(frozen(joint_error), frozen(reach), links, _pairs(robot, cells, reach))


def _pairs(
    robot: RobotGeometry, cells: _Cells, reach: Array
) -> dict[tuple[str, str], Displacement]:
    """Displacements of links seen from those that they must not touch."""
    seen: dict[tuple[int, int], set[tuple[int, int]]] = {}
    for a, b in robot.self_pairs.tolist():
        near, far = (a, b) if robot.joints[a] < robot.joints[b] else (b, a)
        joints = int(robot.joints[near]), int(robot.joints[far])
        seen.setdefault(joints, set()).add((near, far))
    pairs: dict[tuple[str, str], Displacement] = {}
    for (base, _), pieces in sorted(seen.items()):
        points = points_of(robot, sorted({far for _, far in pieces}))
        moved = _displacements(cells, reach, base, points)
        names = {(robot.links[near], robot.links[far]) for near, far in pieces}
        pairs |= {(near, far): moved[far] for near, far in sorted(names)}
    return pairs


def _displacements(
    cells: _Cells, reach: Array, base: int, points: Points
) -> dict[str, Displacement]:
    """Largest displacement of each link on a joint, seen from the frame of joint ``base``.

    Cells come in the order of a coarse bound, sum_k reach_k |e_k|, as long as it is larger than
    what was computed for some link.
    """
    # Only the joints between move the one against the other.
    between = np.zeros(len(reach))
    between[base + 1 : points.joint + 1] = 1.0
    lever = reach * between
    coarse = cells.error @ lever
    order = np.argsort(-coarse, kind="stable")
    largest = np.zeros(len(points.starts))
    times = np.zeros(len(points.starts))
    for first in range(0, len(order), _TOGETHER):
        if coarse[order[first]] <= largest.min():
            break
        rows = order[first : first + _TOGETHER]
        within = cells.error_radius[rows] @ lever
        error, change = cells.error[rows] * between, cells.position_radius[rows] * between
        within += second_order(reach, error, change)
        distance = displacements(
            points,
            relative_frames(cells.wanted[rows], base, points.joint),
            relative_frames(cells.actual[rows], base, points.joint),
        )
        distance += within[:, None]
        at = distance.argmax(axis=0)
        new = distance[at, np.arange(len(at))]
        times = np.where(new > largest, cells.times[rows[at]], times)
        largest = np.maximum(largest, new)
    moved: dict[str, Displacement] = {}
    for name, far, time in zip(points.links, largest.tolist(), times.tolist(), strict=True):
        if name not in moved or far > moved[name].distance:
            moved[name] = Displacement(far, time)
    return moved
