"""Quintic splines of few pieces against scipy's B-splines and least squares."""

import numpy as np
import pytest
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline, CubicSpline

from benchmarks.judges.ratios import worst_ratio
from kinematics.errors import InvalidOption, InvalidTrajectory
from planning.timing.jerk.even_corners import fastest_reaches, time_even_corners
from planning.timing.path.blend import blend, largest_reaches, merge
from planning.timing.spline.quintic_basis import DEGREE
from planning.timing.spline.quintic_fit import MIN_SPANS, fit_quintic, fit_spans_kernel
from planning.timing.spline.span_loads import no_loads
from planning.timing.spline.spline import Ends, chord_knots, spline_path, spline_trajectory
from planning.timing.time_scaling import ScaledTime
from tests.planning.timing.timed_paths import PANDA_ACCELERATION, PANDA_VELOCITY, names

LIMITS = np.stack([PANDA_VELOCITY, PANDA_ACCELERATION, 10.0 * PANDA_ACCELERATION])


def _knots(spans: np.ndarray) -> np.ndarray:
    breaks = np.concatenate([[0.0], np.cumsum(spans)])
    return np.concatenate([np.zeros(DEGREE), breaks, np.full(DEGREE, breaks[-1])])


def _rounded(seed: int, corners: int = 3) -> tuple[np.ndarray, ScaledTime]:
    rng = np.random.default_rng(seed)
    points = merge(np.cumsum(rng.uniform(-0.2, 0.6, (corners + 2, 7)), axis=0))
    reaches = fastest_reaches(points, LIMITS, largest_reaches(points))
    return points, time_even_corners(blend(points, reaches, smooth=True), names(7), LIMITS)


@pytest.mark.parametrize("n", [1, 2, 7, 8, 14])
def test_the_spline_is_that_of_least_squares_with_ends_at_rest(n: int) -> None:
    rng = np.random.default_rng(1)
    points, shares = rng.normal(size=(9, 4, n)), np.array([0.1, 0.4, 0.6, 0.9])
    ends, spans = rng.normal(size=(2, n)), rng.uniform(0.1, 0.4, 9)
    coefficients, limits = np.zeros((9, n, 6)), np.ones((3, n))
    factor = fit_spans_kernel(points, shares, ends, limits, no_loads(), spans, coefficients)
    breaks = np.concatenate([[0.0], np.cumsum(spans)])
    times = (breaks[:-1, None] + spans[:, None] * shares).ravel()
    design = BSpline.design_matrix(times, _knots(spans), DEGREE).toarray()
    control = np.concatenate([np.tile(ends[0], (3, 1)), np.zeros((8, n)), np.tile(ends[1], (3, 1))])
    right = points.reshape(-1, n) - design @ control
    control[3:-3] = np.linalg.lstsq(design[:, 3:-3], right, rcond=None)[0]
    spline = BSpline(_knots(spans), control, DEGREE)
    for order in range(3):
        ours = coefficients[:, :, order] * [1.0, 1.0, 2.0][order]
        np.testing.assert_allclose(ours, spline(breaks[:-1], order), rtol=1e-8, atol=1e-8)
    fine = np.linspace(0.0, breaks[-1], 2000)
    worst = max(np.abs(spline(fine, k)).max() ** (1.0 / k) for k in (1, 2, 3))
    assert factor == pytest.approx(worst, rel=0.02)


@pytest.mark.parametrize("seed", range(8))
def test_few_pieces_keep_all_limits_exactly(seed: int) -> None:
    points, rounded = _rounded(seed)
    spline, _, solver = fit_quintic(rounded.trajectory, names(7), LIMITS, len(points) - 1)
    assert solver == "quintic_spline"
    for order, bound in enumerate(LIMITS, 1):
        assert worst_ratio(spline, bound, order) <= 1.0 + 1e-9
    assert spline.pieces <= max(MIN_SPANS, 8.0 * rounded.trajectory.duration + 1.0)
    np.testing.assert_allclose(spline.start, points[0], atol=1e-12)
    np.testing.assert_allclose(spline.end, points[-1], atol=1e-10)
    for order in (1, 2):
        ends = spline.sample([0.0, spline.duration], order)
        np.testing.assert_allclose(ends, 0.0, atol=1e-8)
    for order in range(5):
        scale = np.abs(spline.peaks(order).value).max()
        assert np.abs(spline.jumps(order)).max() <= 1e-7 * max(scale, 1.0)
    # Near the path, and about as fast.
    on_path = rounded.trajectory.sample(np.linspace(0.0, rounded.trajectory.duration, 4000))
    at = spline.sample(np.linspace(0.0, spline.duration, 50))
    away = np.linalg.norm(at[:, None] - on_path[None], axis=2).min(axis=1)
    assert away.max() < 0.04
    assert spline.duration < 1.2 * rounded.trajectory.duration


def test_slow_motions_have_no_more_pieces_than_their_legs_need() -> None:
    points, rounded = _rounded(0)
    slow = rounded.trajectory.dilate(10.0)
    limits = LIMITS / np.array([[10.0], [100.0], [1000.0]])
    spline = fit_quintic(slow, names(7), limits, len(points) - 1).trajectory
    assert spline.pieces == 6 * (len(points) - 1)


@pytest.mark.parametrize("ends", ["natural", "clamped"])
@pytest.mark.parametrize("k", [2, 3, 4, 9, 60])
def test_splines_agree_with_scipys(ends: Ends, k: int) -> None:
    rng = np.random.default_rng(k)
    for n in (1, 7):
        points = rng.uniform(-3.0, 3.0, (k, n))
        times = np.concatenate([[0.0], np.cumsum(10.0 ** rng.uniform(-1.5, 1.0, k - 1))])
        mine = spline_trajectory([f"j{i}" for i in range(n)], points, times, ends)
        other = CubicSpline(times, points, bc_type=ends)
        # scipy: descending powers, (power, piece, joint).
        expected = np.moveaxis(other.c[::-1], 0, -1)
        scale = 1.0 + np.abs(expected).max(axis=(0, 1))
        assert (np.abs(mine.coefficients - expected) <= 1e-11 * scale).all()
        np.testing.assert_allclose(mine.sample(times), points, atol=1e-12)
        position, velocity, acceleration = mine.continuity()
        assert position < 1e-12
        assert velocity < 1e-11 * scale[1]
        assert acceleration < 1e-11 * scale[2]
        order = 2 if ends == "natural" else 1
        rest = mine.sample(times[[0, -1]], order)
        assert np.abs(rest).max() <= 1e-11 * scale[order]


def test_the_path_is_the_same_curve() -> None:
    rng = np.random.default_rng(2)
    points = rng.normal(size=(6, 4))
    knots = chord_knots(points)
    assert knots[-1] == pytest.approx(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    path = spline_path(points, knots + 5.0)
    trajectory = spline_trajectory(list("abcd"), points, knots)
    places = np.linspace(0.0, knots[-1], 50)
    np.testing.assert_allclose(path.sample(places), trajectory.sample(places), atol=1e-12)
    assert path.corners == ()


@pytest.mark.parametrize(
    ("points", "times", "match"),
    [
        ([[0.0]], [0.0], "at least two"),
        ([[0.0], [1.0]], [0.0], "2 waypoints with 1"),
        ([[0.0], [1.0]], [0.0, 0.0], "not after"),
        ([[0.0], [1.0], [2.0]], [0.0, 2.0, 1.0], "time 2"),
        ([[0.0], [1.0]], [1.0, 2.0], "start at 0"),
        ([[0.0], [np.nan]], [0.0, 1.0], "finite"),
        ([[0.0], [1.0]], [0.0, np.inf], "finite"),
        ([["a"], [1.0]], [0.0, 1.0], "numbers"),
        ([0.0, 1.0], [0.0, 1.0], "shape"),
    ],
)
def test_malformed_splines_are_refused(points: ArrayLike, times: ArrayLike, match: str) -> None:
    with pytest.raises(InvalidTrajectory) as caught:
        spline_trajectory(["a"], points, times)
    assert match in f"{caught.value.message} {caught.value.hint}"


def test_unknown_ends_and_repeated_waypoints_are_refused() -> None:
    with pytest.raises(InvalidOption, match="periodic"):
        spline_trajectory(["a"], [[0.0], [1.0]], [0.0, 1.0], "periodic")  # type: ignore[arg-type]
    with pytest.raises(InvalidTrajectory, match="waypoint 2 repeats waypoint 1"):
        chord_knots([[0.0], [1.0], [1.0]])
    with pytest.raises(InvalidTrajectory):
        chord_knots([0.0, 1.0])
