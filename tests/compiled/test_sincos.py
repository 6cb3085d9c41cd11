"""Cosines and sines in SIMD lanes beside extended precision, for angles of every size."""

import numpy as np
import pytest

from compiled.kernel import kernel
from compiled.simd import on_stack
from compiled.sincos import TURNS, few_turns_kernel, turn_at_kernel, turns_kernel
from kinematics.arrays import Array

#: Up to here the arithmetic is the module's own; beyond it is that of the library.
OWN = 1e6


@kernel
def turn_each_kernel(q: Array, cosines: Array, sines: Array) -> bool:
    """Cosine and sine of each angle by what a chain's kernels call."""
    turns = on_stack(TURNS)
    few = few_turns_kernel(q, turns)
    for j in range(q.shape[0]):
        cosines[j], sines[j] = turn_at_kernel(q, j, few, turns)
    return few


def together(q: Array) -> tuple[Array, Array]:
    """Cosines and sines of an array at once."""
    c, s = np.full((2, len(q)), np.nan)
    turns_kernel(q, c, s)
    return c, s


def each(q: Array) -> tuple[bool, Array, Array]:
    """Whether the angles went into one vector; their cosines and sines, one by one."""
    c, s = np.full((2, len(q)), np.nan)
    return turn_each_kernel(q, c, s), c, s


def hard_angles() -> Array:
    """Angles at, and within rounding of, multiples of 45 degrees; tiny and large ones."""
    multiples = np.arange(-4000, 4001) * (np.pi / 4)
    beside = [np.nextafter(multiples, sign * np.inf) for sign in (-1.0, 1.0)]
    far = np.random.default_rng(0).uniform(-OWN, OWN, 4000)
    tiny = np.geomspace(1e-320, 1.0, 400)
    return np.concatenate([multiples, *beside, far, tiny, -tiny, [0.0, -0.0]])


def test_the_error_is_a_rounding_for_all_angles_in_range() -> None:
    q = hard_angles()
    c, s = together(q)
    exact = q.astype(np.longdouble)
    assert float(np.abs(c - np.cos(exact)).max()) < 2.3e-16
    assert float(np.abs(s - np.sin(exact)).max()) < 2.3e-16


def test_small_sines_keep_all_their_digits() -> None:
    q = np.geomspace(1e-300, 0.7, 500)
    _, s = together(q)
    exact = np.sin(q.astype(np.longdouble))
    assert float(np.abs((s - exact) / exact).max()) < 2.3e-16


def test_cosine_and_sine_lie_on_the_unit_circle() -> None:
    c, s = together(hard_angles())
    assert np.abs(c * c + s * s - 1.0).max() < 5e-16
    assert np.abs(c).max() <= 1.0
    assert np.abs(s).max() <= 1.0


def test_cosines_are_even_and_sines_odd() -> None:
    q = np.random.default_rng(1).uniform(0.0, 50.0, 2001)
    (c, s), (c_back, s_back) = together(q), together(-q)
    np.testing.assert_array_equal(c, c_back)
    np.testing.assert_array_equal(s, -s_back)


@pytest.mark.parametrize("size", [OWN, 1.0000001 * OWN, 1e9, 1e15, 1e300])
def test_large_angles_are_those_of_the_library(size: float) -> None:
    q = size * np.array([1.0, -1.0, 1.5, -3.0, 7.7, 1.0, 2.0, -2.0, 1.25, 9.0, -1.0])
    c, s = together(q)
    np.testing.assert_allclose(c, np.cos(q), rtol=0.0, atol=3e-16)
    np.testing.assert_allclose(s, np.sin(q), rtol=0.0, atol=3e-16)


@pytest.mark.parametrize("place", range(0, 20, 3))
def test_one_large_angle_leaves_its_neighbours_as_they_are(place: int) -> None:
    q = np.random.default_rng(2).uniform(-4.0, 4.0, 20)
    alone = together(q)
    q[place] = 1e12
    c, s = together(q)
    others = np.arange(20) != place
    np.testing.assert_array_equal(c[others], alone[0][others])
    np.testing.assert_array_equal(s[others], alone[1][others])
    assert (c[place], s[place]) == pytest.approx((np.cos(1e12), np.sin(1e12)), abs=3e-16)


@pytest.mark.parametrize("count", [0, 1, 2, 7, 8, 9, 15, 16, 17, 64])
def test_any_number_of_angles_is_answered_as_each_alone(count: int) -> None:
    q = np.random.default_rng(count).uniform(-9.0, 9.0, count)
    c, s = together(q)
    for i in range(count):
        alone = together(q[i : i + 1])
        assert (c[i], s[i]) == pytest.approx((alone[0][0], alone[1][0]), abs=2e-16)


@pytest.mark.parametrize("count", [1, 2, 7, 8])
def test_few_angles_side_by_side_go_into_one_vector(count: int) -> None:
    q = np.random.default_rng(count).uniform(-9.0, 9.0, count)
    few, c, s = each(q)
    assert few
    np.testing.assert_allclose(c, np.cos(q), rtol=0.0, atol=2.3e-16)
    np.testing.assert_allclose(s, np.sin(q), rtol=0.0, atol=2.3e-16)


@pytest.mark.parametrize(
    "q",
    [
        np.linspace(-3.0, 3.0, 9),
        np.linspace(-3.0, 3.0, 14)[::2],
        np.linspace(-3.0, 3.0, 7)[::-1],
        np.array([0.5, OWN, 0.25]),
        np.array([0.5, -1e12]),
    ],
    ids=["nine", "apart", "backwards", "at the bound", "large"],
)
def test_other_angles_are_answered_one_by_one(q: Array) -> None:
    few, c, s = each(q)
    assert not few
    np.testing.assert_allclose(c, np.cos(q), rtol=0.0, atol=3e-16)
    np.testing.assert_allclose(s, np.sin(q), rtol=0.0, atol=3e-16)


def test_what_is_no_number_stays_none() -> None:
    q = np.array([0.3, np.nan, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, np.nan])
    for c, s in (together(q), each(q)[1:]):
        assert np.isnan(c).tolist() == np.isnan(s).tolist() == np.isnan(q).tolist()
