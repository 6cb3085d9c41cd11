"""The recursions as kernels: linear where they must be, beside pinocchio, and without memory."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from dynamics.kernels.recursion import (
    WORK,
    gravity_kernel,
    inverse_kernel,
    reference_inverse_kernel,
)
from dynamics.model.body import bodies
from kinematics.arrays import Array
from kinematics.model.chain import Chain
from tests.dynamics.oracle import christoffel_function, relative_error
from tests.dynamics.samples import pinocchio_model, random_chain, random_state

SIZES = (1, 2, 4, 7)


def inverse(chain: Chain, q: Array, qd: Array, qdd: Array, scratch: float = np.nan) -> Array:
    """Torques by ``inverse_kernel``; its scratch begins with a value that must not matter."""
    torque = np.full(chain.n, scratch)
    work = np.full((chain.n, WORK), scratch)
    inverse_kernel(bodies(chain).rows, q, qd, qdd, work, torque)
    return torque


def gravity(chain: Chain, q: Array, scratch: float = 0.0) -> Array:
    """Gravity torques by ``gravity_kernel``."""
    G = np.full(chain.n, scratch)
    gravity_kernel(bodies(chain).rows, q, np.full((chain.n, WORK), scratch), G)
    return G


def reference(chain: Chain, q: Array, qd: Array, v: Array, a: Array) -> Array:
    """Torques by ``reference_inverse_kernel``."""
    torque = np.zeros(chain.n)
    motion = np.ascontiguousarray(np.stack([q, qd, v, a], axis=1))
    reference_inverse_kernel(bodies(chain).rows, motion, np.zeros((chain.n, WORK)), torque)
    return torque


def states(n: int, count: int = 6) -> tuple[Chain, list[tuple[Array, Array, Array]]]:
    """A chain with motors and random motions of it."""
    chain = random_chain(n, n, motors=True)
    return chain, list(zip(*random_state(chain, n, count), strict=True))


@pytest.mark.parametrize("n", SIZES)
def test_torques_are_pinocchios_with_motors_and_friction(n: int) -> None:
    chain, motions = states(n)
    model = pinocchio_model(chain)
    data = model.createData()
    for q, qd, qdd in motions:
        expected = pin.rnea(model, data, q, qd, qdd) + chain.viscous_friction * qd
        assert relative_error(inverse(chain, q, qd, qdd, 0.0), expected) < 1e-11
        held = pin.computeGeneralizedGravity(model, data, q)
        assert relative_error(gravity(chain, q), held) < 1e-11


@pytest.mark.parametrize("n", SIZES)
def test_what_scratch_held_before_does_not_matter(n: int) -> None:
    chain, motions = states(n, 2)
    for q, qd, qdd in motions:
        np.testing.assert_array_equal(
            inverse(chain, q, qd, qdd, 1e30), inverse(chain, q, qd, qdd, 0.0)
        )
        np.testing.assert_array_equal(gravity(chain, q, 1e30), gravity(chain, q, 0.0))


@pytest.mark.parametrize("n", SIZES)
def test_at_rest_only_gravity_and_inertia_are_left(n: int) -> None:
    chain, motions = states(n)
    rest = np.zeros(n)
    for q, _, _ in motions:
        G = inverse(chain, q, rest, rest, 0.0)
        np.testing.assert_allclose(G, gravity(chain, q), rtol=1e-11, atol=1e-11)
        M = np.array([inverse(chain, q, rest, e, 0.0) - G for e in np.eye(n)])
        np.testing.assert_allclose(M, M.T, rtol=1e-10, atol=1e-10)
        assert np.linalg.eigvalsh(M)[0] > 0.0


@pytest.mark.parametrize("n", SIZES)
def test_a_reference_that_is_the_motion_itself_gives_its_torques(n: int) -> None:
    chain, motions = states(n)
    for q, qd, qdd in motions:
        expected = inverse(chain, q, qd, qdd, 0.0)
        assert relative_error(reference(chain, q, qd, qd, qdd), expected) < 1e-12


@pytest.mark.parametrize("n", SIZES)
def test_reference_torques_are_linear_in_velocity_and_acceleration(n: int) -> None:
    chain, motions = states(n)
    rest = np.zeros(n)
    for q, qd, v in motions:
        w, a = v[::-1].copy(), qd[::-1].copy()
        still = reference(chain, q, qd, rest, rest)
        both = reference(chain, q, qd, 2.0 * v + 3.0 * w, 4.0 * a) - still
        parts = (
            2.0 * (reference(chain, q, qd, v, rest) - still)
            + 3.0 * (reference(chain, q, qd, w, rest) - still)
            + 4.0 * (reference(chain, q, qd, rest, a) - still)
        )
        assert relative_error(both, parts) < 1e-11


@pytest.mark.parametrize("n", [1, 2, 3])
def test_the_coriolis_matrix_in_it_is_that_of_the_christoffel_symbols(n: int) -> None:
    chain, motions = states(n, 3)
    # Two axes of rotation at an angle, so that no product of spins vanishes.
    chain = replace(chain, joint_types=np.zeros(n, dtype=np.int64))
    symbolic, rest = christoffel_function(chain), np.zeros(n)
    for q, qd, _ in motions:
        C = np.array(symbolic(q, qd)[2])
        still = reference(chain, q, qd, rest, rest)
        columns = [reference(chain, q, qd, e, rest) - still for e in np.eye(n)]
        np.testing.assert_allclose(np.array(columns).T, C, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("n", SIZES)
def test_the_power_of_the_torques_is_the_change_of_energy_and_what_friction_takes(n: int) -> None:
    chain, motions = states(n, 3)
    model = pinocchio_model(chain)
    data = model.createData()

    def energy(q: Array, qd: Array) -> float:
        motors = 0.5 * float(chain.motor_inertia @ qd**2)
        bare = model.copy()
        bare.armature = np.zeros(n)
        kinetic = pin.computeKineticEnergy(bare, bare.createData(), q, qd)
        return float(kinetic + motors + pin.computePotentialEnergy(model, data, q))

    step = 1e-5
    for q, qd, qdd in motions:
        power = float(inverse(chain, q, qd, qdd, 0.0) @ qd)
        later = energy(q + step * qd + 0.5 * step**2 * qdd, qd + step * qdd)
        before = energy(q - step * qd + 0.5 * step**2 * qdd, qd - step * qdd)
        gained = (later - before) / (2.0 * step)
        lost = float(chain.viscous_friction @ qd**2)
        assert power == pytest.approx(gained + lost, rel=1e-6, abs=1e-6 * (1.0 + abs(lost)))
