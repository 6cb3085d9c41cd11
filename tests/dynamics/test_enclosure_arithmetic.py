"""Arithmetic of enclosures: whatever is inside the arguments is inside the result."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynamics.enclosure import (
    Enclosure,
    Vector,
    add,
    bounds_kernel,
    cross,
    cross_constant,
    motion_kernel,
    multiply,
    scale,
    sine_cosine,
    to_joint,
    to_parent,
    tool_speed_use,
    torque_use,
)
from dynamics.inverse import inverse_dynamics
from dynamics.model.body import bodies
from kinematics.arrays import Array
from kinematics.errors import MissingInertia
from kinematics.forward import forward
from kinematics.jacobian import geometric
from kinematics.pose import rotation_z
from kinematics.trajectory.trajectory import Trajectory, stay
from tests.dynamics.samples import cart_pendulum, planar_rr, random_chain
from tests.properties import numbers, rotations

ENCLOSURES = st.tuples(st.floats(-3.0, 3.0), st.floats(-2.0, 2.0), st.floats(0.0, 1.5))
VECTORS = st.tuples(ENCLOSURES, ENCLOSURES, ENCLOSURES)
#: Places in a cell, from its beginning to its end.
PLACES = np.linspace(-1.0, 1.0, 9)


def members(x: Enclosure, seed: int) -> Array:
    """A function inside an enclosure at all places: its line, and anything within the radius."""
    noise = np.random.default_rng(seed).uniform(-1.0, 1.0, len(PLACES))
    noise[::4] = np.sign(noise[::4])
    return np.asarray(x[0] + x[1] * PLACES + x[2] * noise)


def holds(x: Enclosure, values: Array) -> bool:
    """Whether an enclosure contains values at all places, but for rounding."""
    room = x[2] + 1e-12 * (1.0 + abs(x[0]) + abs(x[1]) + x[2])
    return bool((np.abs(values - x[0] - x[1] * PLACES) <= room).all())


@settings(max_examples=25)
@given(ENCLOSURES, ENCLOSURES, st.floats(-3.0, 3.0), st.integers(0, 99))
def test_sums_multiples_and_products_contain_those_of_their_members(
    x: Enclosure, y: Enclosure, k: float, seed: int
) -> None:
    u, v = members(x, seed), members(y, seed + 100)
    assert holds(add(x, y), u + v)
    assert holds(scale(k, x), k * u)
    assert holds(multiply(x, y), u * v)


@given(ENCLOSURES, st.integers(0, 99))
def test_sines_and_cosines_contain_those_of_their_members(x: Enclosure, seed: int) -> None:
    u = members(x, seed)
    s, c = sine_cosine(x)
    assert holds(s, np.sin(u))
    assert holds(c, np.cos(u))


@settings(max_examples=25)
@given(VECTORS, VECTORS, numbers(3, 2.0), st.integers(0, 99))
def test_cross_products_contain_those_of_their_members(
    u: Vector, v: Vector, w: Array, seed: int
) -> None:
    a = np.array([members(x, seed + i) for i, x in enumerate(u)])
    b = np.array([members(x, seed + 9 + i) for i, x in enumerate(v)])
    for k, expected in enumerate(np.cross(a.T, b.T).T):
        assert holds(cross(u, v)[k], expected)
    for k, expected in enumerate(np.cross(a.T, w).T):
        assert holds(cross_constant(u, float(w[0]), float(w[1]), float(w[2]))[k], expected)


@settings(max_examples=25)
@given(rotations, ENCLOSURES, VECTORS, st.integers(0, 99))
def test_vectors_in_other_frames_contain_those_of_their_members(
    R: Array, q: Enclosure, v: Vector, seed: int
) -> None:
    A = np.eye(4)
    A[:3, :3] = R
    angles = members(q, seed)
    values = np.array([members(x, seed + 1 + i) for i, x in enumerate(v)]).T
    s, c = sine_cosine(q)
    turns = np.array([R @ rotation_z(float(angle)) for angle in angles])
    behind = np.einsum("kji,kj->ki", turns, values)
    before = np.einsum("kij,kj->ki", turns, values)
    for k in range(3):
        assert holds(to_joint(A, s, c, v)[k], behind[:, k])
        assert holds(to_parent(A, s, c, v)[k], before[:, k])


@settings(max_examples=25)
@given(
    st.integers(1, 8).flatmap(lambda n: numbers(n, 3.0)), st.floats(0.0, 2.0), st.floats(1e-4, 1.0)
)
def test_position_velocity_and_acceleration_are_inside_over_the_whole_cell(
    c: Array, time: float, h: float
) -> None:
    enclosures = motion_kernel(c, np.empty(len(c)), time, h)
    p = np.polynomial.Polynomial(c)
    for order, x in enumerate(enclosures):
        derivative = p.deriv(order) if order else p
        values = np.asarray(derivative(time + h * PLACES), dtype=np.float64)
        scaled = (x[0], x[1], x[2] + 1e-10 * (1.0 + float(np.abs(c).sum()) * 3.0 ** len(c)))
        assert holds(scaled, values)


@pytest.mark.parametrize("size", [1, 2, 3, 4])
def test_motions_of_low_degree_are_enclosed_exactly(size: int) -> None:
    c = np.arange(1.0, size + 1.0)
    (q, qd, qdd) = motion_kernel(c, np.empty(size), 0.5, 0.1)
    # A line needs no radius; what is quadratic needs one for positions only.
    assert (q[2] == 0.0) == (size < 3)
    assert (qd[2] == 0.0) == (size < 4)
    assert qdd[2] == 0.0


def test_the_radius_of_a_parabola_is_its_sagitta() -> None:
    # 2 + 3 d + 4 d^2 about its middle, over half a length of 0.1.
    q, qd, qdd = motion_kernel(np.array([2.0, 3.0, 4.0]), np.empty(3), 0.0, 0.1)
    assert q == pytest.approx((2.0, 0.3, 0.04))
    assert qd == pytest.approx((3.0, 0.8, 0.0))
    assert qdd == pytest.approx((8.0, 0.0, 0.0))


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


def test_a_joint_without_limit_uses_none_of_it() -> None:
    arm = planar_rr()
    motion = stay(arm.joint_names, [0.4, -0.9], 1.0)
    assert torque_use(arm, motion, [np.inf, np.inf]).ratio == 0.0
    assert torque_use(arm, motion, [np.inf, 2.0]).joint == 1
    assert torque_use(arm, motion, [10.0, np.inf]).joint == 0


@pytest.mark.parametrize("factor", [0.1, 3.0])
def test_use_is_inverse_to_the_limit(factor: float) -> None:
    chain = random_chain(2, 3, motors=True)
    rng = np.random.default_rng(0)
    motion = Trajectory(chain.joint_names, np.array([0.0, 0.7]), rng.normal(size=(1, 3, 5)))
    limits = np.array([5.0, 20.0, 8.0])
    one, other = torque_use(chain, motion, limits), torque_use(chain, motion, factor * limits)
    assert other.ratio == pytest.approx(one.ratio / factor, rel=1e-9)
    assert (other.joint, other.time) == (one.joint, one.time)


@pytest.mark.parametrize("seed", range(4))
def test_the_bound_is_never_below_and_hardly_above_the_samples(seed: int) -> None:
    # Joints of both types, motors, friction and any gravity.
    chain = random_chain(seed, 4, motors=True)
    rng = np.random.default_rng(seed)
    motion = Trajectory(
        chain.joint_names, np.array([0.0, 0.4, 0.9]), rng.uniform(-1.0, 1.0, (2, 4, 6))
    )
    times = np.linspace(0.0, 0.9, 3001)
    q, qd, qdd = (motion.sample(times, order) for order in range(3))
    limits = rng.uniform(1.0, 50.0, 4)
    used = np.abs(inverse_dynamics(chain, q, qd, qdd)) / limits
    use = torque_use(chain, motion, limits)
    assert used.max() <= use.ratio * (1.0 + 1e-12)
    assert use.ratio <= 1.003 * used.max()
    assert use.reached <= used.max() * (1.0 + 1e-6) + 1e-9
    near = np.abs(times - use.time) < 0.02
    assert used[near, use.joint].max() > 0.95 * used.max()
    speed = np.linalg.norm(np.einsum("kij,kj->ki", geometric(chain, q)[:, :3], qd), axis=1).max()
    found = tool_speed_use(chain, motion, 0.5)
    assert 2.0 * speed <= found.ratio * (1.0 + 1e-12)
    assert found.ratio <= 1.003 * 2.0 * speed


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


def test_a_tool_on_the_base_has_no_speed() -> None:
    chain = replace(random_chain(1, 3), tip_link="base")
    motion = swing(chain.joint_names, 0, 5.0)
    assert tool_speed_use(chain, motion, 0.1) == (0.0, 0.0, 0, 0.0)
    assert forward(chain, motion.end).shape == (4, 4)


def test_a_robot_without_inertias_is_refused() -> None:
    arm = planar_rr()
    bare = replace(arm, links=tuple(replace(link, inertia=None) for link in arm.links))
    with pytest.raises(MissingInertia):
        torque_use(bare, stay(arm.joint_names, [0.0, 0.0], 1.0), [1.0, 1.0])
