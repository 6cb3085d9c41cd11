"""Jets of torques and tip velocities, against pinocchio at dense samples of each interval."""

import numpy as np
import pytest

from dynamics.model.body import Bodies, bodies
from kinematics.arrays import Array
from kinematics.forward import joint_frames
from kinematics.model.chain import Chain
from kinematics.robots import builtin_chain
from planning.proof.limits.effort_bounds import HALF, JET, MIDDLE, effort_bounds_kernel
from tests.planning.pinocchio_arm import PinocchioArm

NAMES = ["panda", "ur5e", "kr6_sixx"]


def derivatives(coefficients: Array) -> Array:
    """Coefficients (m, n, k) of position, velocity and acceleration, shape (3, m, n, k)."""
    k = coefficients.shape[2]
    padded, c = np.zeros((3, *coefficients.shape)), coefficients
    for order in range(3):
        padded[order, :, :, : c.shape[2]] = c
        c = c[:, :, 1:] * np.arange(1.0, c.shape[2])
    assert c.shape[2] == k - 3
    return padded


def bounds(
    chain: Chain, coefficients: Array, intervals: Array, robot: Bodies | None = None
) -> tuple[Array, Array]:
    torques = np.empty((len(intervals), chain.n, JET))
    velocities = np.empty((len(intervals), 3, JET))
    tip = np.array(chain.tip.T_joint_link[:3, 3])
    effort_bounds_kernel(
        robot or bodies(chain), tip, derivatives(coefficients), intervals, torques, velocities
    )
    return torques, velocities


def motion(chain: Chain, random: np.random.Generator) -> Array:
    """Two pieces of degree four about the home position, shape (2, n, 5)."""
    c = random.normal(size=(2, chain.n, 5)) * 0.5 ** np.arange(5)
    c[:, :, 0] = random.uniform(-1.0, 1.0, (2, chain.n))
    return c


def states(c: Array, times: Array) -> tuple[Array, Array, Array]:
    rows = [np.polynomial.Polynomial(row) for row in c]
    q, v, a = (np.array([row.deriv(order)(times) for row in rows]).T for order in range(3))
    return q, v, a


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("half", [1e-4, 1e-2, 0.2])
def test_torques_and_speeds_are_enclosed(name: str, half: float) -> None:
    chain, arm, random = builtin_chain(name), PinocchioArm(name), np.random.default_rng(1)
    c = motion(chain, random)
    intervals = np.array([[0, 0.3, half], [1, 0.5, half]])
    torques, velocities = bounds(chain, c, intervals)
    s = np.linspace(-half, half, 21)
    for k, (piece, middle, _) in enumerate(intervals):
        q, v, a = states(c[int(piece)], middle + s)
        exact = arm.torques_at(q, v, a)
        x, slope, curvature, error = torques[k].T
        rest = np.abs(exact - x - np.outer(s, slope))
        assert (rest <= 0.5 * np.outer(s * s, curvature) + error + 1e-9).all()
        # The tip's velocity in the last joint's axes: as long as in the base's.
        speeds = arm.tip_speeds_at(q, v)
        x, slope, curvature, error = velocities[k].T
        linear = x + np.outer(s, slope)
        spread = np.linalg.norm(0.5 * np.outer(s * s, curvature) + error, axis=1)
        assert (np.abs(np.linalg.norm(linear, axis=1) - speeds) <= spread + 1e-9).all()


@pytest.mark.parametrize("name", NAMES)
def test_in_an_instant_they_are_the_values(name: str) -> None:
    chain, arm, random = builtin_chain(name), PinocchioArm(name), np.random.default_rng(2)
    c = motion(chain, random)
    torques, velocities = bounds(chain, c, np.array([[0, 0.4, 0.0]]))
    q, v, a = states(c[0], np.array([0.4]))
    np.testing.assert_allclose(torques[0, :, 0], arm.torques_at(q, v, a)[0], atol=1e-9)
    frame = joint_frames(chain, q[0])[-1]
    ahead, behind = (
        joint_frames(chain, states(c[0], np.array([t]))[0][0])[-1] @ chain.tip.T_joint_link
        for t in (0.4 + 1e-6, 0.4 - 1e-6)
    )
    velocity = frame[:3, :3].T @ (ahead[:3, 3] - behind[:3, 3]) / 2e-6
    np.testing.assert_allclose(velocities[0, :, 0], velocity, atol=1e-6)
    # Rounding of a few dozen operations.
    assert (torques[0, :, 3] < 1e-6).all()


@pytest.mark.parametrize("name", NAMES)
def test_slopes_are_those_of_differences(name: str) -> None:
    chain, arm = builtin_chain(name), PinocchioArm(name)
    c = motion(chain, np.random.default_rng(3))
    torques, _ = bounds(chain, c, np.array([[1, 0.2, 1e-3]]))
    step = 1e-4
    after, before = (
        arm.torques_at(*states(c[1], np.array([t])))[0] for t in (0.2 + step, 0.2 - step)
    )
    np.testing.assert_allclose(
        torques[0, :, 1], (after - before) / (2.0 * step), rtol=1e-4, atol=1e-3
    )


def test_curvature_is_bounded_and_not_by_much_more_than_there_is() -> None:
    chain, arm = builtin_chain("ur5e"), PinocchioArm("ur5e")
    c = motion(chain, np.random.default_rng(4))
    torques, _ = bounds(chain, c, np.array([[0, 0.3, 1e-4]]))
    step = 1e-3
    values = [arm.torques_at(*states(c[0], np.array([0.3 + k * step])))[0] for k in (-1, 0, 1)]
    second = np.abs(values[0] - 2.0 * values[1] + values[2]) / step**2
    assert (torques[0, :, 2] >= second * (1.0 - 1e-3) - 1e-3).all()
    assert (torques[0, :, 2] <= 100.0 * (second.max() + 1.0)).all()


def test_halves_are_bounded_no_wider_than_the_whole() -> None:
    chain = builtin_chain("panda")
    c = motion(chain, np.random.default_rng(5))
    whole, half = np.array([[0, 0.3, 0.2]]), np.array([[0, 0.2, 0.1], [0, 0.4, 0.1]])
    wide, narrow = bounds(chain, c, whole), bounds(chain, c, half)
    for one, both in zip(wide, narrow, strict=True):
        assert (both[:, :, 2] <= one[:, :, 2] * (1.0 + 1e-9)).all()


def test_motors_and_friction_add_to_the_torques() -> None:
    """Rotor inertia times acceleration, and viscous friction times velocity, joint by joint."""
    chain, random = builtin_chain("ur5e"), np.random.default_rng(6)
    inertia, friction = random.uniform(0.1, 1.0, (2, chain.n))
    driven = bodies(chain)._replace(motor_inertia=inertia, viscous_friction=friction)
    c, interval = motion(chain, random), np.array([[0, 0.4, 1e-3]])
    bare, loaded = (bounds(chain, c, interval, robot)[0][0] for robot in (None, driven))
    _, v, a = states(c[0], np.array([0.4]))
    np.testing.assert_allclose(
        loaded[:, 0] - bare[:, 0], inertia * a[0] + friction * v[0], atol=1e-9
    )
    jerk = np.array([np.polynomial.Polynomial(row).deriv(3)(0.4) for row in c[0]])
    np.testing.assert_allclose(
        loaded[:, 1] - bare[:, 1], inertia * jerk + friction * a[0], atol=1e-9
    )
    assert (loaded[:, 2] >= bare[:, 2]).all()


def test_columns_are_where_they_are_read() -> None:
    assert (MIDDLE, HALF, JET) == (1, 2, 4)
