"""Estimated times: closed forms, their scaling, and that they go with the times of motions."""

import numpy as np
import pytest

from kinematics.arrays import Array
from planning.timing.choice import chosen_parametrization
from planning.timing.estimate import LEG_ROWS, TIME, estimate_limits, estimated_time
from planning.timing.options import TimingOptions
from tests.planning.scenes import builtin

LIMITS = estimate_limits(
    np.array([2.0, 1.0, 3.0]), np.array([5.0, 8.0, 6.0]), np.array([50.0, 80.0, 60.0])
)


def estimate(points: Array, limits: Array = LIMITS) -> float:
    return estimated_time(points, len(points), limits, np.empty((LEG_ROWS, len(points))))


def paths(count: int, n: int, seed: int = 0) -> list[Array]:
    random = np.random.default_rng(seed)
    return [random.uniform(-1.5, 1.5, (int(random.integers(2, 9)), n)) for _ in range(count)]


@pytest.mark.parametrize("distance", [0.01, 0.3, 4.0])
def test_a_straight_motion_takes_the_time_of_a_trapezoid(distance: float) -> None:
    points = np.array([[0.0, 0.0, 0.0], [0.0, distance, 0.0]])
    speed, push = 1.0, 0.7 * 8.0
    if distance < speed**2 / push:
        expected = 2.0 * np.sqrt(distance / push)
    else:
        expected = distance / speed + speed / push
    assert estimate(points) == pytest.approx(expected, rel=1e-12)


def test_points_on_a_line_cost_nothing() -> None:
    ends = np.array([[0.1, -0.4, 0.2], [1.3, 0.9, -0.7]])
    many = ends[0] + np.linspace(0.0, 1.0, 6)[:, None] * (ends[1] - ends[0])
    assert estimate(many) == pytest.approx(estimate(ends), rel=1e-9)
    assert estimate(many[[0, 0, 2, 2, 5]]) > estimate(ends)  # a rest, where a corner has no room


@pytest.mark.parametrize("factor", [0.1, 3.0])
def test_limits_that_scale_with_time_scale_it(factor: float) -> None:
    faster = LIMITS * np.array([[factor], [factor**2], [factor**3]])
    for points in paths(20, 3):
        assert estimate(points, faster) == pytest.approx(estimate(points) / factor, rel=1e-9)


def test_legs_add_up_and_backwards_it_takes_as_long() -> None:
    for points in paths(20, 3):
        legs = np.empty((LEG_ROWS, len(points)))
        total = estimated_time(points, len(points), LIMITS, legs)
        assert total == pytest.approx(legs[TIME, : len(points) - 1].sum(), rel=1e-12)
        assert total == pytest.approx(estimate(points[::-1].copy()), rel=1e-9)


def test_jerk_that_is_not_limited_makes_corners_quicker() -> None:
    free = estimate_limits(LIMITS[0], LIMITS[1], None)
    assert all(estimate(points, free) <= estimate(points) for points in paths(20, 3))


def test_it_goes_with_the_times_of_motions() -> None:
    chain = builtin("panda").chain
    timing = chosen_parametrization(TimingOptions(), chain.joint_names, chain.limits, None, chain)
    told, real = [], []
    for points in paths(40, chain.n, seed=5):
        reaches = 0.5 * np.minimum(
            *(
                np.linalg.norm(np.diff(points, axis=0), axis=1)[k:][: len(points) - 2]
                for k in (0, 1)
            )
        )
        motion = timing.time_polyline(points, reaches, chain.joint_names).trajectory
        told.append(estimate(points, timing.estimate_limits))
        real.append(motion.duration)
    assert np.corrcoef(told, real)[0, 1] > 0.95
