"""Displacement of a robot's points between two configurations, of whole links and relative ones."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array
from kinematics.model.chain import JointType
from obstacles.convex.piece import Piece, PieceKind
from obstacles.robots.robot_geometry import RobotGeometry


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
