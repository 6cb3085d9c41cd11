"""Motion at steady speeds: limits, ends, the path itself, and where it is slower."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from benchmarks.judges.ratios import worst_ratio
from planning.timing.jerk.steady_speed import SteadyMotion, time_at_steady_speed
from planning.timing.path.path import JointPath

NAMES = ("a", "b", "c")
LIMITS = np.array([[2.0, 2.0, 3.0], [10.0, 8.0, 15.0], [500.0, 400.0, 800.0]])


def spline(seed: int, count: int = 12, size: float = 0.2) -> tuple[JointPath, CubicSpline]:
    """A cubic spline over places from 0 to 1, which its first joint has for values."""
    random = np.random.default_rng(seed)
    s = np.sort(np.concatenate([[0.0, 1.0], random.uniform(0.03, 0.97, count)]))
    s = s[np.append(True, np.diff(s) > 0.01)]
    s[-1] = 1.0
    q = np.cumsum(random.normal(0.0, size, (len(s), 3)), axis=0) / np.sqrt(len(s))
    q[:, 0] = s
    curve = CubicSpline(s, q)
    return JointPath(np.ascontiguousarray(np.moveaxis(curve.c[::-1], 0, 2)), np.diff(s)), curve


def timed(path: JointPath, speed: float, variation: float = 0.05) -> SteadyMotion:
    wanted = np.full(len(path.lengths), speed)
    answer = time_at_steady_speed(path, NAMES, LIMITS, wanted, variation)
    assert answer is not None
    return answer


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("speed", [0.2, 1.0, 5.0])
def test_limits_hold_for_all_times_from_rest_to_rest(seed: int, speed: float) -> None:
    path, curve = spline(seed)
    answer = timed(path, speed).timed
    # The ramps keep the limits of themselves: nothing is left for slowing down.
    assert answer.factor <= 1.0 + 1e-9
    motion = answer.trajectory
    for order, limit in enumerate(LIMITS, 1):
        assert worst_ratio(motion, limit, order) <= 1.0 + 1e-9
    jumps = motion.continuity()
    assert jumps.position < 1e-12
    assert jumps.velocity < 1e-10
    assert jumps.acceleration < 1e-8
    for order in (1, 2):
        ends = motion.sample([0.0, motion.duration], order)
        np.testing.assert_allclose(ends, 0.0, atol=1e-9)
    np.testing.assert_allclose(motion.start, curve(0.0), atol=1e-12)
    np.testing.assert_allclose(motion.end, curve(1.0), atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_the_motion_is_on_the_path_and_no_faster_than_asked(seed: int) -> None:
    path, curve = spline(seed)
    answer = timed(path, 0.6)
    motion = answer.timed.trajectory
    times = np.linspace(0.0, motion.duration, 2001)
    q, rates = motion.sample(times), motion.sample(times, 1)[:, 0]
    np.testing.assert_allclose(curve(np.clip(q[:, 0], 0.0, 1.0)), q, atol=1e-9)
    assert rates.max() <= max(answer.speeds) * (1.0 + 1e-9)
    assert max(answer.speeds) <= 0.6
    assert (rates[1:-1] > 0.0).all()


def test_a_path_with_room_is_run_through_at_one_speed_but_for_its_ramps() -> None:
    path, curve = spline(3, size=0.05)
    answer = timed(path, 0.3)
    assert answer.speeds == (0.3,)
    assert answer.timed.factor == 1.0
    motion = answer.timed.trajectory
    rates = motion.sample(np.linspace(0.1, 0.9, 1001) * motion.duration, 1)[:, 0]
    np.testing.assert_allclose(rates, 0.3, atol=1e-12)
    # Ramps at the limits take about v / a more than the way at full speed does.
    slope = np.abs(curve([0.0, 1.0], 1))
    a = (LIMITS[1] / slope).min(axis=1)
    j = (LIMITS[2] / slope).min(axis=1)
    least = 1.0 / 0.3 + 0.5 * sum(0.3 / a + a / j)
    assert least <= motion.duration <= least + 0.3


def test_only_the_stretch_that_bends_too_sharply_is_slower() -> None:
    s = np.array([0.0, 0.2, 0.4, 0.48, 0.5, 0.52, 0.6, 0.8, 1.0])
    q = np.column_stack([s, 0.0 * s, 0.0 * s])
    q[4, 1] = 0.01
    curve = CubicSpline(s, q)
    path = JointPath(np.ascontiguousarray(np.moveaxis(curve.c[::-1], 0, 2)), np.diff(s))
    answer = timed(path, 0.5)
    assert answer.speeds[0] == answer.speeds[-1] == 0.5
    assert min(answer.speeds) < 0.4
    motion = answer.timed.trajectory
    times = np.linspace(0.0, motion.duration, 2001)
    rates = motion.sample(times, 1)[:, 0]
    at = motion.sample(times)[:, 0]
    np.testing.assert_allclose(rates[(at > 0.1) & (at < 0.3)], 0.5, atol=1e-9)
    np.testing.assert_allclose(rates[(at > 0.7) & (at < 0.9)], 0.5, atol=1e-9)
    assert rates[(at > 0.49) & (at < 0.51)].max() < 0.4


def test_a_speed_that_the_path_is_too_short_for_is_lowered() -> None:
    path = JointPath(np.array([[[0.0, 0.01], [0.0, 0.0], [0.0, 0.0]]]), np.array([1.0]))
    answer = timed(path, 100.0)
    assert answer.speeds[0] < 100.0
    assert worst_ratio(answer.timed.trajectory, LIMITS[2], 3) <= 1.0 + 1e-9
    np.testing.assert_allclose(answer.timed.trajectory.end, [0.01, 0.0, 0.0], atol=1e-14)
