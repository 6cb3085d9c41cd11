"""Braking of single joints, against ruckig and closed forms."""

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.trajectory.trajectory import Trajectory
from planning.stops.braking import Braking, BrakingLimits
from planning.stops.stop_family import joint_stop
from tests.planning.stops.judge import Brakes


def states(count: int, seed: int) -> tuple[Array, Array, BrakingLimits]:
    """Velocities and accelerations (count,), with limits."""
    random = np.random.default_rng(seed)
    limit = 10.0 ** random.uniform(-1.0, 1.5, count)
    jerk = limit * 10.0 ** random.uniform(0.0, 2.5, count)
    # Of the sizes at which all forms of the profile occur, and at rest.
    v = random.normal(size=count) * limit * limit / jerk * 10.0 ** random.uniform(-2, 1, count)
    a = random.uniform(-1.0, 1.0, count) * limit
    v[: count // 50], a[: count // 100] = 0.0, 0.0
    return v, a, BrakingLimits(limit, jerk)


@pytest.mark.parametrize("seed", range(3))
def test_joints_brake_as_quickly_as_by_ruckig(seed: int) -> None:
    v, a, limits = states(500, seed)
    braking = Braking.of(v, a, limits)
    for k in range(len(v)):
        one = BrakingLimits(limits.acceleration[k : k + 1], limits.jerk[k : k + 1])
        ways, duration = Brakes(one).states(np.zeros(1), v[k : k + 1], a[k : k + 1], 9)
        assert braking.duration[k] == pytest.approx(duration, rel=1e-6, abs=1e-9)
        for time, way in zip(np.linspace(0.0, duration, 9), ways[:, 0], strict=True):
            size = 1e-6 * (1.0 + np.abs(ways).max())
            assert braking.moved(np.full(v.shape, time))[k] == pytest.approx(way, abs=size)


def test_without_a_limit_of_jerk_the_way_is_half_v_squared_over_a() -> None:
    random = np.random.default_rng(5)
    v, a, limit = random.normal(size=300), random.normal(size=300), random.uniform(0.5, 9.0, 300)
    braking = Braking.of(v, a, BrakingLimits(limit, np.full(300, np.inf)))
    np.testing.assert_allclose(braking.duration, np.abs(v) / limit)
    np.testing.assert_allclose(braking.moved(2.0 * braking.duration), 0.5 * v * np.abs(v) / limit)
    half = 0.5 * braking.duration
    np.testing.assert_allclose(braking.moved(half), 0.375 * v * np.abs(v) / limit)


@pytest.mark.parametrize("seed", range(3))
def test_states_in_order_stay_in_order(seed: int) -> None:
    """What ends of intervals bound rests on this, for every time."""
    v, a, limits = states(4000, seed)
    random = np.random.default_rng(seed)
    faster = v + np.abs(v) * random.uniform(0.0, 1.0, v.shape)
    harder = np.minimum(a + random.uniform(0.0, 0.5, v.shape) * limits.acceleration,
                        limits.acceleration)  # fmt: skip
    least, most = Braking.of(v, a, limits), Braking.of(faster, harder, limits)
    longest = np.maximum(least.duration, most.duration)
    for share in np.linspace(0.0, 1.0, 40):
        gap = most.moved(share * longest) - least.moved(share * longest)
        assert (gap >= -1e-9 * (1.0 + np.abs(most.moved(longest)))).all()
    between = Braking.of(0.5 * (v + faster), 0.5 * (a + harder), limits)
    assert (between.duration <= longest * (1.0 + 1e-9)).all()


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("jerk", [60.0, np.inf])
def test_a_stop_is_the_motion_that_braking_says(seed: int, jerk: float) -> None:
    random, n = np.random.default_rng(seed), 5
    names = tuple(f"j{k}" for k in range(n))
    motion = Trajectory(names, np.array([0.0, 1.0]), random.normal(size=(1, n, 4)) * 0.5)
    limits = BrakingLimits(np.full(n, 8.0), np.full(n, jerk))
    stop = joint_stop(motion, 0.3, limits)
    q, v, a = (motion.sample([0.3], order)[0] for order in range(3))
    braking = Braking.of(v, a, limits)
    assert stop.duration == pytest.approx(braking.duration.max(), abs=1e-12)
    for time in np.linspace(0.0, stop.duration, 30):
        expected = q + braking.moved(np.full(n, time))
        np.testing.assert_allclose(stop.sample([time])[0], expected, atol=1e-12)
    np.testing.assert_allclose(stop.sample([0.0], 1)[0], v, atol=1e-12)
    np.testing.assert_allclose(stop.sample([stop.duration], 1)[0], 0.0, atol=1e-10)
    if np.isfinite(jerk):
        np.testing.assert_allclose(stop.sample([0.0], 2)[0], a, atol=1e-12)
    np.testing.assert_array_less(stop.continuity()[:2], 1e-10)
    assert (stop.peaks(2).value <= 8.0 * (1.0 + 1e-9)).all()


def test_a_joint_at_rest_stays() -> None:
    still = Trajectory(("a", "b"), np.array([0.0, 1.0]), np.ones((1, 2, 1)))
    stop = joint_stop(still, 0.5, BrakingLimits(np.ones(2), np.ones(2)))
    np.testing.assert_array_equal(stop.start, [1.0, 1.0])
    np.testing.assert_array_equal(stop.end, [1.0, 1.0])
