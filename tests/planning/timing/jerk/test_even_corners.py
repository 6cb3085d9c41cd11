"""Rounded polylines at even corners, their reaches, and double-S legs beside ruckig."""

import itertools

import numpy as np
import pytest

from benchmarks.judges.ratios import worst_ratio
from planning.timing.jerk.double_s import (
    CONVERGED,
    MAX_PHASES,
    Legs,
    leg_phases_kernel,
    leg_time,
    lower_speeds_kernel,
    ramp_time,
)
from planning.timing.jerk.even_corners import (
    fastest_reaches,
    time_even_corners,
)
from planning.timing.jerk.jerk_limited import time_path_with_jerk
from planning.timing.jerk.state_to_state import JointState, state_to_state
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
    motion, stretched, solver, _ = time_even_corners(path, names(7), limits)
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


def _ramp_length(low: float, high: float, limits: np.ndarray) -> float:
    return 0.5 * (low + high) * ramp_time(abs(high - low), limits[1], limits[2])


@pytest.mark.parametrize("seed", range(40))
def test_a_leg_takes_the_time_that_ruckig_finds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    limits = 10.0 ** rng.uniform(-1.0, 1.5, 3)
    if seed % 5 == 0:
        limits[0] = np.inf
    start, end = rng.uniform(0.0, min(limits[0], 3.0), 2) * rng.choice([0.0, 1.0], 2)
    length = _ramp_length(min(start, end), max(start, end), limits) + 10.0 ** rng.uniform(-3, 1)
    states = [JointState(np.array([q]), np.array([v])) for q, v in ((0.0, start), (length, end))]
    expected = state_to_state(("a",), states[0], states[1], limits[:, None]).duration
    assert leg_time(start, end, length, limits, CONVERGED) == pytest.approx(expected, rel=1e-8)
    phases = np.zeros((MAX_PHASES, 5))
    used = leg_phases_kernel(start, end, length, limits, phases)
    place, speed, rate = 0.0, start, 0.0
    for s, v, half, sixth, t in phases[:used]:
        assert (s, v, 2.0 * half) == pytest.approx((place, speed, rate), rel=1e-9, abs=1e-9)
        assert v <= limits[0] * (1.0 + 1e-12)
        assert abs(2.0 * half) <= limits[1] * (1.0 + 1e-9)
        assert abs(6.0 * sixth) <= limits[2] * (1.0 + 1e-12)
        place, speed = s + (v + (half + sixth * t) * t) * t, v + (2.0 * half + 3.0 * sixth * t) * t
        rate = 2.0 * half + 6.0 * sixth * t
    assert (place, speed) == pytest.approx((length, end), rel=1e-10, abs=1e-12)
    assert abs(rate) < 1e-9 * limits[1]


@pytest.mark.parametrize("seed", range(10))
def test_speeds_are_the_largest_that_the_legs_leave_room_for(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 9))
    limits = 10.0 ** rng.uniform(0.5, 1.5, (count, 3))
    legs = Legs(10.0 ** rng.uniform(-3.0, 0.5, count), limits)
    caps = rng.uniform(0.1, 3.0, count + 1)
    caps[[0, -1]] = 0.0
    speeds = caps.copy()
    time = lower_speeds_kernel(legs, speeds, CONVERGED)
    assert np.isfinite(time)
    assert (speeds <= caps).all()

    def possible(values: np.ndarray) -> bool:
        pairs = zip(itertools.pairwise(values), legs.lengths, legs.limits, strict=True)
        lengths = [(_ramp_length(min(p), max(p), lim), length) for p, length, lim in pairs]
        return all(ramp <= length * (1.0 + 1e-9) for ramp, length in lengths)

    assert possible(speeds)
    for i in range(1, count):
        raised = speeds.copy()
        raised[i] *= 1.0 + 1e-5
        assert raised[i] > caps[i] or not possible(raised)


@pytest.mark.parametrize("seed", range(4))
def test_reaches_are_nearly_the_fastest_of_a_fine_grid(seed: int) -> None:
    points = np.cumsum(np.random.default_rng(seed).uniform(-0.5, 0.7, (4, 7)), axis=0)
    limits, largest = _limits(10.0), largest_reaches(points)

    def duration(reaches: np.ndarray) -> float:
        path = blend(points, reaches, smooth=True)
        return float(time_even_corners(path, names(7), limits).trajectory.duration)

    shares = itertools.product(np.linspace(0.0, 1.0, 21), repeat=2)
    least = min(duration(largest * share) for share in shares)
    found = duration(fastest_reaches(points, limits, largest))
    assert found <= 1.01 * least
    assert found < 0.99 * duration(0.05 * largest)
