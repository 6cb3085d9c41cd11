"""The tube around a reference that a tracked motion stays in, by displacements of its links.

Use of a robot's limits by a tracked motion.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidOption
from kinematics.forward import joint_frames
from kinematics.model.chain import JointType, Limits
from obstacles.convex.piece import Piece, PieceKind
from obstacles.robots.robot_geometry import RobotGeometry
from tracking.tube.motion_bounds import MotionBounds, Quantity


class LimitUse(NamedTuple):
    """Largest use of one kind of limit.

    Args:
        ratio: Largest |value| / limit of all joints; for positions of the distance from the middle
            of the range to half the range. 1 is at the limit.
        joint: Index of the joint.
    """

    ratio: float
    joint: int


def limit_uses(bounds: MotionBounds, limits: Limits) -> dict[str, LimitUse]:
    """Use of the position, velocity and torque limits that are finite.

    Positions and velocities are bounded over every step of the integrator; so are torques of a
    simulation with a tube, which are those at the samples otherwise.
    """
    rows = bounds.visited_cells()
    lower, upper = bounds.lower[rows], bounds.upper[rows]
    if not len(rows):
        return {}
    low = lower[:, Quantity.POSITION].min(axis=0) - bounds.global_error[0]
    high = upper[:, Quantity.POSITION].max(axis=0) + bounds.global_error[0]
    limited = np.isfinite(limits.lower) & np.isfinite(limits.upper)
    least, greatest = np.where(limited, limits.lower, 0.0), np.where(limited, limits.upper, 0.0)
    middle, half = 0.5 * (greatest + least), 0.5 * (greatest - least)
    off = np.maximum(high - middle, middle - low)
    velocity = bounds.global_error[1] + np.maximum(
        upper[:, Quantity.VELOCITY].max(axis=0), -lower[:, Quantity.VELOCITY].min(axis=0)
    )
    values = {
        "position": (off, half),
        "velocity": (velocity, limits.velocity),
        "torque": (bounds.peak_torque, limits.effort),
    }
    uses = {name: _largest(value, limit) for name, (value, limit) in values.items()}
    return {name: use for name, use in uses.items() if use is not None}


def _largest(value: Array, limit: Array) -> LimitUse | None:
    """The joint with the largest value / limit; None where no limit is finite and positive."""
    known = np.isfinite(limit) & (limit > 0.0)
    if not known.any():
        return None
    ratio = np.where(known, value / np.where(known, limit, 1.0), -np.inf)
    joint = int(np.argmax(ratio))
    return LimitUse(float(ratio[joint]), joint)


class Points(NamedTuple):
    """Balls whose convex hull holds the pieces on one joint (v balls).

    Args:
        joint: The joint that carries them, -1 for the base.
        centers: Centres of the balls in the joint's frame, shape (v, 3) [m].
        radii: Shape (v,) [m].
        starts: First ball of each piece, shape (p,).
        links: Name of the link (or attached object) of each piece, p names.
    """

    joint: int
    centers: Array
    radii: Array
    starts: NDArray[np.int64]
    links: tuple[str, ...]


def points_of(robot: RobotGeometry, pieces: Sequence[int]) -> Points:
    """Balls that hold some pieces of a robot, all carried by one joint."""
    balls = [_balls(robot.pieces[k]) for k in pieces]
    return Points(
        int(robot.joints[pieces[0]]),
        np.concatenate([centers for centers, _ in balls]),
        np.concatenate([radii for _, radii in balls]),
        np.cumsum([0, *(len(radii) for _, radii in balls[:-1])]),
        tuple(robot.links[k] for k in pieces),
    )


def _balls(piece: Piece) -> tuple[Array, Array]:
    """Balls whose hull holds a piece: centres in its joint's frame (v, 3), radii (v,)."""
    if piece.kind == PieceKind.POLYTOPE:
        corners, radius = piece.vertices, piece.offset_radius
    elif piece.kind == PieceKind.HALFSPACE:
        return np.zeros((1, 3)), np.array([np.inf])
    else:
        ends = np.array([-piece.half_height, piece.half_height])
        corners = np.column_stack([np.zeros((2, 2)), ends])
        radius = piece.radius + piece.offset_radius
    T = piece.T_owner_piece
    return corners @ T[:3, :3].T + T[:3, 3], np.full(len(corners), radius)


def relative_frames(frames: Array, base: int, joint: int) -> Array:
    """Frames of a joint, seen from that of joint ``base`` (-1 for the base), shape (m, 4, 4).

    Args:
        frames: Frames of all joints in the base frame, shape (m, n, 4, 4).
        base: The joint that sees.
        joint: The joint that is seen.
    """
    if base < 0:
        return frames[:, joint]
    R = frames[:, base, :3, :3].transpose(0, 2, 1)
    seen = np.zeros((len(frames), 4, 4))
    seen[:, :3, :3] = R @ frames[:, joint, :3, :3]
    seen[:, :3, 3:] = R @ (frames[:, joint, :3, 3:] - frames[:, base, :3, 3:])
    seen[:, 3, 3] = 1.0
    return seen


def displacements(points: Points, before: Array, after: Array) -> Array:
    """Bound of the displacement of each piece of a joint, shape (m, p) [m].

    A point c + a of a ball, |a| <= r, moves by dT c + dR a, and |dR a| = 2 sin(angle / 2) |a| at
    most. The displacement is a convex function of the point, so over a hull it is largest at one
    of the balls.

    Args:
        points: The balls.
        before: Frames of their joint, shape (m, 4, 4).
        after: Frames of the joint after the displacement, shape (m, 4, 4).
    """
    change = after - before
    moved = np.einsum("mij,vj->mvi", change[:, :3, :3], points.centers) + change[:, None, :3, 3]
    # Frobenius norm of R' - R: sqrt(8) sin(angle / 2); its spectral norm is 2 sin(angle / 2).
    turn = np.linalg.norm(change[:, :3, :3], axis=(1, 2)) / np.sqrt(2.0)
    distance = np.linalg.norm(moved, axis=2) + turn[:, None] * points.radii
    return np.asarray(np.maximum.reduceat(distance, points.starts, axis=1))


def reaches(robot: RobotGeometry, extension: Array) -> Array:
    """Largest distance of any point beyond each joint from its axis, in any configuration, (n,).

    Links are as if stretched out: origins of the frames between are counted at their distances,
    prismatic joints at ``extension`` (n,) [m]. For a prismatic joint it is 1.
    """
    chain, arrays = robot.chain, robot.arrays
    radius = np.zeros(chain.n)
    for piece, joint in enumerate(robot.joints):
        if joint >= 0:
            farthest = float(np.linalg.norm(arrays.centers[piece]) + arrays.radii[piece])
            radius[joint] = max(radius[joint], farthest)
    reach, beyond = np.empty(chain.n), 0.0
    for j in range(chain.n - 1, -1, -1):
        beyond = max(radius[j], beyond)
        slides = chain.joint_types[j] == JointType.PRISMATIC
        reach[j] = 1.0 if slides else beyond
        beyond += float(np.linalg.norm(chain.offsets[j][:3, 3])) + (extension[j] if slides else 0.0)
    return reach


def second_order(reach: Array, error: Array, change: Array) -> Array:
    """Bound of the change of x(q + e) - x(q) as q changes, sum_jk reach_max(j,k) |e_j| |dq_k|.

    The second derivative of a point's position by q_j and q_k is at most its distance from the
    axis of the later joint; 1 where that one slides.

    Args:
        reach: Reach of each joint by ``reaches``, shape (n,).
        error: |e|, shape (m, n) [rad or m].
        change: |dq|, shape (m, n) [rad or m].

    Returns:
        Shape (m,) [m].
    """
    n = len(reach)
    later = np.maximum.outer(np.arange(n), np.arange(n))
    return np.asarray(np.einsum("mj,jk,mk->m", error, reach[later], change))


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
