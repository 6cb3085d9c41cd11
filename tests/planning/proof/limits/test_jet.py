"""Jets: whatever function they stand for, the results stand for the results of the functions."""

from collections.abc import Callable
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kinematics.arrays import Array
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
