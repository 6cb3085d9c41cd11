"""No point of a robot leaves the tube that its joint errors allow."""

import numpy as np
import pytest

from kinematics.chain import JointType
from kinematics.forward import joint_frames
from kinematics.robots import builtin_srdf, builtin_urdf
from kinematics.serial_chain import serial_chain
from kinematics.srdf import parse_srdf
from kinematics.trajectory import Trajectory
from kinematics.urdf import parse_urdf
from obstacles.fcl_distance import FclWorld
from obstacles.robot_geometry import RobotGeometry, robot_geometry
from obstacles.scene import Obstacle, Scene
from obstacles.shapes import Sphere
from tests.tracking.samples import smooth
from tracking.tube import reaches, tube


def geometry(name: str) -> RobotGeometry:
    description, semantics = parse_urdf(builtin_urdf(name)), parse_srdf(builtin_srdf(name))
    return robot_geometry(
        serial_chain(description, semantics=semantics), description, None, semantics
    )


@pytest.mark.parametrize("name", ["panda", "ur5e", "stanford", "scara", "cart_pendulum"])
def test_points_stay_within_the_displacement(name: str) -> None:
    robot = geometry(name)
    chain, rng = robot.chain, np.random.default_rng(0)
    lower, upper = chain.sampling_bounds()
    worst = 0.0
    for _ in range(200):
        q = rng.uniform(lower, upper)
        error = rng.uniform(0.0, 0.3, chain.n) * (rng.uniform(size=chain.n) < 0.5)
        still = Trajectory(chain.joint_names, np.array([0.0, 1.0]), q[None, :, None])
        around = tube(robot, still, error)
        off = q + error * rng.choice([-1.0, 1.0], chain.n)
        here, there = joint_frames(chain, q), joint_frames(chain, off)
        for piece, joint in zip(robot.pieces, robot.joints, strict=True):
            if joint < 0:
                continue
            R, center = piece.T_owner_piece[:3, :3], piece.T_owner_piece[:3, 3]
            p = np.vstack([np.zeros((1, 3)), piece.vertices.reshape(-1, 3)]) @ R.T + center
            moved = (there[joint] - here[joint])[:3, :3] @ p.T
            moved = moved + (there[joint] - here[joint])[:3, 3:]
            most = float(np.linalg.norm(moved, axis=0).max())
            assert most <= around.displacement + 1e-12
            worst = max(worst, most / around.displacement if around.displacement else 0.0)
    # And the bound is one that is nearly reached, not any number.
    assert worst > 0.3


def test_what_remains_is_less_than_what_there_is() -> None:
    robot = geometry("ur5e")
    chain = robot.chain
    ball = Obstacle("ball", Sphere(0.1), np.array(
        [[1, 0, 0, -0.6], [0, 1, 0, 0.5], [0, 0, 1, 0.3], [0, 0, 0, 1]], dtype=float
    ))  # fmt: skip
    world = FclWorld(robot, Scene((ball,)))
    rng = np.random.default_rng(1)
    start = np.array([0.3, -1.2, 1.4, -1.7, -1.5, 0.0])
    path = smooth(chain, start, start + 0.3)
    for _ in range(20):
        error = rng.uniform(0.0, 0.05, chain.n)
        around = tube(robot, path, error)
        t = rng.uniform()
        q = path.sample([t])[0]
        off = q + error * rng.uniform(-1.0, 1.0, chain.n)
        assert world.clearance(off).distance >= around.remaining_clearance(
            world.clearance(q).distance
        )


def test_no_error_costs_nothing() -> None:
    robot = geometry("panda")
    q = np.zeros(7)
    around = tube(robot, smooth(robot.chain, q, q + 1.0), np.zeros(7))
    assert around.displacement == 0.0
    assert around.remaining_clearance(0.02) == 0.02
    assert (np.diff(around.reach) <= 0.0).all()


@pytest.mark.parametrize("name", ["panda", "stanford", "scara"])
def test_a_larger_error_makes_a_wider_tube(name: str) -> None:
    robot = geometry(name)
    chain = robot.chain
    still = Trajectory(chain.joint_names, np.array([0.0, 1.0]), np.zeros((1, chain.n, 1)))
    error = np.full(chain.n, 0.01)
    single, double = tube(robot, still, error), tube(robot, still, 2.0 * error)
    np.testing.assert_array_equal(double.joint_error, 2.0 * single.joint_error)
    assert double.displacement >= 2.0 * single.displacement > 0.0
    assert single.displacement == pytest.approx(single.reach @ error)
    assert single.remaining_clearance(0.5) == pytest.approx(0.5 - single.displacement)


def test_a_prismatic_joint_moves_its_links_by_its_own_error_and_lengthens_those_before() -> None:
    robot = geometry("stanford")
    chain = robot.chain
    slides = int(np.flatnonzero(chain.joint_types == JointType.PRISMATIC)[0])
    near, far = np.zeros(chain.n), np.zeros(chain.n)
    far[slides] = 0.5
    short, long = reaches(robot, near), reaches(robot, far)
    assert short[slides] == long[slides] == 1.0
    np.testing.assert_allclose(long[:slides] - short[:slides], 0.5)
    np.testing.assert_array_equal(long[slides:], short[slides:])


def test_a_reference_that_slides_out_widens_its_tube() -> None:
    robot = geometry("stanford")
    chain = robot.chain
    slides = int(np.flatnonzero(chain.joint_types == JointType.PRISMATIC)[0])
    coefficients = np.zeros((1, chain.n, 2))
    coefficients[0, slides] = [0.1, 0.8]
    out = Trajectory(chain.joint_names, np.array([0.0, 1.0]), coefficients)
    still = Trajectory(chain.joint_names, np.array([0.0, 1.0]), coefficients[:, :, :1])
    error = np.full(chain.n, 0.01)
    wider = tube(robot, out, error).reach - tube(robot, still, error).reach
    np.testing.assert_allclose(wider[:slides], 0.8)
    # Off by its error, the joint may be out farther than the reference ever is.
    off = np.zeros(chain.n)
    off[slides] = 0.05
    farther = tube(robot, still, off).reach - tube(robot, still, 0.0 * off).reach
    np.testing.assert_allclose(farther[:slides], 0.05)
