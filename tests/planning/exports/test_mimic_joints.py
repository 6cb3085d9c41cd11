"""Swept volumes and joint tolerances of a robot with links that mimic."""

import numpy as np
import pytest

from kinematics.forward import joint_frames
from kinematics.trajectory.trajectory import Trajectory
from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from obstacles.robots.robot_geometry import RobotGeometry, robot_geometry
from planning.exports.export import lever_arms
from planning.exports.swept_volume import swept_volume
from tests.mimic_joints import configurations, urdf


@pytest.fixture(scope="module")
def robot() -> RobotGeometry:
    description = parse_urdf(urdf())
    return robot_geometry(serial_chain(description, tip_link="flange"), description)


def test_swept_volumes_hold_all_links_at_all_times(robot: RobotGeometry) -> None:
    a, b = configurations(2, 3)
    step = 0.3 * (b - a)
    motion = Trajectory(
        robot.chain.joint_names, np.array([0.0, 1.0]),
        np.stack([a, 0.0 * a, 3.0 * step, -2.0 * step], axis=1)[None],
    )  # fmt: skip
    volume, random = swept_volume(motion, robot, tolerance=0.02), np.random.default_rng(4)
    planes = [
        (hull.vertices[hull.triangles[:, 0]], np.cross(
            hull.vertices[hull.triangles[:, 1]] - hull.vertices[hull.triangles[:, 0]],
            hull.vertices[hull.triangles[:, 2]] - hull.vertices[hull.triangles[:, 0]],
        ))
        for hull in volume.hulls
    ]  # fmt: skip
    for q in motion.sample(random.uniform(0.0, 1.0, 12)):
        frames = joint_frames(robot.chain, q)
        for piece, body in zip(robot.pieces, robot.joints, strict=True):
            if body < robot.chain.n:
                continue
            center, _ = piece.bounding_sphere()
            corners = piece.vertices if len(piece.vertices) else np.zeros((1, 3))
            T = frames[body] @ piece.T_owner_piece
            points = np.vstack(
                [corners @ T[:3, :3].T + T[:3, 3], (frames[body] @ [*center, 1])[:3]]
            )
            for point in points:
                assert any(
                    (np.einsum("ij,ij->i", normal, point - at) <= 1e-9).all()
                    for at, normal in planes
                )


def test_joints_that_are_off_move_no_point_farther_than_their_levers(robot: RobotGeometry) -> None:
    weights, random, largest = lever_arms(robot), np.random.default_rng(5), 0.0
    assert (weights[:4] > 0.5).all()
    for q in configurations(40, 6):
        off = random.uniform(-0.01, 0.01, 6)
        one, other = joint_frames(robot.chain, q), joint_frames(robot.chain, q + off)
        for piece, body in zip(robot.pieces, robot.joints, strict=True):
            if body < 0:
                continue
            center, radius = piece.bounding_sphere()
            points = center + radius * random.normal(size=(8, 3)) / 3.0
            moved = [points @ T[:3, :3].T + T[:3, 3] for T in (one[body], other[body])]
            inside = np.linalg.norm(points - center, axis=1) <= radius
            far = np.linalg.norm(moved[1] - moved[0], axis=1)[inside]
            share = float(far.max(initial=0.0)) / float(weights @ np.abs(off))
            largest = max(largest, share)
    assert 0.1 < largest <= 1.0
