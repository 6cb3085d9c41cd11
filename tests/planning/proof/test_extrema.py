"""Extrema and jumps of piecewise polynomials, against numpy's roots and dense samples."""

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.trajectory.trajectory import Trajectory
from planning.proof.extrema import extrema, jumps, largest_jump, to_bernstein
from planning.proof.limits.limit_uses import (
    AT,
    BEYOND,
    EXCESS,
    JOINT,
    JUMPING,
    LIMITED,
    RATIO,
    UNLIMITED,
    limit_uses,
    motion_uses,
)


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
    count = to_bernstein(np.array([1.0, 2.0, -3.0, 4.0]), 2.0, 0, b)
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
        largest = largest_jump(motion.breaks, motion.coefficients, order)
        assert largest == pytest.approx(abs(jump), abs=1e-12)


def test_the_largest_jump_is_no_number_where_some_jump_is_none() -> None:
    c, breaks = np.zeros((3, 2, 2)), np.arange(4.0)
    c[1, 1, 0], c[2, 0, 0] = np.nan, 3.0
    assert np.isnan(largest_jump(breaks, c, 0))
    assert largest_jump(breaks, c, 1) == 0.0
    assert largest_jump(breaks[:2], c[:1], 0) == 0.0


def test_uses_of_limits_are_those_of_the_extrema() -> None:
    """Position and derivatives at once, with limits on both sides, on one or on none."""
    random = np.random.default_rng(8)
    for _ in range(40):
        m, n, size = int(random.integers(1, 5)), 4, int(random.integers(1, 8))
        breaks = np.concatenate([[0.0], np.cumsum(10.0 ** random.uniform(-1.0, 0.5, m))])
        motion = Trajectory(tuple("abcd"), breaks, random.normal(size=(m, n, size)))
        lower = -random.uniform(0.1, 5.0, (4, n))
        upper = np.where(np.arange(4)[:, None] == 0, lower + random.uniform(0.1, 9.0, n), -lower)
        lower[0, 1], upper[0, 2], lower[1:, 3], upper[1:, 3] = -np.inf, np.inf, -np.inf, np.inf
        found = limit_uses(motion, lower, upper)
        for order in range(4):
            ends = extrema(breaks, motion.coefficients, order)
            np.testing.assert_array_equal(found.highest[order, :, 0], ends.maximum)
            np.testing.assert_array_equal(found.lowest[order, :, 0], -ends.minimum)
            half = 0.5 * (upper[order] - lower[order])
            both = np.isfinite(half)
            middle = 0.5 * (upper[order][both] + lower[order][both])
            ratios = np.zeros(n)
            ratios[both] = np.maximum(ends.maximum[both] - middle, middle - ends.minimum[both])
            ratios[both] /= half[both]
            use = found.uses[order]
            assert use[RATIO] == pytest.approx(ratios.max(), rel=1e-12)
            assert use[JOINT] == np.argmax(ratios)
            at = motion.sample([min(use[AT], breaks[-1])], order)[0, int(use[JOINT])]
            before = motion.sample([max(use[AT] - 1e-9, 0.0)], order)[0, int(use[JOINT])]
            extreme = ends.maximum[int(use[JOINT])], ends.minimum[int(use[JOINT])]
            near = [abs(value - end) for value in (at, before) for end in extreme]
            assert ratios.max() == 0.0 or min(near) <= 1e-5 * (1.0 + np.abs(extreme).max())
            excess = np.maximum(lower[order] - ends.lower, ends.upper - upper[order])
            if order:
                excess[both] /= half[both]
            assert use[EXCESS] == pytest.approx(excess.max(), rel=1e-9, abs=1e-12)
            assert use[BEYOND] == np.argmax(excess)


def test_equal_uses_of_a_limit_are_told_of_the_first_instant_and_joint() -> None:
    """A motion from rest to rest speeds up as hard as it slows down: rounding does not choose."""
    random = np.random.default_rng(5)
    for _ in range(50):
        step = random.uniform(0.05, 2.0) * random.choice([-1.0, 1.0])
        rest_to_rest = np.array([0.0, 0.0, 0.0, 10.0, -15.0, 6.0]) * step
        rest_to_rest[3:] *= 1.0 + 1e-15 * random.integers(-4, 5, 3)
        coefficients = np.stack([rest_to_rest, rest_to_rest * (1.0 + 1e-15)])[None]
        motion = Trajectory(("a", "b"), np.array([0.0, 1.0]), coefficients)
        limit = np.full((3, 2), 9.0)
        found = limit_uses(motion, -limit, limit)
        assert found.uses[2, JOINT] == 0
        assert found.uses[2, AT] == pytest.approx(0.5 - np.sqrt(3.0) / 6.0, rel=1e-6)
        # Pieces that push equally hard: the first of them.
        pushes = step * (1.0 + 1e-15 * random.integers(-4, 5, 5))[:, None, None]
        motion = Trajectory(("a",), np.arange(6.0), pushes * np.array([0.0, 0.0, 0.5]))
        found = limit_uses(motion, -limit[:, :1], limit[:, :1])
        assert found.uses[2, AT] == 0.0


def test_what_is_no_number_is_beyond_all_limits() -> None:
    motion = Trajectory(("a", "b"), np.array([0.0, 1.0]), np.zeros((1, 2, 2)))
    bound = np.array([[5.0, 5.0], [0.0, 1.0]])
    found = limit_uses(motion, -bound, bound)
    # A joint that may not move and does not: no share of its limit can be told.
    assert found.uses[1, EXCESS] == np.inf
    assert found.uses[1, BEYOND] == 0


def any_motion(random: np.random.Generator) -> Trajectory:
    breaks = np.concatenate([[0.0], np.cumsum(random.uniform(0.1, 1.0, 3))])
    return Trajectory(tuple("abcd"), breaks, random.normal(size=(3, 4, 6)))


@pytest.mark.parametrize("seed", range(4))
def test_limits_of_a_motion_are_used_as_its_derivatives_tell(seed: int) -> None:
    random = np.random.default_rng(seed)
    motion = any_motion(random)
    n = motion.n
    limits = random.uniform(0.5, 3.0, (5, n))
    limits[0] = -limits[1]
    limits[2, 0], limits[4] = np.inf, (np.nan if seed % 2 else limits[4])
    used = motion_uses(motion, limits, np.inf)
    assert used.limited.tolist() == [LIMITED, LIMITED, LIMITED, UNLIMITED if seed % 2 else LIMITED]
    upper = np.where(np.isfinite(limits[1:]), limits[1:], np.inf)
    lower = -upper
    lower[0] = limits[0]
    orders = 3 if seed % 2 else 4
    expected = limit_uses(motion, lower[:orders], upper[:orders])
    for name in expected._fields:
        np.testing.assert_array_equal(getattr(used.found, name), getattr(expected, name))
    np.testing.assert_array_equal(used.lower, lower)
    np.testing.assert_array_equal(used.upper, upper)


def test_jerk_is_not_looked_at_where_the_acceleration_jumps() -> None:
    motion = any_motion(np.random.default_rng(0))
    limits = np.ones((5, motion.n))
    assert motion_uses(motion, limits, -1.0).limited.tolist() == [
        LIMITED,
        LIMITED,
        LIMITED,
        JUMPING,
    ]
