"""No point of a robot leaves its tube, and the tube is not much wider than the motion needs."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics.model.body import scale_masses
from kinematics.arrays import Array
from kinematics.robots import builtin_srdf, builtin_urdf
from kinematics.trajectory.trajectory import Trajectory
from kinematics.tree.serial_chain import serial_chain
from kinematics.tree.srdf import parse_srdf
from kinematics.urdf.urdf import parse_urdf
from obstacles.collision.fcl_distance import FclWorld
from obstacles.robots.robot_geometry import RobotGeometry, robot_geometry
from obstacles.scenes.scene import Scene
from tests.tracking.corners import corner_displacement
from tests.tracking.samples import smooth
from tracking.controllers.model_based import ComputedTorque
from tracking.simulation.result import SimulationResult
from tracking.simulation.simulation import SimulationOptions, simulate
from tracking.tube.motion_bounds import MotionBounds, bound_step, empty_bounds
from tracking.tube.tube import tube

PANDA = np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.8])
OPTIONS = SimulationOptions(saturate=False, sample_period=1e-3, tube=True)


def geometry(name: str) -> RobotGeometry:
    description, semantics = parse_urdf(builtin_urdf(name)), parse_srdf(builtin_srdf(name))
    return robot_geometry(
        serial_chain(description, semantics=semantics), description, None, semantics
    )


def tracked(robot: RobotGeometry, start: Array, w: float = 15.0) -> SimulationResult:
    """A motion tracked with a model a tenth too heavy."""
    chain = robot.chain
    path = smooth(chain, start, start + np.linspace(0.6, -0.4, chain.n))
    controller = ComputedTorque.by_pole_placement(scale_masses(chain, 1.1), w)
    return simulate(controller, path, OPTIONS, robot=chain)


@pytest.mark.parametrize("name", ["panda", "ur5e", "scara", "stanford"])
def test_the_bound_is_within_half_of_the_true_displacement(name: str) -> None:
    robot = geometry(name)
    start = PANDA if name == "panda" else np.full(robot.chain.n, 0.3)
    result = tracked(robot, start)
    around = tube(robot, result.bounds)
    true = max(
        corner_displacement(robot, q, wanted)
        for q, wanted in zip(result.position, result.reference_position, strict=True)
    )
    assert true <= around.displacement <= 1.5 * true
    assert set(around.links) == {
        link for link, joint in zip(robot.links, robot.joints, strict=True) if joint >= 0
    }


def test_every_pair_of_links_keeps_what_its_displacement_leaves() -> None:
    robot = geometry("panda")
    result = tracked(robot, PANDA, w=6.0)
    around = tube(robot, result.bounds)
    names = sorted(set(robot.links))
    every = {(a, b): "same body" for i, a in enumerate(names) for b in names[i + 1 :]}
    for pair, moved in list(around.pairs.items())[::4]:
        allowed = {key: why for key, why in every.items() if set(key) != set(pair)}
        world = FclWorld(replace(robot, allowed=allowed), Scene(()))
        loss = max(
            world.clearance(wanted).distance - world.clearance(q).distance
            for q, wanted in zip(
                result.position[::100], result.reference_position[::100], strict=True
            )
        )
        assert loss <= moved.distance, pair


def test_the_first_joint_moves_no_link_against_another() -> None:
    robot = geometry("panda")
    bounds = constant_bounds(robot, PANDA, np.array([0.1, 0, 0, 0, 0, 0, 0]))
    around = tube(robot, bounds)
    assert around.displacement > 0.03
    # Only the base sees the arm turn.
    base = {n for n, j in zip(robot.links, robot.joints, strict=True) if j < 0}
    seen = {near for (near, _), moved in around.pairs.items() if moved.distance > 1e-9}
    assert seen <= base
    assert {near for near, _ in around.pairs} - base


def constant_bounds(robot: RobotGeometry, q: Array, error: Array) -> MotionBounds:
    """Bounds of a robot that stands ``error`` short of a reference at rest for a second."""
    n = robot.chain.n
    bounds = empty_bounds(1.0, n)
    motion = np.zeros((2 * n, 8))
    motion[:n, 0] = q
    bound_step(bounds, (q + error)[:, None], 0.0, motion, 0.0, 1.0)
    return bounds


@pytest.mark.parametrize("name", ["panda", "stanford", "cart_pendulum"])
def test_points_of_random_errors_stay_within(name: str) -> None:
    robot = geometry(name)
    chain, rng = robot.chain, np.random.default_rng(0)
    lower, upper = chain.sampling_bounds()
    for _ in range(12):
        q = rng.uniform(lower, upper)
        error = rng.uniform(-0.3, 0.3, chain.n)
        around = tube(robot, constant_bounds(robot, q, error))
        true = corner_displacement(robot, q + error, q)
        assert true <= around.displacement + 1e-12
        np.testing.assert_allclose(around.joint_error, np.abs(error), rtol=1e-12)


def test_no_error_costs_nothing() -> None:
    robot = geometry("panda")
    around = tube(robot, constant_bounds(robot, PANDA, np.zeros(7)))
    assert around.displacement == 0.0
    assert max(moved.distance for moved in around.pairs.values()) < 1e-12
    assert (np.diff(around.reach) <= 0.0).all()


def test_what_the_integrator_may_be_off_widens_the_tube() -> None:
    robot = geometry("panda")
    bounds = constant_bounds(robot, PANDA, np.full(7, 0.01))
    wider = bounds._replace(global_error=np.full((2, 7), 1e-3))
    exact, widened = tube(robot, bounds), tube(robot, wider)
    np.testing.assert_allclose(widened.joint_error - exact.joint_error, 1e-3)
    more = widened.displacement - exact.displacement
    assert more >= 1e-3 * widened.reach.max()


def test_a_robot_that_slides_out_reaches_farther() -> None:
    robot = geometry("stanford")
    still = Trajectory(robot.chain.joint_names, np.array([0.0, 1.0]), np.zeros((1, 6, 1)))
    near, far = still.start.copy(), still.start.copy()
    far[2] = 0.5
    short = tube(robot, constant_bounds(robot, near, np.zeros(6))).reach
    long = tube(robot, constant_bounds(robot, far, np.zeros(6))).reach
    np.testing.assert_allclose(long[:2] - short[:2], 0.5)
    assert short[2] == long[2] == 1.0
