"""Kernels over polynomials beside numpy's, with roots placed on purpose."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import Polynomial
from numpy.polynomial import polynomial as power_basis

from kinematics.arrays import Array
from kinematics.trajectory.polynomial import (
    piece_extrema_kernel,
    sample_kernel,
    shift_kernel,
    unit_roots_kernel,
)
from tests.properties import numbers

COEFFICIENTS = st.integers(1, 8).flatmap(lambda count: numbers(count, 3.0))
SAMPLES = np.linspace(0.0, 1.0, 501)


def from_roots(roots: list[float]) -> Array:
    """Ascending coefficients of the monic polynomial of some roots."""
    return np.asarray(power_basis.polyfromroots(roots), dtype=np.float64)


def roots_in_unit(c: Array) -> Array:
    """Sign changes in (0, 1] by the kernel."""
    n = len(c)
    roots, spare = np.full((2, n + 1), np.nan)
    return roots[: unit_roots_kernel(c, n, np.zeros((n + 1, n + 1)), roots, spare)]


# -------------------------------------------------------------------------------- derivatives


@given(COEFFICIENTS, st.floats(-2.0, 2.0))
def test_a_shift_is_taylors_and_undoes_itself(c: Array, offset: float) -> None:
    out, back = np.full((2, len(c)), np.nan)
    shift_kernel(c, offset, out)
    scale = np.abs(c).sum() * (1.0 + abs(offset)) ** len(c)
    expected = np.asarray(Polynomial(c)(Polynomial([offset, 1.0])).coef, dtype=np.float64)
    np.testing.assert_allclose(out[: len(expected)], expected, atol=1e-14 * scale)
    shift_kernel(out, -offset, back)
    np.testing.assert_allclose(back, c, atol=1e-13 * scale * (1.0 + abs(offset)) ** len(c))


# --------------------------------------------------------------------------------------- roots


@pytest.mark.parametrize(
    ("roots", "expected"),
    [
        ([], []),
        ([0.5], [0.5]),
        ([0.2, 0.7], [0.2, 0.7]),
        ([0.2, 0.2000001], [0.2, 0.2000001]),
        ([-0.5, 0.25, 2.0], [0.25]),
        ([0.3, 0.3, 0.3], [0.3]),
        ([0.1, 0.3, 0.5, 0.7, 0.9], [0.1, 0.3, 0.5, 0.7, 0.9]),
        ([1.0], [1.0]),
        ([0.4, 1.0], [0.4, 1.0]),
        ([-1.0, -2.0, 1.5], []),
        ([1e-9, 1.0 - 1e-9], [1e-9, 1.0 - 1e-9]),
    ],
)
@pytest.mark.parametrize("factor", [1.0, -3e-7, 1e9])
def test_sign_changes_are_found_where_they_were_put(
    roots: list[float], expected: list[float], factor: float
) -> None:
    found = roots_in_unit(factor * from_roots(roots))
    assert len(found) == len(expected)
    # A triple root is known to a third of the digits.
    tolerance = 3e-5 if roots.count(0.3) == 3 else 1e-9
    np.testing.assert_allclose(found, expected, atol=tolerance)


@given(COEFFICIENTS)
def test_between_neighbouring_roots_the_sign_does_not_change(c: Array) -> None:
    found = roots_in_unit(c)
    assert (np.diff(found) >= 0.0).all()
    assert ((found > 0.0) & (found <= 1.0)).all()
    values = power_basis.polyval(SAMPLES, c)
    clear = np.abs(values) > 1e-9 * (np.abs(c).sum() + 1e-300)
    for low, high in zip([0.0, *found], [*found, 1.0], strict=True):
        between = np.logical_and(np.greater(SAMPLES, low), np.less(SAMPLES, high))
        signs = np.sign(values[clear & between])
        assert (signs == signs[:1]).all()


def test_a_double_root_is_answered_where_it_is_or_not_at_all() -> None:
    for root in np.linspace(0.05, 0.95, 19):
        for others in ([], [0.99], [-0.3, 2.0]):
            found = roots_in_unit(from_roots([root, root, *others]))
            places = [root, *(other for other in others if 0.0 < other <= 1.0)]
            assert all(np.abs(np.subtract(places, x)).min() < 1e-6 for x in found)
            assert all(np.abs(found - other).min() < 1e-9 for other in places[1:])


# ------------------------------------------------------------------------------------- bounds


# ------------------------------------------------------------------------------------- pieces


def test_samples_at_a_break_are_of_the_piece_that_begins_there() -> None:
    breaks = np.array([0.0, 1.0, 3.0])
    coefficients = np.array([[[0.0, 1.0]], [[10.0, 2.0]]])
    times = np.array([0.0, 1.0, 0.999, 3.0, 1.0, 0.0, 2.0])
    values = np.full((7, 1), np.nan)
    sample_kernel(breaks, coefficients, times, 0, values)
    np.testing.assert_allclose(values[:, 0], [0.0, 10.0, 0.999, 14.0, 10.0, 0.0, 12.0])
    sample_kernel(breaks, coefficients, times, 1, values)
    np.testing.assert_allclose(values[:, 0], [1.0, 2.0, 1.0, 2.0, 2.0, 1.0, 2.0])
    sample_kernel(breaks, coefficients, times, 2, values)
    assert not values.any()


@given(st.integers(0, 10_000))
def test_the_order_of_times_does_not_matter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    breaks = np.concatenate([[0.0], np.cumsum(rng.uniform(0.1, 1.0, 4))])
    coefficients, times = rng.normal(size=(4, 2, 3)), rng.uniform(0.0, breaks[-1], 12)
    order = rng.permutation(12)
    values, shuffled = np.empty((2, 12, 2))
    sample_kernel(breaks, coefficients, times, 0, values)
    sample_kernel(breaks, coefficients, times[order], 0, shuffled)
    np.testing.assert_array_equal(shuffled, values[order])


@given(numbers((1, 1, 6), 3.0), st.floats(0.05, 4.0), st.integers(0, 3))
def test_the_range_of_a_piece_holds_its_values_tightly(
    coefficients: Array, h: float, order: int
) -> None:
    lower, upper = np.empty((2, 1, 1))
    piece_extrema_kernel(np.array([0.0, h]), coefficients, order, np.empty((10, 6)), lower, upper)
    p = Polynomial(coefficients[0, 0]).deriv(order) if order else Polynomial(coefficients[0, 0])
    values = p(h * np.linspace(0.0, 1.0, 4001))
    spread = np.ptp(values) + 1e-12 * (1.0 + np.abs(values).max())
    assert lower[0, 0] - 1e-9 * spread <= values.min() <= lower[0, 0] + 1e-4 * spread
    assert upper[0, 0] + 1e-9 * spread >= values.max() >= upper[0, 0] - 1e-4 * spread
