"""Bounds of torque and tool speed: above every sample, and hardly above the largest."""

import numpy as np
import pinocchio
import pytest

from dynamics.enclosure import bounds_kernel, tool_speed_use, torque_use
from dynamics.inverse import inverse_dynamics
from dynamics.model.body import bodies
from dynamics.model.payload import with_payload
from kinematics.jacobian import geometric
from kinematics.model.chain import Chain
from kinematics.robots import builtin_names, builtin_urdf
from kinematics.trajectory.trajectory import Trajectory
from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf


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


def test_radii_shrink_with_the_square_of_the_cell() -> None:
    chain = chain_of("panda")
    motion = random_motion(chain, np.random.default_rng(2), 1)
    radii = []
    for half in (1e-2, 5e-3):
        cells = np.array([[0.0, 0.5 * motion.duration, half]])
        torques, speeds = np.empty((1, chain.n, 3)), np.empty((1, 3))
        bounds_kernel(
            bodies(chain), np.zeros(3), motion.breaks, motion.coefficients, cells, torques, speeds
        )
        radii.append(torques[0, :, 2])
    assert (radii[1] < 0.3 * radii[0]).all()


def test_a_payload_counts() -> None:
    chain = chain_of("iiwa14")
    motion = random_motion(chain, np.random.default_rng(3))
    loaded = with_payload(chain, 5.0, (0.0, 0.0, 0.1))
    limits = np.full(7, 100.0)
    times = np.linspace(0.0, motion.duration, 2001)
    torques = inverse_dynamics(loaded, *(motion.sample(times, order) for order in range(3)))
    use = torque_use(loaded, motion, limits)
    assert use.ratio == pytest.approx(np.abs(torques / limits).max(), rel=3e-3)
    assert use.ratio > torque_use(chain, motion, limits).ratio
