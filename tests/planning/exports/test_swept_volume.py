"""Swept volumes: every point of the arm is in a hull at every instant, and hulls are no larger."""

import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import armwright as aw
from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.forward import forward, joint_frames
from kinematics.trajectory.trajectory import Trajectory
from obstacles.convex.triangles import corners
from obstacles.robots.robot_geometry import RobotGeometry
from planning.exports.swept_volume import SweptVolume, swept_volume
from tests.mimic_joints import mimic_robot

ROUNDING = 1e-9


def swing(robot: RobotGeometry, seconds: float, seed: int) -> Trajectory:
    """A motion of two quintic pieces through random configurations, at rest at its ends."""
    rng = np.random.default_rng(seed)
    lower, upper = robot.chain.sampling_bounds()
    ends = rng.uniform(0.3 * lower, 0.3 * upper, (3, robot.chain.n))
    ease = np.array([0.0, 0.0, 0.0, 10.0, -15.0, 6.0]) / seconds ** np.arange(6)
    pieces = [
        begin[:, None] * np.eye(6)[0] + (end - begin)[:, None] * ease
        for begin, end in itertools.pairwise(ends)
    ]
    breaks = np.array([0.0, seconds, 2.0 * seconds])
    return Trajectory(robot.chain.joint_names, breaks, np.array(pieces))


def arm_points(robot: RobotGeometry, q: Array, rng: np.random.Generator) -> Array:
    """Points of the moving parts in a configuration: corners, and some on round surfaces."""
    frames, points = joint_frames(robot.chain, q), []
    for piece, joint in zip(robot.pieces, robot.joints, strict=True):
        if joint < 0:
            continue
        own = corners(piece)
        if len(piece.vertices) and piece.offset_radius > 0.0:
            ball = Rotation.random(20, random_state=int(rng.integers(2**31))).as_matrix()[:, 2]
            chosen = piece.vertices[rng.integers(len(piece.vertices), size=20)]
            own = np.vstack([own, chosen + piece.offset_radius * ball])
        T = frames[joint] @ piece.T_owner_piece
        points.append(own @ T[:3, :3].T + T[:3, 3])
    return np.vstack(points)


def depth(swept: SweptVolume, points: Array) -> Array:
    """How far each point is outside of the hull that holds it best, 0 or below inside [m].

    Infinite for points that are in no hull's box.
    """
    best = np.full(len(points), np.inf)
    for hull in swept.hulls:
        low, high = hull.vertices.min(axis=0), hull.vertices.max(axis=0)
        near = ((points >= low) & (points <= high)).all(axis=1)
        if near.any():
            outside = points[near] @ hull.planes[:, :3].T - hull.planes[:, 3]
            best[near] = np.minimum(best[near], outside.max(axis=1))
    return best


@pytest.mark.parametrize("name", ["planar_rr", "stanford", "mimic joints"])
def test_every_point_of_the_arm_is_in_a_hull_at_every_instant(name: str) -> None:
    robot = mimic_robot() if name == "mimic joints" else aw.load_robot(name)
    motion = swing(robot, 0.8, seed=3)
    swept = swept_volume(motion, robot, tolerance=0.2)
    rng = np.random.default_rng(4)
    for time in rng.uniform(0.0, motion.duration, 6):
        points = rng.permutation(arm_points(robot, motion.sample([time])[0], rng))[:60]
        assert depth(swept, points).max() <= ROUNDING


def test_hulls_reach_no_farther_than_the_tolerance_allows() -> None:
    robot = aw.load_robot("planar_rr")
    motion, tolerance = swing(robot, 1.5, seed=5), 0.05
    swept = swept_volume(motion, robot, tolerance=tolerance)
    rng = np.random.default_rng(6)
    near = np.vstack([arm_points(robot, q, rng) for q in motion.sample(
        np.linspace(0.0, motion.duration, 100))])[::4]  # fmt: skip
    for hull in swept.hulls[:: len(swept.hulls) // 4]:
        gaps = [np.linalg.norm(near - corner, axis=1).min() for corner in hull.vertices[::6]]
        # Corners about round pieces stand a little off them, and sampled points are not dense.
        assert max(gaps) <= np.sqrt(3.0) * tolerance + 0.03


def test_what_an_arm_holds_is_swept_with_it() -> None:
    robot = aw.load_robot("planar_rr")
    T = np.eye(4)
    T[0, 3] = 0.4
    held = robot.attach(aw.Obstacle("part", aw.Sphere(0.05), T), robot.chain.tip_link)
    motion = swing(robot, 1.5, seed=8)
    bare, loaded = (swept_volume(motion, arm, tolerance=0.1) for arm in (robot, held))
    tip = forward(robot.chain, motion.start) @ T
    assert depth(loaded, tip[None, :3, 3])[0] < 0.0
    assert depth(bare, tip[None, :3, 3])[0] > 0.0


@pytest.mark.parametrize("tolerance", [0.0, -1.0, float("nan"), 1e-9])
def test_tolerances_that_can_not_be_kept_are_refused(tolerance: float) -> None:
    robot = aw.load_robot("planar_rr")
    with pytest.raises(InvalidOption):
        swept_volume(swing(robot, 1.5, seed=9), robot, tolerance=tolerance)
