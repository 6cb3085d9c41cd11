"""Cubic splines against scipy's, and what is refused."""

import numpy as np
import pytest
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from kinematics.errors import InvalidOption, InvalidTrajectory
from planning.timing.spline.spline import Ends, chord_knots, spline_path, spline_trajectory


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
