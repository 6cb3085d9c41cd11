"""Bounds of torque and tool speed: above every sample, hardly above the largest."""

from dataclasses import replace

import numpy as np
import pinocchio
import pytest

from dynamics.enclosure import bounds_kernel, tool_speed_use, torque_use
from dynamics.inverse import inverse_dynamics
from dynamics.model.body import bodies
from kinematics.errors import MissingInertia
from kinematics.jacobian import geometric
from kinematics.model.chain import Chain
from kinematics.robots import builtin_names, builtin_urdf
from kinematics.trajectory.trajectory import Trajectory, stay
from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from tests.dynamics.samples import cart_pendulum, planar_rr, random_chain


def chain_of(name: str) -> Chain:
    return serial_chain(parse_urdf(builtin_urdf(name)))


def random_motion(chain: Chain, rng: np.random.Generator, pieces: int = 5) -> Trajectory:
    """Quintic pieces that need not meet: bounds are of each."""
    breaks = np.concatenate([[0.0], np.cumsum(rng.uniform(0.05, 0.6, pieces))])
    coefficients = rng.uniform(-1.0, 1.0, (pieces, chain.n, 6)) * [1.0, 1.0, 1.0, 1.0, 2.0, 2.0]
    return Trajectory(chain.joint_names, breaks, coefficients)


@pytest.mark.parametrize("name", builtin_names())
def test_bounds_hold_at_every_sample_and_are_sharp(name: str) -> None:
    chain = chain_of(name)
    rng = np.random.default_rng(0)
    for _ in range(4):
        motion = random_motion(chain, rng)
        times = np.linspace(0.0, motion.duration, 4001)
        q, qd, qdd = (motion.sample(times, order) for order in range(3))
        torques = inverse_dynamics(chain, q, qd, qdd)
        limits = rng.uniform(1.0, 100.0, chain.n)
        use = torque_use(chain, motion, limits)
        sampled = float(np.abs(torques / limits).max())
        assert sampled <= use.ratio * (1.0 + 1e-12)
        assert use.ratio <= 1.003 * sampled
        assert use.reached <= use.ratio
        velocity = np.einsum("kij,kj->ki", geometric(chain, q)[:, :3], qd)
        speed = float(np.linalg.norm(velocity, axis=1).max())
        bound = tool_speed_use(chain, motion, 2.0)
        assert speed / 2.0 <= bound.ratio * (1.0 + 1e-12)
        assert bound.ratio <= 1.003 * speed / 2.0


def test_cells_enclose_what_pinocchio_computes() -> None:
    model = pinocchio.buildModelFromXML(builtin_urdf("ur5e"))
    data = model.createData()
    chain = chain_of("ur5e")
    rng = np.random.default_rng(1)
    motion = random_motion(chain, rng, 1)
    middle = 0.5 * motion.duration
    for share in (1.0, 0.1, 0.01):
        half = share * middle
        cells = np.array([[0.0, middle, half]])
        torques, speeds = np.empty((1, chain.n, 3)), np.empty((1, 3))
        bounds_kernel(
            bodies(chain), np.zeros(3), motion.breaks, motion.coefficients, cells, torques, speeds
        )
        for d in np.linspace(-1.0, 1.0, 41):
            q, qd, qdd = (motion.sample([middle + d * half], order)[0] for order in range(3))
            tau = pinocchio.rnea(model, data, q, qd, qdd)
            center = torques[0, :, 0] + torques[0, :, 1] * d
            assert (np.abs(tau - center) <= torques[0, :, 2] + 1e-9).all()


@pytest.mark.parametrize("seed", range(6))
def test_narrow_cells_are_the_torques_and_speeds_of_their_middle(seed: int) -> None:
    # Joints of both types in any order: a term that is missing would show in some joint.
    chain = random_chain(seed, 5, motors=True)
    rng = np.random.default_rng(seed)
    motion = Trajectory(chain.joint_names, np.array([0.0, 1.0]), rng.uniform(-2, 2, (1, 5, 5)))
    middles = np.linspace(0.1, 0.9, 7)
    cells = np.column_stack([np.zeros(7), middles, np.full(7, 1e-6)])
    torques, speeds = np.empty((7, 5, 3)), np.empty((7, 3))
    tip = np.array(chain.tip.T_joint_link[:3, 3])
    bounds_kernel(
        bodies(chain), tip, motion.breaks, motion.coefficients, cells, torques, speeds
    )  # fmt: skip
    q, qd, qdd = (motion.sample(middles, order) for order in range(3))
    expected = inverse_dynamics(chain, q, qd, qdd)
    np.testing.assert_allclose(torques[..., 0], expected, rtol=1e-7, atol=1e-7)
    assert torques[..., 2].max() < 1e-4
    velocities = np.einsum("kij,kj->ki", geometric(chain, q)[:, :3], qd)
    np.testing.assert_allclose(speeds[:, 0], (velocities**2).sum(axis=1), rtol=1e-7, atol=1e-7)


# ------------------------------------------------------------------------------- the largest use


def swing(chain_joints: tuple[str, ...], joint: int, peak: float) -> Trajectory:
    """One joint moves as t - t^2 / 2 scaled; its speed is largest at the beginning."""
    coefficients = np.zeros((1, len(chain_joints), 3))
    coefficients[0, joint, 1:] = peak, -0.5 * peak
    return Trajectory(chain_joints, np.array([0.0, 1.0]), coefficients)


def test_a_robot_that_stands_uses_the_torque_of_gravity() -> None:
    arm = planar_rr()
    q = np.array([0.4, -0.9])
    expected = np.abs(inverse_dynamics(arm, q, [0, 0], [0, 0])) / [10.0, 2.0]
    use = torque_use(arm, stay(arm.joint_names, q, 1.0), [10.0, 2.0])
    assert use.ratio == pytest.approx(expected.max(), rel=1e-9)
    assert use.reached == pytest.approx(expected.max(), rel=1e-9)
    assert use.joint == expected.argmax()


@pytest.mark.parametrize("factor", [0.1, 3.0])
def test_use_is_inverse_to_the_limit(factor: float) -> None:
    chain = random_chain(2, 3, motors=True)
    rng = np.random.default_rng(0)
    motion = Trajectory(chain.joint_names, np.array([0.0, 0.7]), rng.normal(size=(1, 3, 5)))
    limits = np.array([5.0, 20.0, 8.0])
    one, other = torque_use(chain, motion, limits), torque_use(chain, motion, factor * limits)
    assert other.ratio == pytest.approx(one.ratio / factor, rel=1e-9)
    assert (other.joint, other.time) == (one.joint, one.time)


def test_a_motion_beyond_the_most_cells_is_still_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    chain = random_chain(1, 3)
    rng = np.random.default_rng(1)
    motion = Trajectory(chain.joint_names, np.array([0.0, 2.0]), rng.normal(size=(1, 3, 6)))
    sharp = torque_use(chain, motion, np.full(3, 10.0))
    monkeypatch.setattr("dynamics.enclosure.MAX_CELLS", 4)
    rough = torque_use(chain, motion, np.full(3, 10.0))
    assert rough.ratio > 1.01 * sharp.ratio
    assert rough.reached <= sharp.ratio


def test_the_speed_of_a_tool_on_a_slide_is_that_of_the_slide() -> None:
    cart = replace(cart_pendulum(), tip_link="cart")
    use = tool_speed_use(cart, swing(cart.joint_names, 0, 0.8), 0.4)
    assert use.ratio == pytest.approx(2.0, rel=2e-3)
    assert use.time < 0.1
    # The pendulum turns behind the cart's own link.
    assert tool_speed_use(cart, swing(cart.joint_names, 1, 0.8), 0.4).ratio == 0.0


def test_a_robot_without_inertias_is_refused() -> None:
    arm = planar_rr()
    bare = replace(arm, links=tuple(replace(link, inertia=None) for link in arm.links))
    with pytest.raises(MissingInertia):
        torque_use(bare, stay(arm.joint_names, [0.0, 0.0], 1.0), [1.0, 1.0])
