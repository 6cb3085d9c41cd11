"""Swept volume of a motion: convex hulls that together hold all that the arm takes up.

Within a time h the path of a point differs from the chord between its ends by at most h^2 A / 8, A
the largest acceleration of the point. With the rates v and accelerations a of the joints, and L_k
the farthest that a point carried by the piece can be from joint k,

    A <= sum_k L_k a_k + sum_i sum_k L_max(i,k) v_i v_k,

since d2p / dq_i dq_k = z_i x (z_k x (p - o_k)) for i <= k. Each piece of the robot is taken at the
ends of a cell of time; the hull of both, grown by that bound, holds it in between.
"""

from dataclasses import dataclass

import numpy as np

from kinematics.arrays import Array, typed
from kinematics.errors import InvalidOption
from kinematics.forward import joint_frames
from kinematics.model.branch import BodyTree
from kinematics.trajectory.trajectory import Trajectory
from obstacles.convex.piece import Hull, convex_hull
from obstacles.convex.triangles import Triangles, corners, join
from obstacles.robots.robot_geometry import RobotGeometry, arms, pieces_beyond

#: Points about a ball of radius 1 whose hull holds it: an octahedron.
_ABOUT_A_BALL = np.sqrt(3.0) * np.vstack([np.eye(3), -np.eye(3)])


@dataclass(frozen=True, slots=True, eq=False)
class SweptVolume:
    """The space that an arm takes up during a motion, and a little more.

    Args:
        hulls: Convex solids in the root frame that overlap; every point of the robot is in one of
            them at every instant.
        tolerance: No hull reaches farther than sqrt(3) times this beyond the hull of a piece's
            places at the ends of its cell of time [m].
    """

    hulls: tuple[Hull, ...]
    tolerance: float

    def surface(self) -> Triangles:
        """The surfaces of all hulls, as one set of triangles."""
        return join(Triangles(hull.vertices, hull.triangles) for hull in self.hulls)


@typed
def swept_volume(
    motion: Trajectory, robot: RobotGeometry, *, tolerance: float = 0.005
) -> SweptVolume:
    """The space that the moving parts of a robot take up during a motion.

    Args:
        motion: The motion.
        robot: The robot with what it holds; round pieces count as polyhedra around them, meshes as
            the hulls that cover them.
        tolerance: Distance that the hulls may be grown by [m].

    Raises:
        InvalidOption: The tolerance is not positive, or asks for too many hulls.
    """
    if not 0.0 < tolerance < np.inf:
        raise InvalidOption("tolerance must be positive", hint="Give 0.005 for 5 mm.")
    moving = [i for i in range(len(robot.pieces)) if robot.joints[i] >= 0]
    times = _cells(motion, robot, tolerance)
    # Cells of time times moving pieces: a hull of each takes about 0.3 ms and 5 kB.
    max_hulls = 50_000
    if len(times) * len(moving) > max_hulls:
        raise InvalidOption(
            f"a tolerance of {tolerance:g} m asks for {len(times) * len(moving)} hulls, at most "
            f"{max_hulls} are made",
            hint="Allow a larger tolerance: halves of it take 1.4 times as many.",
        )
    frames = np.stack([joint_frames(robot.chain, q) for q in motion.sample(times)])
    hulls = []
    for i in moving:
        piece, poses = robot.pieces[i], frames[:, robot.joints[i]]
        T = poses @ piece.T_owner_piece
        points = corners(piece, around=True) @ T[:, :3, :3].swapaxes(1, 2) + T[:, None, :3, 3]
        hulls += [_cell_hull(points[k], points[k + 1], tolerance) for k in range(len(times) - 1)]
    return SweptVolume(tuple(hulls), tolerance)


def _cell_hull(begin: Array, end: Array, tolerance: float) -> Hull:
    """The hull of two sets of points, each shape (k, 3), grown by a ball."""
    core = convex_hull(np.vstack([begin, end])).vertices
    return convex_hull((core[:, None] + tolerance * _ABOUT_A_BALL).reshape(-1, 3))


def _cells(motion: Trajectory, robot: RobotGeometry, tolerance: float) -> Array:
    """Times between which chords are good enough, the ends of the motion among them [s]."""
    tree = BodyTree.of(robot.chain)
    levers = _lever_arms(motion, robot, tree)
    rates, accelerations = (
        tree.rates(np.maximum(-low, high)) for low, high in map(motion.piece_extrema, (1, 2))
    )
    times = [np.zeros(1)]
    for k, (begin, end) in enumerate(zip(motion.breaks, motion.breaks[1:], strict=False)):
        bound = _acceleration_bound(levers, rates[k], accelerations[k])
        count = max(int(np.ceil((end - begin) * np.sqrt(bound / (8.0 * tolerance)))), 1)
        times.append(np.linspace(begin, end, count + 1)[1:])
    return np.concatenate(times)


def _acceleration_bound(levers: Array, rates: Array, accelerations: Array) -> float:
    """The largest acceleration of any point [m/s^2].

    Args:
        levers: Levers of each joint, those that follow others last, shape (b,) [m]; 1 or more for a
            slide.
        rates: Largest of each joint, shape (b,) [rad/s or m/s].
        accelerations: Largest of each joint, shape (b,) [rad/s^2 or m/s^2].
    """
    n = len(levers)
    outer = np.maximum(np.arange(n)[:, None], np.arange(n))
    return float(levers @ accelerations + rates @ levers[outer] @ rates)


def _lever_arms(motion: Trajectory, robot: RobotGeometry, tree: BodyTree) -> Array:
    """The farthest that a point can be from each joint that carries it, shape (bodies,) [m]."""
    extrema = motion.extrema()
    largest = tree.positions(np.maximum(np.abs(extrema.minimum), np.abs(extrema.maximum)))
    levers = arms(tree, pieces_beyond(robot), largest)
    # A point moves as far as its slide does: a lever of one.
    return np.where(tree.slides, np.maximum(levers, 1.0), levers)
