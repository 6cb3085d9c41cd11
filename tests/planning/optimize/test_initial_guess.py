"""Splines that an optimisation starts from: near the motion, ends exact, as fast as may be."""

from dataclasses import replace

import numpy as np
import pytest

from kinematics.trajectory.trajectory import Trajectory
from planning.optimize.initial_guess import fit_spline, least_duration
from planning.optimize.spline import SplineSpace
from planning.optimize.task import End, Task
from planning.timing.path.blend import blend
from planning.timing.speed.minimum_time import time_path
from planning.timing.time_scaling import fitting_factor
from tests.planning.optimize.motions import PANDA, iterate, task
from tests.planning.scenes import HOME

NAMES = PANDA.joint_names
CORNERS = HOME + np.array([[0.0] * 7, [0.4, 0.1, 0, 0.2, 0, 0, 0], [0.2, 0.4, 0, 0, 0.3, 0, 0]])


def known() -> Trajectory:
    """Round a corner, within the Panda's limits."""
    limits = PANDA.limits
    path = blend(CORNERS, [0.1])
    return time_path(path, NAMES, limits.velocity, limits.acceleration).trajectory


def between(start: End, end: End, **bounds: np.ndarray) -> Task:
    asked = task()
    return replace(asked, start=start, end=end, bounds={**asked.bounds, **bounds})


def at_rest(smooth: bool = False) -> tuple[End, End]:
    return End.at_rest(CORNERS[0], smooth=smooth), End.at_rest(CORNERS[-1], smooth=smooth)


def ratio(motion: Trajectory, asked: Task) -> float:
    """The largest share of a limit, at many instants."""
    times = np.linspace(0.0, motion.duration, 5001)
    orders = {"velocity": 1, "acceleration": 2, "jerk": 3}
    shares = [
        np.abs(motion.sample(times, orders[name])).max(axis=0) / limits
        for name, limits in asked.bounds.items()
    ]
    return float(np.max(shares))


@pytest.mark.parametrize("smooth", [False, True])
def test_it_is_near_the_motion_ends_as_it_does_and_uses_a_limit_fully(smooth: bool) -> None:
    asked, motion = between(*at_rest(smooth)), known()
    at = fit_spline(asked, SplineSpace.uniform(3, 16), motion)
    u = np.linspace(0.0, 1.0, 301)
    off = np.linalg.norm(at.sample(u) - motion.sample(u * motion.duration), axis=1)
    assert off.max() < 0.05
    np.testing.assert_array_equal(at.points[[0, -1]], CORNERS[[0, -1]])
    fixed = 3 if smooth else 2
    np.testing.assert_allclose(at.points[1:fixed], np.tile(CORNERS[0], (fixed - 1, 1)), atol=1e-12)
    assert 0.998 < ratio(at.trajectory(NAMES), asked) <= 1.0 + 1e-9


def test_no_other_spline_with_these_ends_is_nearer_in_the_mean() -> None:
    asked, motion = between(*at_rest()), known()
    space = SplineSpace.uniform(3, 12)
    at = fit_spline(asked, space, motion)
    u = np.linspace(0.0, 1.0, 4 * space.count + 1)
    wanted = motion.sample(u * motion.duration)
    least = np.square(at.sample(u) - wanted).sum()
    rng = np.random.default_rng(0)
    for size in (1e-1, 1e-3, 1e-5):
        moved = at.points.copy()
        moved[2:-2] += size * rng.normal(size=moved[2:-2].shape)
        assert np.square(replace(at, points=moved).sample(u) - wanted).sum() > least


def test_the_duration_needed_is_the_least_that_keeps_every_limit() -> None:
    asked, at = between(*at_rest(), jerk=np.full(7, 40.0)), iterate(1)
    duration = least_duration(asked, at.space, at.points)
    for factor, within in ((1.0 + 1e-6, True), (0.999, False)):
        motion = replace(at, duration=factor * duration).trajectory(NAMES)
        assert (ratio(motion, asked) <= 1.0) is within


def test_standing_still_takes_a_moment() -> None:
    still = np.tile(HOME, (16, 1))
    space = SplineSpace.uniform(3, 16)
    assert least_duration(between(*at_rest()), space, still) == 1e-3


def test_control_points_stay_inside_the_joints_ranges() -> None:
    """The motion itself leads past the upper limit of joint 4 and back."""
    upper = float(PANDA.limits.upper[3])
    start = np.where(np.arange(7) == 3, upper - 0.05, HOME)
    bend = np.zeros((1, 7, 3))
    bend[0, :, 0], bend[0, 3, 1:] = start, [0.8, -0.8]
    motion = Trajectory(NAMES, np.array([0.0, 1.0]), bend)
    assert motion.sample([0.5])[0, 3] > upper
    ends = End.at_rest(start, smooth=False), End.at_rest(motion.end, smooth=False)
    at = fit_spline(between(*ends), SplineSpace.uniform(3, 16), motion)
    assert at.points[:, 3].max() <= upper


def test_with_velocities_at_the_ends_a_duration_is_found_that_keeps_the_limits() -> None:
    velocity = np.where(np.arange(7) == 0, 0.8, 0.0)
    start, goal = (End(q, velocity) for q in (HOME, HOME + 0.6 * np.eye(7)[0]))
    line = np.stack([HOME, 0.6 * np.eye(7)[0]], axis=-1)[None]
    motion = Trajectory(NAMES, np.array([0.0, 1.0]), line)
    asked = between(start, goal)
    at = fit_spline(asked, SplineSpace.uniform(3, 16), motion)
    moving = at.trajectory(NAMES)
    for time in (0.0, moving.duration):
        np.testing.assert_allclose(moving.sample([time], 1)[0], velocity, atol=1e-9)
    assert ratio(moving, asked) <= 1.0 + 1e-9
    # The first of the durations tried that does, each half as long again.
    assert any(at.duration == pytest.approx(1.5**k) for k in range(14))


def test_where_no_duration_keeps_the_limits_the_nearest_to_them_is_taken() -> None:
    """Faster at its ends than the limit: every duration violates it, some by much more."""
    velocity = np.where(np.arange(7) == 0, 3.0, 0.0)
    start, goal = (End(q, velocity) for q in (HOME, HOME + 0.6 * np.eye(7)[0]))
    line = np.stack([HOME, 0.6 * np.eye(7)[0]], axis=-1)[None]
    at = fit_spline(
        between(start, goal),
        SplineSpace.uniform(3, 16),
        Trajectory(NAMES, np.array([0.0, 1.0]), line),
    )
    # By how much a motion would have to be slowed down: no more than for its speed at the ends.
    bounds = between(start, goal).bounds
    best = fitting_factor(at.trajectory(NAMES), **bounds)
    assert best > 1.0
    for k in range(14):
        other = replace(at, duration=1.5**k).with_ends(start, goal)
        assert fitting_factor(other.trajectory(NAMES), **bounds) > 0.999 * best
