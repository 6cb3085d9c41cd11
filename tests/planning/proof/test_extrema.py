"""Extrema and jumps of piecewise polynomials, against numpy's roots and dense samples."""

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.trajectory import Trajectory
from planning.proof.extrema import extrema, jumps, to_bernstein


def by_roots(p: np.polynomial.Polynomial, length: float) -> tuple[float, float]:
    """Least and largest value of a polynomial on [0, length], by numpy."""
    slope = p.deriv().trim()
    roots = slope.roots() if len(slope.coef) > 1 else np.zeros(0)
    real = roots.real[np.abs(roots.imag) < 1e-6 * (1.0 + np.abs(roots))]
    places = [0.0, length, *(t for t in real if 0.0 < t < length)]
    values = [float(p(t)) for t in places]
    return min(values), max(values)


@pytest.mark.parametrize("size", [1, 2, 3, 4, 6, 9])
@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_extrema_are_those_of_the_roots(size: int, order: int) -> None:
    random = np.random.default_rng(10 * size + order)
    for _ in range(60):
        m, n = int(random.integers(1, 5)), 3
        breaks = np.concatenate([[0.0], np.cumsum(10.0 ** random.uniform(-2.0, 1.0, m))])
        lengths = np.diff(breaks)[:, None, None]
        c = random.normal(size=(m, n, size)) / lengths ** np.arange(size)
        found = extrema(breaks, c, order)
        for j in range(n):
            ends = [
                by_roots(np.polynomial.Polynomial(c[i, j]).deriv(order), float(lengths[i, 0, 0]))
                for i in range(m)
            ]
            low, high = min(a for a, _ in ends), max(b for _, b in ends)
            size_of = max(abs(low), abs(high), 1e-300)
            assert found.maximum[j] == pytest.approx(high, rel=1e-9, abs=1e-9 * size_of)
            assert found.minimum[j] == pytest.approx(low, rel=1e-9, abs=1e-9 * size_of)
            # From outside, and hardly so.
            assert high - 1e-12 * size_of <= found.upper[j] <= high + 1e-8 * size_of
            assert low - 1e-8 * size_of <= found.lower[j] <= low + 1e-12 * size_of
            motion = Trajectory(("a", "b", "c"), breaks, c)
            at = motion.sample([min(found.time_of_maximum[j], breaks[-1])], order)[0, j]
            before = motion.sample([max(found.time_of_maximum[j] - 1e-9, 0.0)], order)[0, j]
            assert max(at, before) == pytest.approx(high, abs=1e-5 * size_of)


def test_a_narrow_peak_is_found() -> None:
    # 1 - (1e4 (t - 0.3))^2 (...) between 0 and 1: a peak that samples of a thousandth miss.
    t = np.polynomial.Polynomial([-0.3, 1.0])
    p = 1.0 - 1e8 * t**2 + 1e15 * t**4
    c: Array = np.array(p.coef, dtype=np.float64)[None, None]
    found = extrema(np.array([0.0, 0.3001]), c, 0)
    assert found.maximum[0] == pytest.approx(max(1.0, float(p(0.0)), float(p(0.3001))), rel=1e-6)
    dip = extrema(np.array([0.0, 0.3001]), -c, 0)
    assert dip.minimum[0] == pytest.approx(-found.maximum[0], rel=1e-12)


def test_bernstein_coefficients_are_the_control_points() -> None:
    b = np.empty(6)
    count = to_bernstein(np.array([1.0, 2.0, -3.0, 4.0]), 2.0, 0, 1.0, b)
    # Of 1 + 4 u - 12 u^2 + 32 u^3 by hand.
    np.testing.assert_allclose(b[:count], [1.0, 1.0 + 4.0 / 3.0, 1.0 + 8.0 / 3.0 - 4.0, 25.0])


def test_jumps_of_every_order() -> None:
    c = np.zeros((2, 1, 4))
    c[0, 0] = [1.0, 2.0, 3.0, 4.0]
    c[1, 0] = [10.0 + 1e-3, 20.0 + 2e-3, 30.0, 4.0]
    motion = Trajectory(("a",), np.array([0.0, 1.0, 2.0]), c)
    # At t = 1 the first piece has value 10, velocity 20, acceleration 30, jerk 24.
    for order, jump in enumerate((1e-3, 2e-3, 60.0 - 30.0, 0.0)):
        assert jumps(motion, order)[0, 0] == pytest.approx(jump, abs=1e-12)
