"""Least times from rest to rest, held against Ruckig's time-optimal motions of single joints."""

from dataclasses import replace

import numpy as np
import pytest
from ruckig import InputParameter, Result, Ruckig, Trajectory

from planning.options import Options
from planning.sequence.estimate import travel_times
from planning.timing.options import TimingOptions
from tests.planning.scenes import builtin


def ruckig_time(distance: float, velocity: float, acceleration: float) -> float:
    """Duration of the fastest motion of one joint without a limit of its jerk [s]."""
    wanted, motion = InputParameter(1), Trajectory(1)
    wanted.current_position, wanted.target_position = [0.0], [distance]
    wanted.max_velocity, wanted.max_acceleration = [velocity], [acceleration]
    assert Ruckig(1).calculate(wanted, motion) in (Result.Working, Result.Finished)
    return float(motion.duration)


@pytest.mark.parametrize("name", ["panda", "ur5e", "scara"])
def test_the_slowest_joint_decides(name: str) -> None:
    chain = builtin(name).chain
    low, high = chain.sampling_bounds()
    random = np.random.default_rng(4)
    start = random.uniform(low, high)
    ends = start + (random.uniform(low, high, (40, chain.n)) - start) * random.uniform(
        0, 1, (40, 1)
    )
    v, a = chain.limits.velocity, chain.limits.acceleration
    expected = [
        max(ruckig_time(d, v[i], a[i]) for i, d in enumerate(np.abs(end - start))) for end in ends
    ]
    np.testing.assert_allclose(travel_times(chain, start, ends), expected, rtol=1e-6)


def test_a_joint_without_a_limit_of_acceleration_goes_at_its_speed_at_once() -> None:
    chain = builtin("planar_rr").chain
    limits = replace(chain.limits, acceleration=np.full(2, np.inf), velocity=np.array([2.0, 4.0]))
    times = travel_times(replace(chain, limits=limits), np.zeros(2), np.array([[1.0, 1.0], [0, 0]]))
    np.testing.assert_allclose(times, [0.5, 0.0])


def test_limits_and_shares_of_a_request_replace_those_of_the_robot() -> None:
    chain = builtin("planar_rr").chain
    start, end = np.zeros(2), np.array([[1.0, 0.5]])
    given = {"velocity": np.array([3.0, np.inf]), "acceleration": np.array([8.0, 2.0])}
    slow = TimingOptions(velocity_scaling=0.5, acceleration_scaling=0.25)
    for timing, (v, a) in ((TimingOptions(), (3.0, 8.0)), (slow, (1.5, 2.0))):
        # The second joint has no limit of speed: it never gets to one.
        unbound = 2.0 * np.sqrt(0.5 / (2.0 * timing.acceleration_scaling))
        expected = max(ruckig_time(1.0, v, a), unbound)
        options = Options(limits=given, timing=timing)
        np.testing.assert_allclose(travel_times(chain, start, end, options), expected, rtol=1e-6)
