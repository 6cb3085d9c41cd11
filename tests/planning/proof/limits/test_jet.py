"""Jets, and torques and tip velocities enclosed by them."""

from collections.abc import Callable
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynamics.model.body import Bodies, bodies
from kinematics.arrays import Array
from kinematics.forward import joint_frames
from kinematics.model.chain import Chain
from kinematics.robots import builtin_chain
from planning.proof.limits.effort_bounds import HALF, JET, MIDDLE, effort_bounds_kernel
from planning.proof.limits.jet import (
    Jet,
    JetVector,
    add,
    constant_vector,
    cross,
    cross_constant,
    multiply,
    plus,
    scale,
    sine_cosine,
    size,
    weighted_sum,
)
from tests.planning.pinocchio_arm import PinocchioArm

#: A function of time with its jet: |x''| <= X everywhere.
Known = tuple[Jet, Callable[[Array], Array]]

numbers = st.floats(-3.0, 3.0).map(lambda x: round(x, 3))
halves = st.sampled_from([1e-6, 1e-3, 0.1, 0.7, 2.0])


@st.composite
def functions(draw: st.DrawFn) -> Known:
    """A parabola or a wave of the largest curvature X: x_0 + x_1 s + X (1 - cos w s) / w^2."""
    x0, x1, curvature = draw(numbers), draw(numbers), abs(draw(numbers))
    w, sign = draw(st.sampled_from([0.0, 0.5, 3.0])), draw(st.sampled_from([1.0, -1.0]))

    def value(s: Array) -> Array:
        rest = 0.5 * s * s if w == 0.0 else (1.0 - np.cos(w * s)) / w**2
        return np.asarray(x0 + x1 * s + sign * curvature * rest)

    return (x0, x1, curvature, 0.0), value


vectors = st.tuples(functions(), functions(), functions())


def times(h: float) -> Array:
    return np.linspace(-h, h, 41)


def assert_encloses(jet: Jet, values: Array, h: float) -> None:
    s = times(h)
    bound = 0.5 * jet[2] * s * s + jet[3] + 1e-13 * (1.0 + np.abs(values))
    assert (np.abs(values - jet[0] - jet[1] * s) <= bound).all()


def jets(v: tuple[Known, Known, Known]) -> JetVector:
    return v[0][0], v[1][0], v[2][0]


def sampled(v: tuple[Known, Known, Known], h: float) -> Array:
    return np.array([f(times(h)) for _, f in v])


@given(functions(), halves)
def test_the_size_is_not_exceeded_and_reached_by_a_parabola(x: Known, h: float) -> None:
    jet, f = x
    assert np.abs(f(times(h))).max() <= size(jet, h) + 1e-12
    reached = abs(jet[0]) + abs(jet[1]) * h + 0.5 * jet[2] * h * h
    assert size(jet, h) == pytest.approx(reached)


@given(functions(), functions(), halves)
def test_products_enclose_products(x: Known, y: Known, h: float) -> None:
    product = multiply(x[0], y[0], h)
    assert_encloses(product, x[1](times(h)) * y[1](times(h)), h)
    assert multiply(y[0], x[0], h)[:2] == pytest.approx(product[:2])
    assert multiply(y[0], x[0], h)[2] == pytest.approx(product[2])


@given(functions(), functions())
def test_at_an_instant_the_curvature_of_a_product_is_that_of_leibniz(x: Known, y: Known) -> None:
    """X |y_0| + 2 |x_1 y_1| + |x_0| Y: not more than it must be."""
    (a, da, dda, _), (b, db, ddb, _) = x[0], y[0]
    expected = dda * abs(b) + 2.0 * abs(da * db) + abs(a) * ddb
    assert multiply(x[0], y[0], 0.0)[2] == pytest.approx(expected)


@given(functions(), halves)
def test_sine_and_cosine_enclose_theirs(x: Known, h: float) -> None:
    sine, cosine = sine_cosine(x[0], h)
    assert_encloses(sine, np.sin(x[1](times(h))), h)
    assert_encloses(cosine, np.cos(x[1](times(h))), h)
    # sin x and cos x turn by x': their curvature is that of x and the square of its rate.
    assert sine[2] == cosine[2] == pytest.approx(x[0][2] + (abs(x[0][1]) + x[0][2] * h) ** 2)


@given(functions(), functions(), numbers, halves)
def test_sums_and_multiples_enclose_theirs(x: Known, y: Known, k: float, h: float) -> None:
    s = times(h)
    assert_encloses(add(x[0], y[0]), x[1](s) + y[1](s), h)
    assert_encloses(scale(k, x[0]), k * x[1](s), h)
    assert scale(k, x[0])[2] >= 0.0
    assert add(x[0], scale(-1.0, x[0]))[:2] == (0.0, 0.0)


@given(vectors, vectors, halves)
def test_vector_products_enclose_theirs(
    u: tuple[Known, Known, Known], v: tuple[Known, Known, Known], h: float
) -> None:
    expected = np.cross(sampled(u, h), sampled(v, h), axis=0)
    for jet, values in zip(cross(jets(u), jets(v), h), expected, strict=True):
        assert_encloses(jet, values, h)
    for jet, values in zip(plus(jets(u), jets(v)), sampled(u, h) + sampled(v, h), strict=True):
        assert_encloses(jet, values, h)


@given(vectors, numbers, numbers, numbers, halves)
def test_products_with_constant_vectors_enclose_theirs(
    v: tuple[Known, Known, Known], a: float, b: float, c: float, h: float
) -> None:
    k, values = np.array([a, b, c]), sampled(v, h)
    assert_encloses(weighted_sum(a, b, c, jets(v)), k @ values, h)
    expected = np.cross(values, k[:, None], axis=0)
    for jet, row in zip(cross_constant(jets(v), a, b, c), expected, strict=True):
        assert_encloses(jet, row, h)
    # As with the vector that does not change.
    general = cross(jets(v), constant_vector(a, b, c), h)
    for special, jet in zip(cross_constant(jets(v), a, b, c), general, strict=True):
        assert special[:3] == pytest.approx(jet[:3], abs=1e-12)


def test_a_constant_does_not_move() -> None:
    for jet, value in zip(constant_vector(1.0, -2.0, 0.0), (1.0, -2.0, 0.0), strict=True):
        assert jet == (value, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("magnitude", [1e-8, 1.0, 1e8])
def test_rounding_is_within_the_error_told(magnitude: float) -> None:
    """Of sums of a dozen products, against rational numbers."""
    random = np.random.default_rng(1)
    for _ in range(200):
        total: Jet = (0.0, 0.0, 0.0, 0.0)
        exact = Fraction(0)
        for a, b in random.normal(size=(12, 2)) * magnitude:
            total = add(total, multiply((a, 0.0, 0.0, 0.0), (b, 0.0, 0.0, 0.0), 0.0))
            exact += Fraction(float(a)) * Fraction(float(b))
        assert abs(Fraction(total[0]) - exact) <= Fraction(total[3])
        assert total[3] <= 1e-13 * 12 * 25 * magnitude**2


@given(functions(), functions(), halves)
def test_errors_of_factors_are_errors_of_the_product(x: Known, y: Known, h: float) -> None:
    """Any function within e of x, and within f of y: their product is enclosed."""
    e, f = 1e-3, 2e-3
    product = multiply((*x[0][:3], e), (*y[0][:3], f), h)
    for left in (-e, e):
        for right in (-f, f):
            values = (x[1](times(h)) + left) * (y[1](times(h)) + right)
            assert_encloses(product, values, h)
    sine, _ = sine_cosine((*x[0][:3], e), h)
    assert_encloses(sine, np.sin(x[1](times(h)) + e), h)


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
