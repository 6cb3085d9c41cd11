"""Points of the arm that a potential pulls to the goal and pushes away from obstacles."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from compiled.kernel import kernel
from compiled.vec3 import cross
from kinematics.arrays import Array, Indices, frozen
from kinematics.caches.bounded_cache import bounded_cache
from kinematics.errors import InvalidOption
from kinematics.forward import frames_kernel
from kinematics.jacobian import jacobian_kernel
from kinematics.model.chain import Chain
from kinematics.model.dh import frame_origins
from obstacles.convex.piece import Piece, PieceKind
from obstacles.robots.robot_geometry import RobotGeometry


@dataclass(frozen=True, slots=True, eq=False)
class ControlPoints:
    """Points carried by joints, m in all.

    Args:
        joints: Index of the joint that carries each, shape (m,).
        places: Positions in that joint's frame, shape (m, 3) [m].
        radii: Radius of the arm about each, shape (m,) [m]; 0 for bare points.
    """

    joints: Indices
    places: Array
    radii: Array

    def __post_init__(self) -> None:
        joints = np.array(self.joints, dtype=np.int64).reshape(-1)
        joints.setflags(write=False)
        object.__setattr__(self, "joints", joints)
        object.__setattr__(self, "places", frozen(self.places).reshape(-1, 3))
        object.__setattr__(self, "radii", frozen(self.radii).reshape(-1))

    def __len__(self) -> int:
        return len(self.joints)


def origin_points(chain: Chain, radii: float | Sequence[float] = 0.0) -> ControlPoints:
    """O_1 ... O_n of the course notes, see ``kinematics.model.dh.frame_origins``.

    Args:
        chain: The robot.
        radii: Radius of the arm about each, one for all or n [m].

    Raises:
        InvalidOption: There is another number of radii.
    """
    return ControlPoints(np.arange(chain.n), frame_origins(chain), _radii(radii, chain.n))


def named_points(
    chain: Chain, points: Sequence[tuple[str, Array]], radii: float | Sequence[float] = 0.0
) -> ControlPoints:
    """Points of one's own: a link that moves, and a place in its frame, each.

    Args:
        chain: The robot.
        points: Names of links, and positions in their frames, shape (3,) [m].
        radii: Radius of the arm about each, one for all or one each [m].

    Raises:
        InvalidLinkName: No such link.
        InvalidOption: A link does not move, or there is another number of radii.
    """
    joints, places = [], []
    for name, point in points:
        link = chain.link(name)
        if link.joint < 0:
            raise InvalidOption(
                f"control_points: link {name!r} does not move, so no force moves a point of it",
                hint="Name links that joints carry.",
            )
        joints.append(link.joint)
        places.append(link.T_joint_link[:3, :3] @ point + link.T_joint_link[:3, 3])
    return ControlPoints(np.array(joints), np.array(places), _radii(radii, len(points)))


def _radii(radii: float | Sequence[float], count: int) -> Array:
    about = np.array(radii, dtype=np.float64)
    if about.ndim == 1 and len(about) != count:
        raise InvalidOption(
            f"point_radii has {len(about)} value(s), there are {count} control points",
            hint="Give one number for all of them, or one for each, base to tip.",
            control_points=count,
        )
    return np.array(np.broadcast_to(about, count))


@bounded_cache(maxsize=32)
def along_links(robot: RobotGeometry) -> ControlPoints:
    """Points along the solids of every moving link, with the radius of the solid about them.

    A robot without solids has the origins of its frames.
    """
    entries = [
        (joint, *point)
        for piece, joint in zip(robot.pieces, robot.joints, strict=True)
        if joint >= 0
        for point in _axis_points(piece)
    ]
    if not entries:
        return origin_points(robot.chain)
    joints, places, radii = zip(*entries, strict=True)
    return ControlPoints(np.array(joints), np.array(places), np.array(radii))


def _axis_points(piece: Piece) -> list[tuple[Array, float]]:
    """Points on the longest axis of a piece's box, and half its width."""
    if piece.kind == PieceKind.HALFSPACE:
        return []
    box = piece.local_box()
    half = box[3:]
    longest = int(np.argmax(half))
    width = float(np.delete(half, longest).max())
    count = 1
    # A piece longer than this many times its width gets several points, each for about as much.
    if half[longest] > 1.5 * width:
        # Points along one piece at most.
        count = min(int(np.ceil(half[longest] / width)), 4)
    reach = half[longest] - width if count > 1 else 0.0
    T = piece.T_owner_piece
    points = []
    for at in np.linspace(-reach, reach, count):
        local = box[:3].copy()
        local[longest] += at
        points.append((T[:3, :3] @ local + T[:3, 3], width))
    return points


@kernel(allocates=False)
def _mimic_joint_kernel(chain: Array, frames: Array, point: Array, body: int, J: Array) -> None:
    """Write the linear rows of the Jacobian of a point that a mimic joint's body carries into J."""
    n = J.shape[1]
    J[:] = 0.0
    while body >= 0:
        row, leader, parent, share = 1 + body, body, body - 1, 1.0
        if body >= n:
            row = int(chain[0, 3]) + 2 * (body - n)
            leader, parent, share = int(chain[row + 1, 0]), int(chain[row, 13]), chain[row + 1, 1]
        F = frames[body]
        v = (F[0, 2], F[1, 2], F[2, 2])
        if chain[row, 0] == 0.0:
            v = cross(v, (point[0] - F[0, 3], point[1] - F[1, 3], point[2] - F[2, 3]))
        J[0, leader] += share * v[0]
        J[1, leader] += share * v[1]
        J[2, leader] += share * v[2]
        body = parent


@kernel
def control_points_kernel(
    chain: Array,
    joints: Indices,
    places: Array,
    q: Array,
    points: Array,
    jacobians: Array,
) -> None:
    """Write the control points (m, 3) and their linear Jacobians (m, 3, n) at q (n,)."""
    n = q.shape[0]
    frames, J = np.empty((n + int(chain[0, 2]), 4, 4)), np.empty((6, n))
    frames_kernel(chain, q, frames)
    for i in range(joints.shape[0]):
        F = frames[joints[i]]
        for row in range(3):
            points[i, row] = F[row, 3]
            for k in range(3):
                points[i, row] += F[row, k] * places[i, k]
        # The Jacobian of the whole arm at this point, cut off after the joint that carries it.
        jacobian_kernel(chain, frames, points[i], min(joints[i], n - 1), J)
        if joints[i] >= n:
            _mimic_joint_kernel(chain, frames, points[i], joints[i], J)
        for row in range(3):
            for j in range(n):
                jacobians[i, row, j] = J[row, j]


def control_points(chain: Chain, where: ControlPoints, q: Array) -> tuple[Array, Array]:
    """The control points at q (n,), shape (m, 3) [m], and their Jacobians (m, 3, n)."""
    m, n = len(where), chain.n
    points, jacobians = np.empty((m, 3)), np.empty((m, 3, n))
    at = np.array(q, dtype=np.float64)  # one that can be written to, as the kernel is compiled for
    control_points_kernel(chain.model, where.joints, where.places, at, points, jacobians)
    return points, jacobians
