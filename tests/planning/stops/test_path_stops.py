"""Stops along a motion's own path, against closed forms and a finer search."""

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.trajectory.trajectory import Trajectory
from planning.proof.certificate import certify_limits
from planning.stops.braking import BrakingLimits
from planning.stops.path_stops import path_stop, prove_path_stops
from planning.values.limits import MotionLimits
from tests.planning.stops.motions import arm, motions


def trapeze(speed: float, acceleration: float) -> Trajectory:
    """One joint from rest to rest: up for a time, at a speed for a second, and down."""
    up = speed / acceleration
    way, on = 0.5 * speed * up, speed
    pieces = np.array([
        [[0.0, 0.0, 0.5 * acceleration]],
        [[way, speed, 0.0]],
        [[way + on, speed, -0.5 * acceleration]],
    ])  # fmt: skip
    return Trajectory(("j",), np.array([0.0, up, up + 1.0, 2.0 * up + 1.0]), pieces)


def test_a_joint_alone_stops_in_its_speed_over_its_acceleration() -> None:
    motion = trapeze(1.2, 4.0)
    for brake in (4.0, 8.0):
        limits = BrakingLimits(np.array([brake]), np.array([np.inf]))
        found = prove_path_stops(motion, limits)
        assert found.proved
        assert 0.3 * 4.0 / brake <= found.longest
        # A cell of a fiftieth of a second late at most.
        assert found.longest <= 0.3 * 4.0 / brake + 0.02
        for at in (0.31, 0.7, 1.1):
            speed = float(motion.sample([at], 1)[0, 0])
            stop = path_stop(motion, at, limits)
            assert stop.duration == pytest.approx(speed / brake, rel=1e-6)
            way = float(stop.end[0] - stop.start[0])
            assert way == pytest.approx(0.5 * speed * speed / brake, rel=1e-6)


@pytest.mark.parametrize("name", ["panda", "ur5e", "stanford"])
def test_stops_keep_to_the_path_and_the_limits_and_are_within_the_longest(name: str) -> None:
    for moved in motions(name, 3, 3.0, jerk=False):
        motion, limits = moved.trajectory, moved.around.braking
        found = prove_path_stops(motion, limits)
        assert found.proved
        chain = arm(name).chain
        wanted = MotionLimits(dict(moved.around.limits.bounds))
        for at in np.linspace(0.0, motion.duration, 25):
            stop = path_stop(motion, float(at), limits)
            assert stop.duration <= found.longest + 1e-9
            proof = certify_limits(stop, chain, wanted)
            assert proof.verified, proof.violation
            np.testing.assert_allclose(stop.sample([0.0])[0], motion.sample([at])[0], atol=1e-12)
            np.testing.assert_allclose(stop.sample([stop.duration], 1), 0.0, atol=1e-9)
            assert _off_path(stop, motion) < 1e-9


def _off_path(stop: Trajectory, motion: Trajectory) -> float:
    """Largest distance of a stop from its motion, whose path is a straight line."""
    line = motion.end - motion.start
    off = stop.sample(np.linspace(0.0, stop.duration, 50)) - motion.start
    return float(np.abs(off - np.outer(off @ line, line) / (line @ line)).max())


def test_a_joint_that_brakes_at_its_limit_already_takes_the_rest_of_the_motion() -> None:
    motion = trapeze(1.2, 4.0)
    limits = BrakingLimits(np.array([4.0]), np.array([np.inf]))
    begun = 1.35
    stop = path_stop(motion, begun, limits)
    assert stop.duration == pytest.approx(motion.duration - begun, abs=1e-6)


def curved(seed: int) -> tuple[Trajectory, BrakingLimits]:
    """A curve of three joints from rest to rest, and limits that it keeps with little to spare."""
    random = np.random.default_rng(seed)
    shape = np.polynomial.Polynomial([0.0, 0.0, 0.0, 10.0, -15.0, 6.0])
    rows = []
    for _ in range(3):
        curve = np.polynomial.Polynomial([0.0, *random.normal(size=2)])
        rows.append(np.pad(curve(shape).coef, (0, 11))[:11])
    motion = Trajectory(
        ("a", "b", "c"), np.array([0.0, 1.0]), np.array(rows, dtype=np.float64)[None]
    )
    return motion, BrakingLimits(1.001 * motion.peaks(2).value, np.full(3, np.inf))


@pytest.mark.parametrize("seed", range(5))
def test_the_longest_stop_is_near_that_of_small_steps(seed: int) -> None:
    motion, limits = curved(seed)
    found = prove_path_stops(motion, limits)
    longest = max(_stepped(motion, limits, at) for at in np.linspace(0.02, 0.98, 25))
    assert longest <= found.longest
    assert found.longest <= 1.15 * longest + 0.02


def _stepped(motion: Trajectory, limits: BrakingLimits, at: float) -> float:
    """Time to rest by the largest deceleration at each of many small steps of time."""
    s, speed, time, step = at, 1.0, 0.0, 2e-4
    while speed > 0.0 and s < motion.duration:
        v, a = (motion.sample([min(s, motion.duration)], order)[0] for order in (1, 2))
        slower = _largest_deceleration(v, a * speed * speed, limits.acceleration)
        s, speed, time = s + step * speed, speed - step * slower, time + step
    return time


def _largest_deceleration(v: Array, a: Array, limit: Array) -> float:
    # |a - v d| <= limit.
    moving = np.abs(v) > 1e-12
    ends = (limit[moving] + np.sign(v[moving]) * a[moving]) / np.abs(v[moving])
    return float(ends.min()) if moving.any() else 1e9


def test_a_motion_that_ends_while_it_moves_has_no_stop_along_its_path() -> None:
    shape = np.array([[[0.0, 0.0, 1.0]]])
    motion = Trajectory(("j",), np.array([0.0, 1.0]), shape)
    found = prove_path_stops(motion, BrakingLimits(np.array([4.0]), np.array([np.inf])))
    assert not found.proved
    assert "ends while 'j' moves" in found.message
