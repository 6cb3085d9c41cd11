"""Minimum-time motion along given paths: limits, optimality, exactness, degenerate input."""

import itertools

import numpy as np
import pytest
from numpy.polynomial import polynomial as power_basis

from kinematics.trajectory.trajectory import Trajectory
from planning.timing.options import TOPPRA_SOLVERS, Solver
from planning.timing.path.blend import blend, largest_reaches
from planning.timing.speed import reachability
from planning.timing.speed.constraints import cells
from planning.timing.speed.minimum_time import RESOLUTION, time_path
from planning.timing.speed.profile import timed_pieces
from planning.timing.spline.spline import chord_knots, spline_path
from planning.timing.time_scaling import dilate
from tests.planning.timing import toppra_rows
from tests.planning.timing.timed_paths import (
    PANDA_ACCELERATION,
    PANDA_VELOCITY,
    Array,
    names,
    package_duration,
    random_path,
    timed,
)


def worst_ratio(trajectory: Trajectory, limits: Array, order: int) -> float:
    """Largest |derivative| over its limit by closed forms for quartic pieces and numpy alone."""
    c = trajectory.coefficients
    for _ in range(order):
        c = c[:, :, 1:] * np.arange(1, c.shape[2])
    h = np.broadcast_to(np.diff(trajectory.breaks)[:, None], c.shape[:2])
    slope = c[:, :, 1:] * np.arange(1, c.shape[2])
    places = [np.zeros_like(h), h]
    with np.errstate(all="ignore"):
        if slope.shape[2] == 2:
            places.append(-slope[:, :, 0] / slope[:, :, 1])
        else:
            constant, linear, square = np.moveaxis(slope, -1, 0)
            # The form of the quadratic's roots that does not cancel.
            root = -0.5 * (
                linear + np.copysign(np.sqrt(linear**2 - 4.0 * square * constant), linear)
            )
            places += [root / square, constant / root]
    worst = 0.0
    for place in places:
        t = np.clip(np.nan_to_num(place), 0.0, h)
        values = sum(c[:, :, k] * t**k for k in range(c.shape[2]))
        worst = max(worst, float((np.abs(values).max(axis=0) / limits).max()))
    return worst


def test_limits_hold_on_hundreds_of_random_paths() -> None:
    rng = np.random.default_rng(0)
    reached, factors = [], []
    for _ in range(300):
        n = int(rng.integers(1, 21))
        v, a = 10.0 ** rng.uniform(-2, 2, n), 10.0 ** rng.uniform(-2, 3, n)
        path = random_path(rng, n, 10.0 ** rng.uniform(-3, 1))
        result = time_path(path, names(n), v, a)
        ratios = [worst_ratio(result.trajectory, limit, i) for i, limit in ((1, v), (2, a))]
        assert max(ratios) <= 1.0 + 1e-13
        reached.append(max(ratios))
        factors.append(result.factor)
        assert (result.trajectory.peaks(1).value <= v).all()
        assert (result.trajectory.peaks(2).value <= a).all()
    # Something is always at its limit, and no dilation was needed but for rounding.
    assert min(reached) > 1.0 - 1e-9
    assert max(factors) < 1.0 + 1e-9


def test_the_independent_ratio_agrees_with_numpys_roots() -> None:
    path = random_path(np.random.default_rng(5), 3)
    trajectory = timed(path, np.ones(3), np.ones(3))
    for order in (1, 2):
        worst = 0.0
        for h, piece in zip(np.diff(trajectory.breaks), trajectory.coefficients, strict=True):
            for row in piece:
                c = power_basis.polyder(row, order)
                inner = np.trim_zeros(power_basis.polyder(c), "b")
                roots = power_basis.polyroots(inner) if len(inner) > 1 else np.zeros(0)
                places = np.clip([0.0, h, *np.real(roots)], 0.0, h)
                worst = max(worst, float(np.abs(power_basis.polyval(places, c)).max()))
        assert worst_ratio(trajectory, np.ones(3), order) == pytest.approx(worst, rel=1e-12)


@pytest.mark.parametrize("solver", TOPPRA_SOLVERS)
@pytest.mark.parametrize("n", [1, 2, 7, 20])
def test_straight_lines_take_the_bang_bang_time(solver: Solver, n: int) -> None:
    rng = np.random.default_rng(n)
    for _ in range(20):
        v, a = 10.0 ** rng.uniform(-1, 1, n), 10.0 ** rng.uniform(-1, 1.5, n)
        start, goal = rng.uniform(-3.0, 3.0, (2, n))
        travel = np.abs(goal - start)
        speed, rate = (v / travel).min(), (a / travel).min()
        expected = 2.0 / np.sqrt(rate) if speed**2 > rate else 1.0 / speed + speed / rate
        trajectory = timed(blend([start, goal], []), v, a, solver)
        if solver == "toppra":
            # Constant acceleration from grid point to grid point can't change over anywhere.
            assert expected * (1.0 - 1e-12) <= trajectory.duration <= 1.01 * expected
        else:
            assert trajectory.duration == pytest.approx(expected, rel=1e-11)
            assert trajectory.pieces == (2 if speed**2 > rate else 3)
        np.testing.assert_allclose(trajectory.start, start, atol=1e-15)
        np.testing.assert_allclose(trajectory.end, goal, atol=1e-14)


def test_sharp_corners_are_stops() -> None:
    rng = np.random.default_rng(3)
    waypoints = rng.uniform(-1.0, 1.0, (5, 3))
    v, a = np.array([1.0, 2.0, 3.0]), np.array([5.0, 4.0, 3.0])
    whole = timed(blend(waypoints, np.zeros(3)), v, a)
    legs = [timed(blend(pair, []), v, a).duration for pair in itertools.pairwise(waypoints)]
    assert whole.duration == pytest.approx(sum(legs), rel=1e-12)
    stops = whole.sample(np.cumsum(legs)[:-1], 0)
    np.testing.assert_allclose(stops, waypoints[1:-1], atol=1e-12)
    np.testing.assert_allclose(whole.sample(np.cumsum(legs)[:-1], 1), 0.0, atol=1e-9)


@pytest.mark.parametrize("part", [0.1, 0.5, 1.0])
def test_durations_are_those_of_the_toppra_package_or_less(part: float) -> None:
    rng = np.random.default_rng(int(part * 10))
    for _ in range(8):
        waypoints = rng.uniform(-2.0, 2.0, (5, 7))
        path = blend(waypoints, part * largest_reaches(waypoints))
        mine = timed(path, PANDA_VELOCITY, PANDA_ACCELERATION).duration
        other = package_duration(path, PANDA_VELOCITY, PANDA_ACCELERATION, 1000)
        assert mine <= 1.003 * other
        assert mine >= 0.97 * other


def test_the_package_finds_the_same_speeds_from_the_same_rows() -> None:
    rng = np.random.default_rng(8)
    for _ in range(40):
        n = int(rng.integers(1, 10))
        path = random_path(rng, n)
        v, a = 10.0 ** rng.uniform(-0.5, 0.5, n), 10.0 ** rng.uniform(-0.5, 1.0, n)
        limits = np.stack([v, a])
        grid = cells(path, RESOLUTION, limits)
        durations = []
        for solve in (reachability.squared_speeds, toppra_rows.squared_speeds):
            times, coefficients = timed_pieces(path, grid, solve(grid), limits)
            motion = Trajectory(names(n), np.append(0.0, np.cumsum(times)), coefficients)
            durations.append(dilate(motion, v, a).trajectory.duration)
        mine, other = durations
        # The package lowers its speeds on purpose, by up to 1e-4 of their squares.
        assert mine <= other * (1.0 + 1e-9)
        assert mine == pytest.approx(other, rel=2e-3)


def test_the_package_with_its_own_constraints_is_slowed_down_into_the_limits() -> None:
    rng = np.random.default_rng(8)
    factors, ratios = [], []
    for _ in range(40):
        n = int(rng.integers(1, 10))
        path = random_path(rng, n)
        v, a = 10.0 ** rng.uniform(-0.5, 0.5, n), 10.0 ** rng.uniform(-0.5, 1.0, n)
        scaled = time_path(path, names(n), v, a, solver="toppra")
        ratios += [worst_ratio(scaled.trajectory, limit, i) for i, limit in ((1, v), (2, a))]
        answered = scaled.trajectory.dilate(1.0 / scaled.factor)
        broken = max(worst_ratio(answered, v, 1), worst_ratio(answered, a, 2) ** 0.5)
        # Slowed down by what it breaks the limits by, and by no more.
        assert scaled.factor == pytest.approx(max(broken, 1.0), rel=1e-9)
        factors.append(scaled.factor)
        assert scaled.trajectory.duration >= (1.0 - 1e-3) * timed(path, v, a).duration
    assert max(ratios) <= 1.0 + 1e-13
    assert max(factors) > 1.0 + 1e-6


def test_the_package_meets_the_speeds_at_the_ends() -> None:
    rng = np.random.default_rng(21)
    slowed = 0
    for _ in range(10):
        points = rng.uniform(-1.0, 1.0, (6, 3))
        path = spline_path(points, chord_knots(points), "natural")
        scaled = time_path(
            path, names(3), np.ones(3), np.full(3, 4.0), solver="toppra", end_speeds=(0.2, 0.1)
        )
        motion = scaled.trajectory
        slowed += scaled.factor > 1.0 + 1e-6
        tangents = path.sample([0.0, path.breaks[-1]], 1)
        np.testing.assert_allclose(
            motion.sample([0.0, motion.duration], 1), [[0.2], [0.1]] * tangents, rtol=1e-8
        )
        assert (motion.peaks(1).value <= 1.0).all()
        assert (motion.peaks(2).value <= 4.0).all()
    assert slowed
