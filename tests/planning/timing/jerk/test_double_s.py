"""Double-S legs against ruckig, speeds between legs against brute force."""

import itertools

import numpy as np
import pytest

from planning.timing.jerk.double_s import (
    CONVERGED,
    MAX_PHASES,
    Legs,
    leg_phases_kernel,
    leg_time,
    lower_speeds_kernel,
    peak_speed,
    ramp_time,
)
from planning.timing.jerk.ruckig import line_phases


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
    expected = line_phases(length, limits, start, end)[:, 4].sum()
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


def test_a_leg_that_is_just_a_ramp_has_no_other_phases() -> None:
    limits = np.array([5.0, 2.0, 8.0])
    length = _ramp_length(0.3, 1.1, limits)
    assert peak_speed(0.3, 1.1, length, limits, CONVERGED) == 1.1
    phases = np.zeros((MAX_PHASES, 5))
    assert leg_phases_kernel(0.3, 1.1, length, limits, phases) == 3
    assert phases[:3, 4].sum() == pytest.approx(ramp_time(0.8, 2.0, 8.0))


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
