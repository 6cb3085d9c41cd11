"""Rounded polylines at even corners: exact limits, continuous acceleration, on the path."""

import numpy as np
import pytest

from benchmarks.judges.ratios import worst_ratio
from planning.timing.jerk.even_corners import (
    fastest_reaches,
    pass_even_corners,
    rounded_pieces_kernel,
    time_even_corners,
)
from planning.timing.jerk.jerk_limited import time_path_with_jerk
from planning.timing.path.blend import blend, largest_reaches, merge
from tests.planning.timing.timed_paths import PANDA_ACCELERATION, PANDA_VELOCITY, names


def _limits(factor: float) -> np.ndarray:
    return np.stack([PANDA_VELOCITY, PANDA_ACCELERATION, factor * PANDA_ACCELERATION])


@pytest.mark.parametrize("factor", [10.0, 500.0])
@pytest.mark.parametrize("seed", range(6))
def test_limits_hold_exactly_on_the_path_itself(seed: int, factor: float) -> None:
    rng = np.random.default_rng(seed)
    points = merge(rng.uniform(-1.5, 1.5, (int(rng.integers(3, 7)), 7)))
    limits, largest = _limits(factor), largest_reaches(points)
    reaches = fastest_reaches(points, limits, largest)
    assert ((reaches >= 0.0) & (reaches <= largest)).all()
    path = blend(points, reaches, smooth=True)
    motion, stretched, solver = time_even_corners(path, names(7), limits)
    assert solver == "double_s"
    assert stretched == pytest.approx(1.0, abs=1e-9)
    for order, bound in enumerate(limits, 1):
        assert worst_ratio(motion, bound, order) <= 1.0 + 1e-9
    assert motion.degree == 3
    jumps = motion.continuity()
    assert jumps.position < 1e-11
    assert jumps.velocity < 1e-10
    assert jumps.acceleration < 1e-7
    np.testing.assert_allclose(motion.sample([0.0, motion.duration], 1), 0.0, atol=1e-9)
    np.testing.assert_allclose(motion.end, points[-1], atol=1e-12)
    dense = path.sample(np.linspace(0.0, path.breaks[-1], 20_001))
    at = motion.sample(np.linspace(0.0, motion.duration, 40))
    away = np.linalg.norm(at[:, None] - dense[None], axis=2).min(axis=1)
    assert away.max() < path.length / 20_000
    best = time_path_with_jerk(path, names(7), *limits).trajectory.duration
    assert 0.99 * best <= motion.duration <= 1.3 * best


def test_the_motion_stops_at_sharp_corners_and_goes_on_between_curves_that_meet() -> None:
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [2.0, 1.0]])
    limits = np.array([[1.0, 1.0], [4.0, 4.0], [40.0, 40.0]])
    stops = time_even_corners(blend(points, [0.0, 0.0], smooth=True), ("a", "b"), limits).trajectory
    times = stops.breaks[1:-1]
    at_rest = [t for t in times if np.abs(stops.sample([t], 1)).max() < 1e-9]
    assert len(at_rest) == 2
    meeting = blend(points, [0.5, 0.5], smooth=True)
    flowing = time_even_corners(meeting, ("a", "b"), limits).trajectory
    inner = np.linspace(0.05, flowing.duration - 0.05, 100)
    assert np.linalg.norm(flowing.sample(inner, 1), axis=1).min() > 0.01
    assert flowing.duration < stops.duration


def test_a_line_takes_seven_phases_at_most() -> None:
    points = np.array([[0.0, 0.0], [1.0, -2.0]])
    limits = np.array([[1.0, np.inf], [4.0, 4.0], [40.0, 40.0]])
    line = blend(points, np.zeros(0), smooth=True)
    motion = time_even_corners(line, ("a", "b"), limits).trajectory
    # The second joint goes twice as far: its limits decide, and the first one's velocity.
    best = time_path_with_jerk(line, ("a", "b"), *limits).trajectory
    assert motion.pieces <= 7
    assert motion.duration == pytest.approx(best.duration, rel=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_pieces_of_a_polyline_are_those_of_its_path(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = merge(rng.uniform(-1.5, 1.5, (int(rng.integers(2, 9)), 7)))
    limits = _limits(10.0)
    reaches = rng.choice([0.0, 0.4, 1.0]) * largest_reaches(points)
    path = blend(points, reaches, smooth=True)
    motion = pass_even_corners(path, names(7), limits)
    breaks, coefficients = rounded_pieces_kernel(points, reaches, limits)
    np.testing.assert_array_equal(breaks, motion.breaks)
    np.testing.assert_array_equal(coefficients, motion.coefficients)
    # Position and velocity along the path, worked out from its own polynomials.
    places = np.concatenate([[0.0], np.cumsum(path.lengths)])
    at_breaks = path.sample(places)
    away = np.linalg.norm(motion.sample(breaks)[:, None] - at_breaks[None], axis=2)
    assert away.min(axis=0).max() < 1e-9
