"""Legs in closed form beside ruckig, between speeds with and without accelerations."""

import numpy as np
import pytest

from kinematics.arrays import Array
from planning.timing.jerk.double_s import MAX_PHASES, line_phases, moving_leg_kernel, ramp_time
from planning.timing.jerk.state_to_state import JointState, state_to_state
from planning.timing.options import TimingFailed


def least_time(start: Array, end: Array, length: float, limits: Array) -> float:
    """The time that ruckig takes between two states (speed, acceleration)."""
    first, last = (
        JointState(np.array([q]), np.array(state[:1]), np.array(state[1:]))
        for q, state in ((0.0, start), (length, end))
    )
    return float(state_to_state(("a",), first, last, limits[:, None]).duration)


def check(phases: Array, start: Array, end: Array, length: float, limits: Array) -> None:
    """Phases go on from one another within limits, from the one state to the other."""
    place, (speed, rate) = 0.0, start
    for s, v, half, sixth, t in phases:
        at = place, speed, rate
        assert (s, v, 2.0 * half) == pytest.approx(at, rel=1e-9, abs=1e-9 * limits[1])
        assert t > 0.0
        assert -1e-12 <= v <= limits[0] * (1.0 + 1e-12)
        assert abs(2.0 * half) <= limits[1] * (1.0 + 1e-9)
        assert abs(6.0 * sixth) <= limits[2] * (1.0 + 1e-12)
        place, speed = s + (v + (half + sixth * t) * t) * t, v + (2.0 * half + 3.0 * sixth * t) * t
        rate = 2.0 * half + 6.0 * sixth * t
    assert (place, speed) == pytest.approx((length, end[0]), rel=1e-10, abs=1e-12)
    assert rate == pytest.approx(end[1], abs=1e-9 * limits[1])


def drawn_limits(rng: np.random.Generator, seed: int) -> Array:
    limits = 10.0 ** rng.uniform(-1.0, 1.5, 3)
    if seed % 5 == 0:
        limits[0] = np.inf
    return np.asarray(limits)


@pytest.mark.parametrize("seed", range(40))
def test_a_leg_takes_the_time_that_ruckig_finds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    limits = drawn_limits(rng, seed)
    low, high = np.sort(rng.uniform(0.0, min(limits[0], 3.0), 2) * rng.choice([0.0, 1.0], 2))
    ramp = 0.5 * (low + high) * ramp_time(high - low, limits[1], limits[2])
    for start, end in ((low, high), (high, low)):
        length = ramp + 10.0 ** rng.uniform(-3, 1)
        states = np.array([start, 0.0]), np.array([end, 0.0])
        phases = line_phases(length, limits, start, end)
        assert len(phases) <= MAX_PHASES
        check(phases, *states, length, limits)
        assert phases[:, 4].sum() == pytest.approx(least_time(*states, length, limits), rel=1e-8)
    if ramp > 0.0:
        with pytest.raises(TimingFailed, match="no room"):
            line_phases(0.99 * ramp, limits, low, high)


@pytest.mark.parametrize("seed", range(8))
def test_a_leg_between_accelerations_takes_the_time_that_ruckig_finds(seed: int) -> None:
    """States of ruckig's own motions, whose jerk is at its limit there, mostly."""
    rng = np.random.default_rng(seed)
    found = 0
    for _ in range(300):
        limits = drawn_limits(rng, seed)
        speeds = rng.uniform(0.0, min(limits[0], 3.0), 2)
        start, end = np.column_stack([speeds, rng.uniform(-1.0, 1.0, 2) * limits[1]])
        # The speeds that the accelerations come from and lead to are within limits.
        turned = (
            np.array([speeds, speeds])
            + [[0.5], [-0.5]]
            * np.array([start[1] * abs(start[1]), end[1] * abs(end[1])])
            / limits[2]
        )
        if turned.min() < 0.0 or turned.max() > limits[0]:
            continue
        length, phases = 10.0 ** rng.uniform(-2, 1), np.zeros((MAX_PHASES + 2, 5))
        used = moving_leg_kernel(tuple(start), tuple(end), length, limits, phases)
        if used == 0:
            continue
        found += 1
        check(phases[:used], start, end, length, limits)
        least = least_time(start, end, length, limits)
        assert least <= phases[:used, 4].sum() * (1.0 + 1e-8)
        assert phases[:used, 4].sum() <= (1.0 + 1e-8) * least
    assert found > 20
