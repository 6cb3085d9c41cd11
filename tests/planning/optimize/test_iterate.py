"""Motions while they are optimised, and their splines: values by scipy, ends as given."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import BSpline

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.optimize.iterate import Iterate, blocked_places, fit_spline, least_duration
from planning.optimize.spline import SplineSpace
from planning.optimize.task import End, Task
from planning.timing.path.blend import blend
from planning.timing.speed.minimum_time import time_path
from tests.planning.optimize.motions import PANDA, iterate, task
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


def test_the_duration_needed_is_the_least_that_keeps_every_limit() -> None:
    asked, at = between(*at_rest(), jerk=np.full(7, 40.0)), iterate(1)
    duration = least_duration(asked, at.space, at.points)
    for factor, within in ((1.0 + 1e-6, True), (0.999, False)):
        motion = replace(at, duration=factor * duration).trajectory(NAMES)
        assert (ratio(motion, asked) <= 1.0) is within


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


def spaces(seed: int) -> list[SplineSpace]:
    rng = np.random.default_rng(seed)
    found = []
    for degree in range(1, 8):
        for pieces in (1, 2, 5, 11):
            inner = np.sort(rng.uniform(0.01, 0.99, pieces - 1))
            found.append(SplineSpace(degree, (0.0, *(float(b) for b in inner), 1.0)))
    return found


@pytest.mark.parametrize("space", spaces(0), ids=lambda s: f"{s.degree}-{s.pieces}")
def test_values_derivatives_and_pieces_are_those_of_scipy(space: SplineSpace) -> None:
    rng = np.random.default_rng(space.degree)
    points, u, T = rng.normal(size=(space.count, 3)), np.linspace(0.0, 1.0, 101), 2.5
    reference = BSpline(space.knots, points, space.degree)
    motion = space.trajectory(("a", "b", "c"), points, T)
    for order in range(space.degree + 1):
        wanted = reference(u, nu=order)
        scale = 1e-9 * np.abs(wanted).max()
        np.testing.assert_allclose(space.matrix(u, order) @ points, wanted, atol=scale)
        rates = motion.sample(u[:-1] * T, order) * T**order
        # At a break another piece may be taken, where this derivative jumps.
        if order < space.degree:
            np.testing.assert_allclose(rates, wanted[:-1], atol=10.0 * scale)


@pytest.mark.parametrize("space", spaces(1)[::3], ids=lambda s: f"{s.degree}-{s.pieces}")
def test_control_points_of_derivatives_enclose_them(space: SplineSpace) -> None:
    points = np.random.default_rng(7).normal(size=(space.count, 2))
    u = np.linspace(0.0, 1.0, 301)
    for order, D in enumerate(space.differences, start=1):
        controls, values = D @ points, space.matrix(u, order) @ points
        derived = BSpline(space.knots[order:-order], controls, space.degree - order)(u)
        np.testing.assert_allclose(derived, values, atol=1e-9 * np.abs(values).max())
        slack = 1e-9 * np.abs(controls).max()
        assert (values <= controls.max(axis=0) + slack).all()
        assert (values >= controls.min(axis=0) - slack).all()


def test_gram_matrices_are_integrals() -> None:
    space = SplineSpace.uniform(4, 9)
    points = np.random.default_rng(3).normal(size=space.count)
    fine = np.linspace(0.0, 1.0, 200_001)
    for order, G in enumerate(space.gram):
        values = space.matrix(fine, order) @ points
        assert points @ G @ points == pytest.approx(np.trapezoid(values**2, fine), rel=1e-4)


@pytest.mark.parametrize("breaks", [(0.0,), (0.0, 0.5, 0.5, 1.0), (0.1, 1.0), (0.0, 2.0)])
def test_malformed_breaks_are_refused(breaks: tuple[float, ...]) -> None:
    with pytest.raises(InvalidOption):
        SplineSpace(3, breaks)
