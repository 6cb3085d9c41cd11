"""Time parametrizations: boundary velocities, stops or curves, splines at given times."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from planning.timing.method import timing_method
from planning.timing.options import Method
from planning.timing.parametrization import TimeParametrization, merge_repeated
from planning.timing.path.blend import blend, largest_reaches

NAMES = ("a", "b")
V, A, J = np.array([1.0, 2.0]), np.array([4.0, 3.0]), np.array([40.0, 50.0])
WAYPOINTS = np.array([[0.0, 0.0], [1.0, 0.2], [1.2, 1.0], [0.3, 1.4]])


def of(
    name: Method, start_velocity: Array | None = None, end_velocity: Array | None = None
) -> TimeParametrization:
    method = timing_method(name)
    jerk = J if method.smooth else None
    return TimeParametrization(method, V, A, jerk, None, start_velocity, end_velocity)


@pytest.mark.parametrize("method", ["toppra", "jerk_limited"])
def test_boundary_velocities_along_the_path_are_met(method: Method) -> None:
    path = blend([[0.0, 0.0], [3.0, 1.5]], [])
    tangent = np.array([2.0, 1.0]) / np.sqrt(5.0)
    start, end = 0.3 * tangent, 0.4 * tangent
    motion = of(method, start_velocity=start, end_velocity=end).time(path, NAMES).trajectory
    rates = motion.sample([0.0, motion.duration], 1)
    np.testing.assert_allclose(rates, [start, end], atol=1e-9)
    assert (motion.peaks(1).value <= V).all()
    assert (motion.peaks(2).value <= A).all()
    for wrong in (-start, np.array([0.1, -0.2]), np.array([np.inf, 0.0])):
        with pytest.raises(InvalidOption, match="start_velocity"):
            of(method, start_velocity=wrong).time(path, NAMES)


def test_corners_are_stops_where_a_narrow_curve_takes_longer() -> None:
    parametrization = of("jerk_limited")
    none = np.zeros(2)
    stops = parametrization.time_polyline(WAYPOINTS, none, NAMES).trajectory.duration
    for share in (1e-4, 1.0):
        reaches = share * largest_reaches(WAYPOINTS)
        rounded = parametrization.time(blend(WAYPOINTS, reaches, smooth=True), NAMES)
        timed = parametrization.time_polyline(WAYPOINTS, reaches, NAMES)
        assert timed.trajectory.duration == min(stops, rounded.trajectory.duration)


def test_splines_of_time_are_scipys_and_are_stretched_on_request_only() -> None:
    times = np.array([0.0, 0.3, 0.6, 1.0])
    spline = of("spline")
    given = spline.time_spline(WAYPOINTS, times, "natural", NAMES)
    dense = np.linspace(0.0, 1.0, 200)
    expected = CubicSpline(times, WAYPOINTS, bc_type="natural")
    np.testing.assert_allclose(given.trajectory.sample(dense), expected(dense), atol=1e-12)
    assert given.factor == 1.0
    exact = np.linspace(0.0, 1.0, 200_001)
    ratios = (
        np.abs(expected(exact, 1) / V).max(),
        np.sqrt(np.abs(expected(exact, 2) / A).max()),
    )
    scaled = spline.time_spline(WAYPOINTS, times, "natural", NAMES, scale=True)
    assert scaled.factor == pytest.approx(max(ratios), rel=1e-6)
    assert spline.needed_factor(given.trajectory) == pytest.approx(scaled.factor, rel=1e-9)
    free = spline.time_spline(WAYPOINTS, None, "natural", NAMES).trajectory
    used = max((free.peaks(1).value / V).max(), (free.peaks(2).value / A).max())
    assert used == pytest.approx(1.0, abs=1e-9)


def test_boundary_velocities_of_splines_need_clamped_ends_and_times() -> None:
    spline = of("spline", start_velocity=np.array([0.1, 0.2]))
    times = np.arange(4.0)
    motion = spline.time_spline(WAYPOINTS, times, "clamped", NAMES).trajectory
    np.testing.assert_allclose(motion.sample([0.0, 3.0], 1), [[0.1, 0.2], [0.0, 0.0]], atol=1e-12)
    for given, ends, scale in (
        (times, "natural", False),
        (times, "clamped", True),
        (None, "clamped", False),
    ):
        with pytest.raises(InvalidOption, match="boundary velocities of a spline"):
            spline.time_spline(WAYPOINTS, given, ends, NAMES, scale)  # type: ignore[arg-type]


def test_repeated_waypoints_are_merged_and_collinear_ones_stay() -> None:
    points = [[0.0, 0.0], [0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [2.0, 2.0]]
    np.testing.assert_array_equal(merge_repeated(points), [[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]])
