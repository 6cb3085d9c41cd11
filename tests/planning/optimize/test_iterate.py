"""Motions while they are optimised: values by scipy, ends as given."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import BSpline

from kinematics.arrays import Array
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.optimize.iterate import Iterate, blocked_places, fit_spline, least_duration, set_ends
from planning.optimize.spline import SplineSpace
from planning.optimize.task import End, Task
from planning.timing.path.blend import blend
from planning.timing.speed.minimum_time import time_path
from planning.timing.time_scaling import fitting_factor
from tests.planning.optimize.motions import PANDA, SPACE, iterate, task
from tests.planning.scenes import HOME, box
from tests.planning.slider import slider


def random_ends(seed: int, accelerations: bool = True) -> tuple[End, End]:
    rng = np.random.default_rng(seed)
    ends = [End(*rng.normal(size=(3 if accelerations else 2, 7))) for _ in range(2)]
    return ends[0], ends[1]


def rates(at: Iterate, place: float, order: int) -> Array:
    """A derivative with respect to time, by scipy."""
    spline = BSpline(at.space.knots, at.points, at.space.degree)
    return np.asarray(spline(place, nu=order) / at.duration**order)


def test_samples_and_trajectory_are_scipys_spline_in_time() -> None:
    at, u = iterate(1), np.linspace(0.0, 1.0, 41)
    motion = at.trajectory(PANDA.joint_names)
    assert motion.duration == pytest.approx(at.duration, rel=1e-15)
    for order in range(4):
        wanted = BSpline(SPACE.knots, at.points, SPACE.degree)(u, nu=order)
        scale = 1e-10 * np.abs(wanted).max()
        np.testing.assert_allclose(at.sample(u, order), wanted, atol=scale)
        times = np.minimum(u * at.duration, motion.duration)
        timed = wanted / at.duration**order
        np.testing.assert_allclose(motion.sample(times, order), timed, atol=2.0 * scale)


@pytest.mark.parametrize("accelerations", [False, True])
@pytest.mark.parametrize("degree", [3, 5])
def test_ends_are_exact_and_the_rest_stays(accelerations: bool, degree: int) -> None:
    space = SplineSpace.uniform(degree, 12)
    points = np.random.default_rng(2).normal(size=(12, 7))
    start, end = random_ends(3, accelerations)
    at = Iterate(space, points, 0.7).with_ends(start, end)
    for given, place in ((start, 0.0), (end, 1.0)):
        for order, values in enumerate(given.derivatives):
            np.testing.assert_allclose(rates(at, place, order), values, atol=1e-9)
    touched = 3 if accelerations else 2
    np.testing.assert_array_equal(at.points[touched:-touched], points[touched:-touched])
    assert (at.points[touched - 1] != points[touched - 1]).any()


def test_setting_ends_leaves_the_iterate_it_came_from_alone() -> None:
    at = iterate(4)
    before = at.points.copy()
    at.with_ends(*random_ends(5))
    np.testing.assert_array_equal(at.points, before)


def test_setting_ends_twice_changes_nothing_more() -> None:
    points, (start, end) = iterate(6).points.copy(), random_ends(7)
    set_ends(SPACE, points, 1.3, start, end)
    once = points.copy()
    set_ends(SPACE, points, 1.3, start, end)
    np.testing.assert_allclose(points, once, atol=1e-12)


def test_the_slower_a_motion_the_farther_its_velocity_moves_the_control_point() -> None:
    start, end = random_ends(8, accelerations=False)
    moved = [
        Iterate(SPACE, iterate(9).points, T).with_ends(start, end).points[1] for T in (1.0, 2.0)
    ]
    np.testing.assert_allclose(
        moved[1] - start.position, 2.0 * (moved[0] - start.position), atol=1e-12
    )


def test_part_of_the_way_to_another_motion_is_linear_in_points_and_duration() -> None:
    one, other = iterate(10), Iterate(SPACE, iterate(11).points, 2.7)
    for share in (0.0, 0.25, 1.0):
        between = one.toward(other, share)
        mean = (1.0 - share) * one.points + share * other.points
        np.testing.assert_allclose(between.points, mean, atol=1e-14)
        assert between.duration == pytest.approx((1.0 - share) * 1.3 + share * 2.7)


POSTS = Scene(
    (
        box("west", (0.1, 0.1, 0.3), (-0.4, 0.0, 0.0)),
        box("east", (0.1, 0.1, 0.3), (0.4, 0.0, 0.0)),
    )
)
CHECKER = Checker.of(slider(), POSTS)


def distance(q: Array) -> Array:
    """From the ball to the nearer post, shape (k,)."""
    gaps = []
    for x in (-0.4, 0.4):
        outside = np.maximum(np.abs(q - [x, 0.0]) - 0.05, 0.0)
        gaps.append(np.linalg.norm(outside, axis=1) - 0.05)
    return np.asarray(np.minimum(gaps[0], gaps[1]))


def across(height: float, degree: int, count: int = 14) -> Iterate:
    """A line at a height above both posts."""
    x = np.linspace(-0.9, 0.9, count)
    return Iterate(SplineSpace.uniform(degree, count), np.column_stack([x, 0.0 * x + height]), 2.0)


@pytest.mark.parametrize("degree", [3, 4, 5])
def test_a_line_beside_the_posts_is_free_and_one_through_them_names_both(degree: int) -> None:
    assert blocked_places(CHECKER, across(0.11, degree)) == []
    at = across(0.02, degree)
    places = blocked_places(CHECKER, at)
    assert places
    assert places == sorted(places)
    met = at.sample(np.array(places))
    assert distance(met).max() < 0.02
    assert {x > 0.0 for x in met[:, 0]} == {True, False}


def test_there_is_one_place_at_most_in_each_stretch() -> None:
    at = across(0.0, 3, 8)
    places = np.array(blocked_places(CHECKER, at))
    stretches = np.searchsorted(at.space.breaks, places, side="right")
    assert len(set(stretches.tolist())) == len(places)


def test_slack_is_kept_too() -> None:
    near = across(0.115, 3)
    assert blocked_places(CHECKER, near) == []
    assert blocked_places(Checker(CHECKER.model, 0.02), near) != []


def test_random_cubics_are_blocked_exactly_where_dense_samples_are() -> None:
    rng, counts = np.random.default_rng(0), [0, 0]
    for _ in range(60):
        points = rng.uniform(-0.6, 0.6, (8, 2))
        at = Iterate(SplineSpace.uniform(3, 8), points, 1.0)
        least = float(distance(at.sample(np.linspace(0.0, 1.0, 4001))).min())
        if abs(least) < 1e-3:
            continue
        places = blocked_places(CHECKER, at)
        assert bool(places) == (least < 0.0)
        counts[bool(places)] += 1
    assert min(counts) > 5


def test_two_cubics_a_piece_follow_a_quintic() -> None:
    """A quintic that rises over a post and back: the cubics see it where it is."""
    space = SplineSpace.uniform(5, 16)
    x = np.linspace(-0.9, 0.1, 16)
    for height, free in ((0.16, True), (0.04, False)):
        bump = height * np.exp(-(((x + 0.4) / 0.25) ** 2))
        at = Iterate(space, np.column_stack([x, bump]), 1.0)
        least = float(distance(at.sample(np.linspace(0.0, 1.0, 4001))).min())
        assert (least > 0.0) is free
        assert (blocked_places(CHECKER, at) == []) is free


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
