"""Tubes hold every point of a robot and every instant of its motion, and are hardly wider."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import BPoly, CubicHermiteSpline

from dynamics.model.body import scale_masses
from kinematics.arrays import Array
from kinematics.model.chain import Limits
from kinematics.robots import builtin_srdf, builtin_urdf
from kinematics.trajectory.trajectory import Trajectory
from kinematics.tree.serial_chain import serial_chain
from kinematics.tree.srdf import parse_srdf
from kinematics.urdf.urdf import parse_urdf
from obstacles.collision.fcl_distance import FclWorld
from obstacles.robots.robot_geometry import RobotGeometry, robot_geometry
from obstacles.scenes.scene import Scene
from tests.tracking.corners import corner_displacement
from tests.tracking.samples import constant, slider, smooth
from tracking.controllers.model_based import ComputedTorque, IndependentJoint
from tracking.simulation.result import SimulationResult
from tracking.simulation.simulation import SimulationOptions, simulate
from tracking.tube.motion_bounds import (
    MotionBounds,
    Quantity,
    bound_step,
    empty_bounds,
    hermite_polynomials,
)
from tracking.tube.tube import limit_uses, tube

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


@pytest.mark.parametrize("period", [0.37, 1.0])
@pytest.mark.parametrize("tolerance", [1e-3, 1e-4, 1e-8])
@pytest.mark.parametrize("has_tube", [True, False])
def test_the_largest_error_between_samples_is_not_missed(
    period: float, tolerance: float, has_tube: bool
) -> None:
    """An oscillator of 1 rad/s and damping 0.1: the overshoot has a closed form."""
    w, zeta = 6.0, 0.1
    chain = slider(1.0)
    controller = IndependentJoint(chain, np.array([w**2]), np.array([2 * zeta * w]), np.ones(1))
    options = SimulationOptions(
        saturate=False,
        sample_period=period,
        relative_tolerance=tolerance,
        absolute_tolerance=tolerance * 1e-2,
        tube=has_tube,
    )
    result = simulate(
        controller,
        constant(chain, np.zeros(1), 2.0),
        options,
        initial_position=[0.0],
        initial_velocity=[1.0],
    )
    wd = w * np.sqrt(1.0 - zeta**2)
    t = np.arctan2(wd, zeta * w) / wd
    peak = np.exp(-zeta * w * t) * np.sin(wd * t) / wd
    assert np.abs(result.tracking_error).max() < 0.95 * peak
    if has_tube:
        bound = result.max_tracking_error[0] + result.bounds.global_error[0, 0]
        assert peak <= bound
    # What the integrator is off adds up over the steps.
    assert result.max_tracking_error[0] == pytest.approx(peak, rel=max(1e-5, 10.0 * tolerance))


def test_velocities_and_positions_are_bounded_in_every_cell() -> None:
    chain = slider(2.0, friction=1.0)
    controller = IndependentJoint(chain, np.array([50.0]), np.array([4.0]), np.ones(1))
    path = constant(chain, np.array([0.3]), 1.0)
    options = SimulationOptions(saturate=False, control_period=5e-3, tube=True)
    result = simulate(controller, path, options, initial_position=[0.0])
    fine = simulate(
        controller,
        path,
        SimulationOptions(saturate=False, control_period=5e-3, sample_period=7e-4),
        initial_position=[0.0],
    )
    bounds = result.bounds
    assert bounds.visited_cells().tolist() == list(range(len(bounds.lower)))
    cells = np.minimum((fine.times / bounds.cell).astype(int), len(bounds.lower) - 1)
    for quantity, values in (
        (Quantity.ERROR, fine.tracking_error),
        (Quantity.POSITION, fine.position),
        (Quantity.VELOCITY, fine.velocity),
    ):
        assert (bounds.lower[cells, quantity] <= values + 1e-7).all()
        assert (bounds.upper[cells, quantity] >= values - 1e-7).all()
        width = bounds.upper[:, quantity] - bounds.lower[:, quantity]
        assert width.max() < 0.05
    np.testing.assert_allclose(bounds.peak_torque, np.abs(fine.torque).max(axis=0), rtol=1e-6)


def test_bounds_hold_over_implicit_steps() -> None:
    mass, b, Kp = 1e-3, 1e2, 50.0
    chain = slider(mass, b)
    controller = IndependentJoint(chain, np.array([Kp]), np.array([1.0]), np.array([mass]))
    path = constant(chain, np.zeros(1), 2.0)
    options = SimulationOptions(saturate=False, tube=True)
    result = simulate(controller, path, options, initial_position=[1.0])
    assert result.implicit_steps > 0
    exact = solve_ivp(
        lambda _, x: [x[1], (-Kp * x[0] - (b + 1.0) * x[1]) / mass],
        (0.0, 2.0),
        [1.0, 0.0],
        method="Radau",
        rtol=1e-10,
        atol=1e-12,
        t_eval=np.linspace(0.0, 2.0, 777),
    )
    cells = np.minimum((exact.t / result.bounds.cell).astype(int), len(result.bounds.lower) - 1)
    low, high = result.bounds.lower[cells], result.bounds.upper[cells]
    slack = 1e-6 + result.bounds.global_error[0]
    for quantity, row, sign in ((Quantity.POSITION, 0, 1.0), (Quantity.ERROR, 0, -1.0)):
        value = sign * exact.y[row]
        assert (low[:, quantity, 0] <= value + slack).all()
        assert (high[:, quantity, 0] >= value - slack).all()
        assert (high[:, quantity] - low[:, quantity]).max() < 0.01


def test_hermite_polynomials_are_those_of_scipy() -> None:
    rng = np.random.default_rng(2)
    x, end, before, after = rng.normal(size=(4, 4))
    before[:2], after[:2] = x[2:], end[2:]
    out = np.zeros((4, 8))
    h = 0.3
    hermite_polynomials(before, after, h, x, end, out)
    u = np.linspace(0.0, 1.0, 9)
    for i in range(2):
        ends = [[x[i], x[2 + i], before[2 + i]], [end[i], end[2 + i], after[2 + i]]]
        quintic = BPoly.from_derivatives([0.0, h], ends)
        cubic = CubicHermiteSpline([0.0, h], [x[2 + i], end[2 + i]], [before[2 + i], after[2 + i]])
        np.testing.assert_allclose(np.polynomial.polynomial.polyval(u, out[i]), quintic(u * h))
        np.testing.assert_allclose(np.polynomial.polynomial.polyval(u, out[2 + i]), cubic(u * h))


LIMITS = Limits(
    lower=np.array([-1.0, -np.inf]),
    upper=np.array([3.0, np.inf]),
    velocity=np.array([2.0, 4.0]),
    acceleration=np.full(2, np.inf),
    jerk=np.full(2, np.inf),
    effort=np.array([10.0, np.inf]),
)


def moving() -> MotionBounds:
    """Joint 1 from 0 to 2.5 at 2.5/s, joint 2 from 0 to -6 at -6/s, in one second."""
    bounds = empty_bounds(1.0, 2)
    motion = np.zeros((4, 8))
    motion[:2, 1] = 2.5, -6.0
    motion[2:, 0] = 2.5, -6.0
    bound_step(bounds, np.zeros((2, 1)), 0.0, motion, 0.0, 1.0)
    bounds.peak_torque[:] = 4.0, 100.0
    return bounds


def test_ratios_are_of_the_worst_joint() -> None:
    uses = limit_uses(moving(), LIMITS)
    # |2.5 - 1| / 2; |-6| / 4 beats 2.5 / 2; no torque limit of joint 2 is known.
    ratios = {name: use.ratio for name, use in uses.items()}
    assert ratios == pytest.approx({"position": 0.75, "velocity": 1.5, "torque": 0.4})
    assert {name: use.joint for name, use in uses.items()} == {
        "position": 0, "velocity": 1, "torque": 0,
    }  # fmt: skip


def test_the_start_counts_as_well_as_the_end() -> None:
    bounds = moving()
    farther = bounds._replace(global_error=np.array([[1.25, 0.0], [0.5, 0.0]]))
    uses = limit_uses(farther, LIMITS)
    assert uses["position"].ratio == pytest.approx((2.5 + 1.25 - 1.0) / 2.0)
    # |-6| / 4 of the other joint is still the most.
    assert uses["velocity"].ratio == pytest.approx(1.5)


def test_unknown_limits_have_no_ratio() -> None:
    assert limit_uses(moving(), Limits.unlimited(2)) == {}
    assert limit_uses(empty_bounds(1.0, 2), LIMITS) == {}
