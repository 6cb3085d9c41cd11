"""Estimated times, and times from rest to rest beside ruckig's."""

from dataclasses import replace

import numpy as np
import pytest
from ruckig import InputParameter, Ruckig
from ruckig import Trajectory as Phases

from kinematics.arrays import Array
from planning.options import Options
from planning.sequence.step import scaled_limits
from planning.timing.choice import chosen_parametrization
from planning.timing.estimate import LEG_ROWS, Leg, estimate_limits, estimated_time
from planning.timing.options import TimingOptions
from planning.timing.rest_to_rest import motion_times, rest_to_rest_kernel
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
        assert total == pytest.approx(legs[Leg.TIME, : len(points) - 1].sum(), rel=1e-12)
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


def ruckig_time(way: Array, limits: Array, synchronized: bool) -> float:
    """Least time of a motion along a line, or of its slowest joint [s]."""
    if synchronized:
        share = (np.abs(way) / limits).max(axis=1)
        limits = np.array([[1.0 / one if one > 0.0 else np.inf] for one in share])
        way = np.array([1.0])
    wanted = InputParameter(len(way))
    wanted.current_position = [0.0] * len(way)
    wanted.target_position = way.tolist()
    wanted.max_velocity, wanted.max_acceleration, wanted.max_jerk = limits.tolist()
    motion = Phases(len(way))
    Ruckig(len(way)).calculate(wanted, motion)
    return float(motion.duration)


@pytest.mark.parametrize("jerk", [np.inf, 500.0, 20.0, 3.0])
@pytest.mark.parametrize("straight", [True, False])
def test_times_are_those_of_ruckig(jerk: float, straight: bool) -> None:
    random = np.random.default_rng(3)
    q = random.uniform(-2.0, 2.0, (12, 3)) * random.choice([0.01, 1.0], (12, 1))
    limits = random.uniform(0.5, 4.0, (3, 3)) * [[1.0], [3.0], [1.0]]
    limits[2] *= jerk
    out = np.empty((12, 12), dtype=np.float32)
    rest_to_rest_kernel(q, limits[0], limits[1], limits[2], straight, np.array([0, 12]), out)
    assert (out == out.T).all()
    assert (np.diag(out) == 0.0).all()
    for a in range(12):
        for b in range(a):
            assert out[a, b] == pytest.approx(ruckig_time(q[a] - q[b], limits, straight), rel=1e-5)


def test_joints_that_keep_still_and_have_no_limit_take_no_time() -> None:
    q = np.array([[0.0, 1.0], [2.0, 1.0]])
    out = np.empty((2, 2), dtype=np.float32)
    fast = np.array([1.0, np.inf])
    rest_to_rest_kernel(
        q, fast, np.array([1.0, np.inf]), np.full(2, np.inf), True, np.array([0, 2]), out
    )
    assert out[0, 1] == pytest.approx(3.0)


@pytest.mark.parametrize("name", ["panda", "ur5e", "scara"])
def test_the_slowest_joint_decides(name: str) -> None:
    chain = builtin(name).chain
    low, high = chain.sampling_bounds()
    random = np.random.default_rng(4)
    start = random.uniform(low, high)
    ways = (random.uniform(low, high, (40, chain.n)) - start) * random.uniform(0, 1, (40, 1))
    limits = np.array([chain.limits.velocity, chain.limits.acceleration, np.full(chain.n, np.inf)])
    expected = [ruckig_time(way, limits, False) for way in ways]
    np.testing.assert_allclose(motion_times(chain, start, start + ways), expected, rtol=1e-6)


def test_a_joint_without_a_limit_of_acceleration_goes_at_its_speed_at_once() -> None:
    chain = builtin("planar_rr").chain
    limits = replace(chain.limits, acceleration=np.full(2, np.inf), velocity=np.array([2.0, 4.0]))
    times = motion_times(replace(chain, limits=limits), np.zeros(2), np.array([[1.0, 1.0], [0, 0]]))
    np.testing.assert_allclose(times, [0.5, 0.0])


def test_limits_and_shares_of_a_request_replace_those_of_the_robot() -> None:
    chain = builtin("planar_rr").chain
    given = {"velocity": np.array([3.0, np.inf]), "acceleration": np.array([8.0, 2.0])}
    slow = TimingOptions(velocity_scaling=0.5, acceleration_scaling=0.25)
    for timing, shares in ((TimingOptions(), (1.0, 1.0)), (slow, (0.5, 0.25))):
        limits = scaled_limits(chain, Options(limits=given, timing=timing))
        bounds = np.array([shares[0] * given["velocity"], shares[1] * given["acceleration"]])
        np.testing.assert_array_equal(limits, bounds)
        # The second joint has no limit of speed: it never gets to one.
        expected = ruckig_time(np.array([1.0, 0.5]), np.vstack([bounds, [np.inf] * 2]), False)
        (least,) = motion_times(chain, np.zeros(2), np.array([[1.0, 0.5]]), limits)
        assert least == pytest.approx(expected, rel=1e-6)
