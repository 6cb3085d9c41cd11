"""The least time on small grids, against scipy's sequential programs, and what stays inside."""

from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize

from kinematics.arrays import Array
from planning.timing.jerk.grid import grid
from planning.timing.jerk.interior_point import least_time_kernel
from planning.timing.jerk.jerk_limited import TOLERANCE, _start
from planning.timing.jerk.limits import (
    JerkLimits,
    decisive_kernel,
    inside_kernel,
    jerk_at_kernel,
    knot_kernel,
    time_kernel,
)
from planning.timing.path.blend import blend, largest_reaches
from planning.timing.path.path import JointPath


def rows_on(seed: int, jerk: float) -> JerkLimits:
    waypoints = np.random.default_rng(seed).uniform(-1.0, 1.0, (3, 2))
    path: JointPath = blend(waypoints, largest_reaches(waypoints), smooth=True)
    limits = np.array([[1.0, 1.5], [4.0, 5.0], [jerk, jerk]])
    return grid(path, limits).rows


def slacks(rows: JerkLimits, z: Array) -> Array:
    """What is left of every limit, at z with its ends as their neighbours."""
    h, left = rows.lengths, []
    knots = [knot_kernel(h, z, i) for i in range(len(h) - 1)]
    for i, (c, d) in enumerate(knots):
        if np.isfinite(rows.caps[i]):
            left.append(1.0 - c / rows.caps[i])
        for row in rows.knot_rows[i, : rows.knot_counts[i]]:
            value = row[0] * c + row[1] * d
            left += [value - row[2], row[3] - value]
    for k in range(len(h) - 2):
        (c0, d0), (c1, d1) = knots[k], knots[k + 1]
        e = (d1 - d0) / h[k + 1]
        for j in range(rows.jerk_counts[k]):
            for end, (c, d) in enumerate(((c0, d0), (c1, d1))):
                used = jerk_at_kernel(rows.jerk_rows[k, end, j], c, d, e) * np.sqrt(c)
                left += [1.0 - used, 1.0 + used]
    return np.array(left)


def inside(rows: JerkLimits, z: Array) -> Array:
    """The largest multiple of z that keeps all limits."""
    low, high = -4.0, 1.0
    assert inside_kernel(rows, z * np.exp(low))
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if inside_kernel(rows, z * np.exp(middle)) else (low, middle)
    return np.asarray(z * np.exp(low))


@pytest.mark.parametrize("jerk", [20.0, 200.0])
@pytest.mark.parametrize("seed", range(3))
def test_the_answer_keeps_every_limit_and_is_faster_than_the_start(seed: int, jerk: float) -> None:
    rows = rows_on(seed, jerk)
    z = _start(rows)
    before = time_kernel(rows, z)
    assert inside_kernel(rows, z)
    assert least_time_kernel(rows, z, 0.3, TOLERANCE) > 0
    assert inside_kernel(rows, z)
    assert slacks(rows, z).min() > 0.0
    assert time_kernel(rows, z) < 0.9 * before
    assert z[0] == pytest.approx(z[1], rel=1e-4)
    assert z[-1] == pytest.approx(z[-2], rel=1e-4)


@pytest.mark.parametrize("seed", range(2))
def test_scipy_finds_nothing_much_faster_from_there(seed: int) -> None:
    rows = rows_on(seed, 50.0)
    z = _start(rows)
    least_time_kernel(rows, z, 0.3, TOLERANCE)
    found = time_kernel(rows, z)

    def full(x: Array) -> Array:
        inner = np.exp(x)
        return np.concatenate([inner[:1], inner, inner[-1:]])

    program: Any = minimize
    better = program(
        lambda x: time_kernel(rows, full(x)),
        np.log(z[1:-1]),
        constraints={"type": "ineq", "fun": lambda x: slacks(rows, full(x))},
        method="SLSQP",
        options={"maxiter": 6},
    )
    assert found <= time_kernel(rows, inside(rows, full(better.x))) * (1.0 + 2.0 * TOLERANCE)


def test_the_tighter_the_tolerance_the_shorter_the_time() -> None:
    rows, times = rows_on(4, 50.0), []
    for tolerance in (3e-2, 3e-3, 3e-4):
        z = _start(rows)
        least_time_kernel(rows, z, 0.3, tolerance)
        times.append(time_kernel(rows, z))
    assert times[0] >= times[1] >= times[2]
    assert times[1] <= times[2] * (1.0 + 2.0 * 3e-3)


def test_inside_is_where_every_slack_is_positive() -> None:
    rows, rng, verdicts = rows_on(5, 50.0), np.random.default_rng(5), []
    z = _start(rows)
    for _ in range(60):
        other = z * np.exp(rng.normal(scale=2e-4, size=len(z)) + rng.uniform(-0.3, 0.5))
        other[0], other[-1] = other[1], other[-2]
        verdicts.append(bool(inside_kernel(rows, other)))
        assert verdicts[-1] == (slacks(rows, other).min() > 0.0)
    assert 3 < sum(verdicts) < 57
    for bad in (0.0, -1.0, np.nan):
        broken = z.copy()
        broken[4] = bad
        assert not inside_kernel(rows, broken)


def test_limits_that_are_hardly_used_are_left_out_and_all_others_stay() -> None:
    rows = rows_on(6, 50.0)
    z = _start(rows)
    least_time_kernel(rows, z, 0.3, TOLERANCE)
    fewer = decisive_kernel(rows, z, 0.3)
    assert fewer.knot_counts.sum() < rows.knot_counts.sum()
    assert (fewer.jerk_counts >= 1).all()
    np.testing.assert_array_equal(fewer.caps, rows.caps)
    for i in range(len(rows.caps)):
        c, d = knot_kernel(rows.lengths, z, i)
        used = [
            max(row[0] * c + row[1] * d, -row[0] * c - row[1] * d)
            for row in rows.knot_rows[i, : rows.knot_counts[i]]
        ]
        assert fewer.knot_counts[i] == sum(share > 0.3 for share in used)
    assert inside_kernel(fewer, z)
