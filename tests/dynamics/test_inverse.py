"""Dynamics and their terms: pinocchio on all robots, closed forms, batches and CasADi."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any

import casadi
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import mutually_broadcastable_shapes
from scipy.integrate import solve_ivp

from dynamics.forward import forward_dynamics
from dynamics.inverse import inverse_dynamics
from dynamics.parameters.base_parameters import base_parameters
from dynamics.parameters.regressor import regressor, standard_parameters
from dynamics.symbolic import symbolic_inverse_dynamics
from dynamics.terms import (
    christoffel_symbols,
    coriolis_matrix,
    gravity_vector,
    kinetic_energy,
    mass_matrix,
    partial_jacobians,
    potential_energy,
)
from kinematics.arrays import Array
from kinematics.errors import InvalidOption, InvalidRobotState, MissingInertia
from kinematics.forward import forward, joint_frames, link_poses
from kinematics.jacobian import geometric, geometric_rate
from kinematics.model.chain import Chain, Inertia, stack_vectors
from kinematics.robots import builtin_chain, builtin_names, builtin_urdf
from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from kinematics.velocity import holding_torques, joint_velocities, link_twist
from tests.dynamics.samples import (
    cart_pendulum,
    pinocchio_model,
    planar_rr,
    random_chain,
    random_state,
    random_urdf,
    relative_error,
)


@pytest.mark.parametrize("seed", range(10))
def test_a_wrench_on_the_surroundings_is_minus_a_wrench_on_the_tip(seed: int) -> None:
    chain = random_chain(seed, 5)
    model = pinocchio_model(chain)
    data = model.createData()
    rng = np.random.default_rng(seed)
    for q, qd, qdd in zip(*random_state(chain, seed, 5), strict=True):
        f, n = rng.normal(size=(2, 3))
        T = pin.SE3(forward(chain, q))
        # At the tip, in base axes, then in the frame of the last joint as pinocchio wants it.
        at_tip = pin.SE3(T.rotation.T, np.zeros(3)).act(pin.Force(f, n))
        pin.forwardKinematics(model, data, q)
        at_joint = (data.oMi[chain.n].inverse() * T).act(at_tip)
        forces = pin.StdVec_Force([pin.Force.Zero() for _ in range(chain.n)] + [-at_joint])
        expected = pin.rnea(model, data, q, qd, qdd, forces)
        torque = inverse_dynamics(chain, q, qd, qdd, wrench=np.concatenate([f, n]))
        assert relative_error(torque, expected) < 1e-11


def test_faults_are_named() -> None:
    chain = random_chain(4)
    q = np.zeros((3, chain.n))
    with pytest.raises(InvalidRobotState, match="velocities has 2 value"):
        inverse_dynamics(chain, q, [1.0, 2.0], q)
    with pytest.raises(InvalidRobotState, match="accelerations is not finite at joint 'joint5'"):
        inverse_dynamics(chain, q[0], q[0], [0, 0, 0, 0, 0, np.nan])
    with pytest.raises(InvalidRobotState, match="batches do not fit"):
        inverse_dynamics(chain, q, q[:2], q)
    with pytest.raises(InvalidOption, match="six finite numbers"):
        inverse_dynamics(chain, q, q, q, wrench=[1.0, 2.0, 3.0])
    with pytest.raises(InvalidOption, match="does not fit joints"):
        inverse_dynamics(chain, q, q, q, wrench=np.zeros((2, 6)))


@pytest.mark.parametrize("seed", range(10))
def test_undoes_inverse_dynamics(seed: int) -> None:
    chain = random_chain(seed, 1 + seed % 9, motors=True)
    q, qd, qdd = random_state(chain, seed)
    F, g = np.random.default_rng(seed).normal(size=(len(q), 6)), [1.0, 2.0, -3.0]
    torque = inverse_dynamics(chain, q, qd, qdd, F, g)
    assert relative_error(forward_dynamics(chain, q, qd, torque, F, g), qdd) < 1e-10


def test_a_body_without_inertia_about_its_axis_is_named() -> None:
    arm = planar_rr()
    nothing = Inertia(0.0, np.zeros(3), np.zeros((3, 3)))
    links = tuple(
        replace(link, inertia=nothing) if link.name == "link1" else link for link in arm.links
    )
    massless = replace(arm, links=links)
    with pytest.raises(MissingInertia, match="'q2'"):
        forward_dynamics(massless, [0.1, 0.2], [0.0, 0.0], [0.0, 0.0])
    # A motor at that joint is enough.
    driven = replace(massless, motor_inertia=np.array([0.0, 0.1]))
    qdd = forward_dynamics(driven, [0.1, 0.2], [0.0, 0.0], [0.0, 0.5])
    assert qdd[1] == pytest.approx(5.0)


def test_gravity_can_be_replaced_and_is_linear() -> None:
    chain = random_chain(1)
    q = random_state(chain, 0)[0]
    G = gravity_vector(chain, q, [0.0, 0.0, -1.0])
    np.testing.assert_allclose(gravity_vector(chain, q, [0, 0, -3.0]), 3.0 * G, atol=1e-12)
    np.testing.assert_array_equal(potential_energy(chain, q, [0, 0, 0]), 0.0)
    assert potential_energy(chain, q[0]).shape == ()


@pytest.mark.parametrize("seed", range(3))
def test_christoffel_symbols_are_derivatives_of_the_mass_matrix(seed: int) -> None:
    chain = random_chain(seed, 4)
    q, qd, _ = random_state(chain, seed, 6)
    symbols = christoffel_symbols(chain, q)
    assert symbols.shape == (6, 4, 4, 4)
    np.testing.assert_allclose(symbols, np.swapaxes(symbols, 1, 2), atol=1e-12)
    C = np.einsum("mijk,mi->mkj", symbols, qd)
    np.testing.assert_allclose(C, coriolis_matrix(chain, q, qd), atol=1e-11)
    model, step = pinocchio_model(chain), 1e-6

    def mass(at: np.ndarray) -> np.ndarray:
        upper = np.triu(pin.crba(model, model.createData(), at))
        return np.asarray(upper + np.triu(upper, 1).T)

    for at, c in zip(q, symbols, strict=True):
        ends = [(mass(at + step * e), mass(at - step * e)) for e in np.eye(4)]
        # d[m, i, j] is the derivative of d_ij with respect to q_m.
        d = np.array([(after - before) / (2.0 * step) for after, before in ends])
        first, second = np.einsum("ikj->ijk", d), np.einsum("jki->ijk", d)
        np.testing.assert_allclose(c, 0.5 * (first + second - np.einsum("kij->ijk", d)), atol=1e-7)


def swing(chain: Chain, duration: float) -> tuple[Array, Array]:
    """Free motion from a random state: q and q_dot, both (m, n)."""
    n = chain.n
    zero = np.zeros(n)

    def rate(_: float, x: Array) -> Array:
        return np.concatenate([x[n:], forward_dynamics(chain, x[:n], x[n:], zero)])

    start = np.random.default_rng(0).uniform(-1, 1, 2 * n)
    solution = solve_ivp(rate, (0.0, duration), start, method="DOP853", rtol=1e-12, atol=1e-12)
    return solution.y[:n].T, solution.y[n:].T


@pytest.mark.parametrize("seed", range(5))
def test_energies_equal_pinocchios(seed: int) -> None:
    chain = random_chain(seed, motors=True)
    model = pinocchio_model(chain)
    data = model.createData()
    q, qd, _ = random_state(chain, seed)
    T = kinetic_energy(chain, q, qd)
    for k in range(len(q)):
        assert T[k] == pytest.approx(pin.computeKineticEnergy(model, data, q[k], qd[k]), rel=1e-12)
        U = pin.computePotentialEnergy(model, data, q[k])
        assert potential_energy(chain, q[k]) == pytest.approx(U, rel=1e-12)


@pytest.mark.parametrize(
    "chain",
    [planar_rr(), cart_pendulum(), random_chain(11, 4), builtin_chain("stanford")],
    ids=lambda chain: chain.name,
)
def test_is_conserved_in_free_motion_over_ten_seconds(chain: Chain) -> None:
    q, qd = swing(chain, 10.0)
    E = kinetic_energy(chain, q, qd) + potential_energy(chain, q)
    spread = np.ptp(kinetic_energy(chain, q, qd))
    assert spread > 0.1
    assert np.ptp(E) < 1e-6 * spread


@pytest.mark.parametrize("seed", range(8))
def test_equals_pinocchio_and_makes_the_mass_matrix(seed: int) -> None:
    chain = random_chain(seed, 2 + seed % 5)
    model = pinocchio_model(chain)
    data = model.createData()
    q = random_state(chain, seed, 4)[0]
    linear, angular = partial_jacobians(chain, q)
    assert linear.shape == angular.shape == (4, chain.n, 3, chain.n)
    for k, at in enumerate(q):
        pin.computeJointJacobians(model, data, at)
        D = np.zeros((chain.n, chain.n))
        for i in range(chain.n):
            J = pin.getJointJacobian(model, data, i + 1, pin.LOCAL_WORLD_ALIGNED)
            body, R = model.inertias[i + 1], data.oMi[i + 1].rotation
            at_center = J[:3] - pin.skew(R @ body.lever) @ J[3:]
            np.testing.assert_allclose(linear[k, i], at_center, atol=1e-12)
            np.testing.assert_allclose(angular[k, i], J[3:], atol=1e-12)
            D += body.mass * linear[k, i].T @ linear[k, i]
            D += angular[k, i].T @ R @ body.inertia @ R.T @ angular[k, i]
        M = pin.crba(model, data, at)
        np.testing.assert_allclose(np.triu(D), np.triu(M), atol=1e-11)


CHAIN = random_chain(3, 6, motors=True)
POINT = (0.1, 0.0, 0.2)
#: What is asked of a chain, a configuration and two more vectors of its joints.
CALLS: dict[str, Callable[[Chain, Array, Array, Array], Array]] = {
    "forward": lambda c, q, v, a: forward(c, q),
    "forward of a link": lambda c, q, v, a: forward(c, q, "link2"),
    "link poses": lambda c, q, v, a: link_poses(c, q),
    "joint frames": lambda c, q, v, a: joint_frames(c, q),
    "Jacobian": lambda c, q, v, a: geometric(c, q),
    "Jacobian of a point": lambda c, q, v, a: geometric(c, q, "link2", POINT),
    "rate": lambda c, q, v, a: geometric_rate(c, q, v),
    "twist": lambda c, q, v, a: link_twist(c, q, v, "link2", POINT),
    "joint velocities": lambda c, q, v, a: joint_velocities(c, q, v, nullspace=a).joint_velocities,
    "holding torques": lambda c, q, v, a: holding_torques(c, q, v),
    "inverse dynamics": inverse_dynamics,
    "forward dynamics": forward_dynamics,
    "mass matrix": lambda c, q, v, a: mass_matrix(c, q),
    "Coriolis matrix": lambda c, q, v, a: coriolis_matrix(c, q, v),
    "gravity": lambda c, q, v, a: gravity_vector(c, q),
    "regressor": regressor,
    "kinetic energy": lambda c, q, v, a: kinetic_energy(c, q, v),
    "potential energy": lambda c, q, v, a: potential_energy(c, q),
    "partial Jacobians": lambda c, q, v, a: partial_jacobians(c, q).linear,
}


@pytest.mark.parametrize("name", CALLS)
@pytest.mark.parametrize("lead", [(1,), (7,), (8,), (2, 3), (19,)])
def test_a_batch_is_what_each_of_it_is_alone(name: str, lead: tuple[int, ...]) -> None:
    call, rng = CALLS[name], np.random.default_rng(4)
    q, v, a = rng.uniform(-2.0, 2.0, (3, *lead, CHAIN.n))
    many = call(CHAIN, q, v, a)
    for at in np.ndindex(*lead):
        np.testing.assert_allclose(many[at], call(CHAIN, q[at], v[at], a[at]), atol=1e-9)
    assert call(CHAIN, q[:0], v[:0], a[:0]).shape == (0, *many.shape[1:])
    first = q[(0,) * len(lead)]
    same = call(CHAIN, first, v, a)
    for at in np.ndindex(*lead):
        # What depends on the configuration alone is one answer.
        one = same[at] if same.shape == many.shape else same
        np.testing.assert_allclose(one, call(CHAIN, first, v[at], a[at]), atol=1e-9)


BATCH_CHAIN = random_chain(3, 3)
NAMES = ("joints", "velocities", "accelerations")


@given(
    mutually_broadcastable_shapes(num_shapes=3, max_dims=3, min_side=0, max_side=3),
    st.integers(0, 2**31),
)
def test_vectors_stack_as_numpy_broadcasts_them(shapes: tuple[object, ...], seed: int) -> None:
    rng = np.random.default_rng(seed)
    inputs = shapes.input_shapes  # type: ignore[attr-defined]
    vectors = {name: rng.normal(size=(*lead, 3)) for name, lead in zip(NAMES, inputs, strict=True)}
    stack, lead = stack_vectors(BATCH_CHAIN, **vectors)
    assert lead == shapes.result_shape  # type: ignore[attr-defined]
    expected = np.stack(np.broadcast_arrays(*vectors.values()), axis=-2)
    np.testing.assert_array_equal(stack, expected.reshape(-1, 3, 3))
    assert stack.flags.c_contiguous


def test_batches_that_do_not_fit_are_named_with_their_shapes() -> None:
    with pytest.raises(InvalidRobotState, match="batches do not fit") as caught:
        stack_vectors(BATCH_CHAIN, joints=np.zeros((4, 3)), velocities=np.zeros((2, 3)))
    assert "joints (4, 3), velocities (2, 3)" in caught.value.message
    with pytest.raises(InvalidRobotState, match="do not fit"):
        stack_vectors(BATCH_CHAIN, a=np.zeros((2, 4, 3)), b=np.zeros((4, 2, 3)))


CHAINS = [planar_rr(), cart_pendulum(), random_chain(2, 3, motors=True), random_chain(5, 4)]
CHAINS += [builtin_chain(name) for name in ("panda", "puma560", "stanford", "scara")]


def test_serves_an_optimiser() -> None:
    chain, g = planar_rr(), [1.0, -3.0, 0.0]
    q = casadi.MX.sym("q", 2)
    torque = symbolic_inverse_dynamics(chain, q, casadi.DM.zeros(2), casadi.DM.zeros(2), g)
    stiffness = casadi.Function("stiffness", [q], [casadi.jacobian(torque, q)])
    at, step = np.array([0.3, -0.8]), 1e-6
    for j in range(2):
        e = step * np.eye(2)[j]
        slope = (gravity_vector(chain, at + e, g) - gravity_vector(chain, at - e, g)) / (2 * step)
        np.testing.assert_allclose(np.array(stiffness(at))[:, j], slope, atol=1e-8)


def test_faults_are_named_of_symbolic() -> None:
    with pytest.raises(InvalidRobotState, match="3 symbolic"):
        symbolic_inverse_dynamics(planar_rr(), *(casadi.SX.sym(x, 3) for x in "qva"))


STATES = 1000
TOLERANCE = 1e-9


def far(value: Array, reference: Array) -> float:
    """Largest relative error over all states; each against the largest entry of its reference.

    Where a reference is rounding error itself (gravity of a level arm), against a thousandth of
    the largest of all states.
    """
    flat = np.abs(reference).reshape(len(reference), -1).max(axis=1)
    scale = np.maximum(flat, max(1e-3 * float(flat.max()), 1e-9))
    off = np.abs(value - reference).reshape(len(reference), -1).max(axis=1)
    return float((off / scale).max())


class Oracle:
    """The same robot in pinocchio, on a batch of states, its moving joints in our order."""

    def __init__(self, urdf: str, chain: Chain, locked: Mapping[str, float] | None = None) -> None:
        model = pin.buildModelFromXML(urdf)
        if locked:
            q = pin.neutral(model)
            for name, position in locked.items():
                q[model.joints[model.getJointId(name)].idx_q] = position
            model = pin.buildReducedModel(model, [model.getJointId(name) for name in locked], q)
        model.gravity.linear = np.array(chain.gravity)
        model.armature = np.array(chain.motor_inertia)
        assert tuple(model.names)[1:] == chain.joint_names
        self.model, self.chain, self.turned = model, chain, pinocchio_model(chain)
        # Continuous joints have two coordinates there, (cos q, sin q).
        self.wide = [joint.nq == 2 for joint in list(model.joints)[1:]]

    def at(self, q: Array) -> Array:
        parts = [(np.cos(x), np.sin(x)) if w else (x,) for x, w in zip(q, self.wide, strict=True)]
        return np.concatenate(parts)

    def values(self, q: Array, qd: Array, qdd: Array) -> dict[str, Array]:
        data, turned = self.model.createData(), self.turned.createData()
        rows: dict[str, list[Any]] = {name: [] for name in ("D", "C", "G", "tau", "Y")}
        for k in range(len(q)):
            p = self.at(q[k])
            upper = np.triu(pin.crba(self.model, data, p)) - np.diag(self.chain.motor_inertia)
            rows["D"].append(upper + np.triu(upper, 1).T)
            C = pin.computeCoriolisMatrix(self.model, data, p, qd[k])
            rows["C"].append(C.copy())
            rows["G"].append(pin.computeGeneralizedGravity(self.model, data, p).copy())
            tau = pin.rnea(self.model, data, p, qd[k], qdd[k])
            rows["tau"].append(tau + self.chain.viscous_friction * qd[k])
            # Parameters belong to frames, and ours have the joint's axis for z: so must its.
            Y = pin.computeJointTorqueRegressor(self.turned, turned, q[k], qd[k], qdd[k])
            rows["Y"].append(Y.copy())
        return {name: np.array(row) for name, row in rows.items()}


def robots() -> list[tuple[str, str]]:
    uploaded = [(f"upload{seed}", random_urdf(seed)) for seed in range(6)]
    return [(name, builtin_urdf(name)) for name in builtin_names()] + uploaded


@pytest.mark.parametrize(("name", "urdf"), robots(), ids=[name for name, _ in robots()])
def test_equals_pinocchio(name: str, urdf: str) -> None:
    chain = builtin_chain(name) if name in builtin_names() else serial_chain(parse_urdf(urdf))
    q, qd, qdd = random_state(chain, 0, STATES)
    expected = Oracle(urdf, chain).values(q, qd, qdd)
    C = coriolis_matrix(chain, q, qd)
    Y = regressor(chain, q, qd, qdd, motors=False)
    torques = inverse_dynamics(chain, q, qd, qdd)
    assert far(mass_matrix(chain, q), expected["D"]) < TOLERANCE
    assert far(C, expected["C"]) < TOLERANCE
    Cqd = np.einsum("kij,kj->ki", C, qd)
    assert far(Cqd, np.einsum("kij,kj->ki", expected["C"], qd)) < TOLERANCE
    assert far(gravity_vector(chain, q), expected["G"]) < TOLERANCE
    assert far(torques, expected["tau"]) < TOLERANCE
    assert far(Y, expected["Y"]) < TOLERANCE
    assert far(forward_dynamics(chain, q, qd, expected["tau"]), qdd) < TOLERANCE
    whole = regressor(chain, q, qd, qdd)
    assert far(whole @ standard_parameters(chain), expected["tau"]) < TOLERANCE
    base = base_parameters(chain, motors=True)
    assert far(base.regressor(whole) @ base.values, expected["tau"]) < TOLERANCE


@pytest.mark.parametrize("seed", range(4))
def test_locked_joints_are_merged_with_their_inertias(seed: int) -> None:
    urdf, whole = random_urdf(seed, branch=True), {"side": 0.7, "slide": -1.3}
    tip = f"plate{2 + seed % 5}"
    chain = serial_chain(parse_urdf(urdf), tip_link=tip, held=whole)
    q, qd, qdd = random_state(chain, 0, 50)
    expected = Oracle(urdf, chain, whole).values(q, qd, qdd)
    assert far(mass_matrix(chain, q), expected["D"]) < TOLERANCE
    assert far(inverse_dynamics(chain, q, qd, qdd), expected["tau"]) < TOLERANCE
    # The whole arm beyond a tip in its middle is held still too.
    short = serial_chain(parse_urdf(urdf), tip_link="plate1", held={**whole, **after(urdf)})
    q, qd, qdd = random_state(short, 1, 50)
    expected = Oracle(urdf, short, {**whole, **after(urdf)}).values(q, qd, qdd)
    assert far(inverse_dynamics(short, q, qd, qdd), expected["tau"]) < TOLERANCE


def after(urdf: str) -> dict[str, float]:
    """Positions of the joints beyond the second."""
    names = [name for name in parse_urdf(urdf).joints if name.startswith("joint")]
    return {name: 0.1 * i for i, name in enumerate(names) if i >= 2}


@pytest.mark.parametrize("name", builtin_names())
def test_the_rate_of_d_less_twice_c_is_skew(name: str) -> None:
    chain = builtin_chain(name)
    q, qd, _ = random_state(chain, 1, STATES)
    C = coriolis_matrix(chain, q, qd)
    # The rate of D by Richardson's extrapolation of central differences along q_dot.
    step = 1e-3
    slopes = [
        (mass_matrix(chain, q + h * qd) - mass_matrix(chain, q - h * qd)) / (2.0 * h)
        for h in (step, 0.5 * step, 0.25 * step)
    ]
    first = [(4.0 * b - a) / 3.0 for a, b in pairwise(slopes)]
    D_rate = (16.0 * first[1] - first[0]) / 15.0
    N = D_rate - 2.0 * C
    assert np.abs(N + N.swapaxes(1, 2)).max() < 1e-9 * max(1.0, np.abs(D_rate).max())
    # Its exact part: q_dot^T (D_rate - 2 C) q_dot vanishes, and C comes from the same D.
    power = np.einsum("ki,kij,kj->k", qd, N, qd)
    assert np.abs(power).max() < 1e-8 * max(1.0, np.abs(D_rate).max())
