"""Minimum-time motion along paths: limits, optimality by scipy and toppra, odd paths, refusals."""

import itertools
import subprocess
import sys

import numpy as np
import pytest
import toppra
from numpy.polynomial import polynomial as power_basis
from scipy.optimize import linprog

from benchmarks.judges.ratios import worst_ratio
from kinematics.arrays import Array
from kinematics.errors import InvalidOption, InvalidTrajectory
from planning.timing.options import TOPPRA_SOLVERS, Solver, TimingFailed
from planning.timing.path.blend import blend, largest_reaches
from planning.timing.path.path import JointPath
from planning.timing.speed.constraints import Cells, cells
from planning.timing.speed.minimum_time import MAX_RESOLUTION, squared_speeds, time_path
from planning.timing.spline.spline import chord_knots, spline_path
from tests.planning.timing.timed_paths import (
    PANDA_ACCELERATION,
    PANDA_VELOCITY,
    names,
    package_duration,
    random_path,
    timed,
)


def test_limits_hold_on_hundreds_of_random_paths() -> None:
    rng = np.random.default_rng(0)
    reached, factors = [], []
    for _ in range(300):
        n = int(rng.integers(1, 21))
        v, a = 10.0 ** rng.uniform(-2, 2, n), 10.0 ** rng.uniform(-2, 3, n)
        path = random_path(rng, n, 10.0 ** rng.uniform(-3, 1))
        result = time_path(path, names(n), v, a)
        ratios = [worst_ratio(result.trajectory, limit, i) for i, limit in ((1, v), (2, a))]
        assert max(ratios) <= 1.0 + 1e-9
        reached.append(max(ratios))
        factors.append(result.factor)
        assert (result.trajectory.peaks(1).value <= v).all()
        assert (result.trajectory.peaks(2).value <= a).all()
    # Something is always at its limit, and no dilation was needed but for rounding.
    assert min(reached) > 1.0 - 1e-9
    assert max(factors) < 1.0 + 1e-9


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


def distance_to_path(path: JointPath, points: Array) -> Array:
    """Distance of each point from the nearest piece, by Newton's steps on each piece."""
    best = np.full(len(points), np.inf)
    for c, length in zip(path.coefficients, path.lengths, strict=True):
        u = np.linspace(0.0, length, 200)
        dense = power_basis.polyval(u, c.T).T
        places = u[np.linalg.norm(points[:, None] - dense, axis=2).argmin(axis=1)]
        for _ in range(15):
            q = power_basis.polyval(places, c.T).T
            tangent = power_basis.polyval(places, power_basis.polyder(c.T)).T
            steps = ((points - q) * tangent).sum(axis=1) / (tangent**2).sum(axis=1)
            places = np.clip(places + steps, 0.0, length)
        q = power_basis.polyval(places, c.T).T
        best = np.minimum(best, np.linalg.norm(points - q, axis=1))
    return best


@pytest.mark.parametrize("solver", TOPPRA_SOLVERS)
def test_the_path_is_followed_exactly_and_smoothly(solver: Solver) -> None:
    rng = np.random.default_rng(9)
    for _ in range(10):
        path = random_path(rng, 7)
        trajectory = timed(path, PANDA_VELOCITY, PANDA_ACCELERATION, solver)
        position, velocity, _ = trajectory.continuity()
        assert position <= 1e-12
        assert velocity <= 1e-12
        np.testing.assert_allclose(
            trajectory.sample([0.0, trajectory.duration], 1), 0.0, atol=1e-12
        )
        points = trajectory.sample(np.linspace(0.0, trajectory.duration, 500))
        assert distance_to_path(path, points).max() < 1e-12


@pytest.mark.parametrize("solver", TOPPRA_SOLVERS)
def test_splines_are_timed_without_changing_their_curve(solver: Solver) -> None:
    rng = np.random.default_rng(13)
    for kind in ("natural", "clamped"):
        points = rng.uniform(-2.0, 2.0, (7, 7))
        path = spline_path(points, chord_knots(points), kind)
        result = time_path(path, names(7), PANDA_VELOCITY, PANDA_ACCELERATION, solver=solver)
        trajectory = result.trajectory
        assert result.factor < 1.0 + (1e-6 if solver == "reachability" else 0.02)
        assert trajectory.degree == 6
        assert trajectory.continuity().velocity < 1e-12
        assert (trajectory.peaks(1).value <= PANDA_VELOCITY).all()
        assert (trajectory.peaks(2).value <= PANDA_ACCELERATION).all()
        np.testing.assert_allclose(
            trajectory.sample([0.0, trajectory.duration], 1), 0.0, atol=1e-12
        )
        inner = trajectory.sample(trajectory.breaks[1:-1])
        assert distance_to_path(path, inner).max() < 1e-12
        ends = trajectory.sample([0.0, trajectory.duration])
        np.testing.assert_allclose(ends, points[[0, -1]], atol=1e-13)
        other = package_duration(path, PANDA_VELOCITY, PANDA_ACCELERATION, 1000)
        # The package stops in s at the ends of a clamped spline, where q' = 0 is rest enough.
        if solver == "reachability" or kind == "natural":
            assert trajectory.duration <= 1.005 * other
        if solver == "reachability" and kind == "clamped":
            assert trajectory.duration < 0.999 * other


@pytest.mark.parametrize("solver", TOPPRA_SOLVERS)
@pytest.mark.parametrize("size", [1e-9, 1e-6, 1e-3, 1e3])
def test_the_scale_of_a_path_does_not_matter(solver: Solver, size: float) -> None:
    waypoints = np.random.default_rng(14).uniform(-1.0, 1.0, (5, 4))
    v, a = np.full(4, 2.0), np.full(4, 10.0)
    whole = timed(blend(waypoints, largest_reaches(waypoints)), v, a, solver)
    # All lengths by s, all times by s too: accelerations by 1 / s.
    small = blend(size * waypoints, largest_reaches(size * waypoints))
    scaled = timed(small, v, a / size, solver)
    assert scaled.duration == pytest.approx(size * whole.duration, rel=1e-6)
    assert (scaled.peaks(2).value <= a / size).all()


def test_a_crawl_between_stops_takes_its_time() -> None:
    # It takes 4 billionths of the way to get up to speed.
    trajectory = timed(blend([[-9.0], [3.0], [-3.0]], [0.0]), [1.5e-3], [300.0])
    # Breaks at 10^4 s are known to 10^-12 s: a ten-millionth of the 5 microseconds that a change
    # of speed takes, which the dilation then makes good.
    assert trajectory.duration == pytest.approx(18.0 / 1.5e-3 + 2 * 1.5e-3 / 300.0, rel=1e-6)
    assert trajectory.peaks(1).value[0] <= 1.5e-3
    assert trajectory.peaks(2).value[0] <= 300.0


def test_without_velocity_limits_the_acceleration_alone_decides() -> None:
    path = blend([[0.0, 0.0], [4.0, 1.0]], [])
    trajectory = timed(path, [np.inf, np.inf], [1.0, 10.0])
    assert trajectory.duration == pytest.approx(2.0 * np.sqrt(4.0), rel=1e-11)


@pytest.mark.parametrize("solver", TOPPRA_SOLVERS)
@pytest.mark.parametrize(
    ("v", "a", "match"),
    [
        ([1.0], [1.0, 1.0], "velocity"),
        ([1.0, 0.0], [1.0, 1.0], "velocity"),
        ([1.0, 1.0], [1.0, np.nan], "acceleration"),
        ([1.0, 1.0], [1.0, -1.0], "acceleration"),
        ([1.0, 1.0], [1.0, np.inf], "finite"),
    ],
)
def test_malformed_limits_are_refused(
    solver: Solver, v: list[float], a: list[float], match: str
) -> None:
    with pytest.raises(InvalidOption, match=match):
        timed(blend([[0.0, 0.0], [1.0, 1.0]], []), v, a, solver)


def test_malformed_options_are_refused() -> None:
    path = blend([[0.0], [1.0]], [])
    with pytest.raises(InvalidOption, match="no timing solver"):
        time_path(path, ["a"], [1.0], [1.0], solver="guess")  # type: ignore[arg-type]
    for resolution in (0, MAX_RESOLUTION + 1):
        with pytest.raises(InvalidOption, match="cells"):
            time_path(path, ["a"], [1.0], [1.0], resolution=resolution)
    with pytest.raises(InvalidTrajectory):
        time_path(path, ["a", "b"], [1.0], [1.0])


@pytest.mark.parametrize("solver", TOPPRA_SOLVERS)
def test_a_solver_that_fails_says_so_by_name(
    solver: Solver, caplog: pytest.LogCaptureFixture
) -> None:
    path = blend([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]], [0.3])
    # Accelerations over lengths that no double holds: no speed can be told.
    tiny = JointPath(path.coefficients, path.lengths * 1e-200)
    with pytest.raises(TimingFailed):
        timed(tiny, [1.0, 1.0], [1e-200, 1e-200], solver)
    assert not caplog.records


def test_exceptions_of_the_package_do_not_leak(monkeypatch: pytest.MonkeyPatch) -> None:
    path = blend([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]], [0.3])

    def broken(*_: object) -> None:
        raise toppra.exceptions.ToppraError("inside")

    monkeypatch.setattr(toppra.algorithm.TOPPRA, "compute_parameterization", broken)
    with pytest.raises(TimingFailed, match="ToppraError"):
        timed(path, [1.0, 1.0], [1.0, 1.0], "toppra")
    monkeypatch.setattr(
        toppra.algorithm.TOPPRA, "compute_parameterization", lambda *_: (None, None, None)
    )
    with pytest.raises(TimingFailed, match="no timing"):
        timed(path, [1.0, 1.0], [1.0, 1.0], "toppra")


def random_cells(rng: np.random.Generator) -> Cells:
    n = int(rng.integers(2, 8))
    waypoints = rng.uniform(-2.0, 2.0, (4, n))
    path = blend(waypoints, rng.choice([0.1, 0.6, 1.0], 2) * largest_reaches(waypoints))
    limits = 10.0 ** rng.uniform([[-0.5], [-0.5]], [[0.5], [1.0]], (2, n))
    return cells(path, int(rng.integers(10, 60)), limits)


@pytest.mark.parametrize("seed", range(12))
def test_speeds_solve_the_linear_programs(seed: int) -> None:
    grid = random_cells(np.random.default_rng(seed))
    count = len(grid.lengths)
    most = np.zeros(count + 1)
    for i in range(count - 1, 0, -1):
        rows = grid.rows[i]
        bounds = [(0.0, grid.caps[i]), (0.0, most[i + 1])]
        best = linprog([-1.0, 0.0], rows, np.ones(len(rows)), bounds=bounds)
        most[i] = float(np.asarray(best.x)[0])
    expected = np.zeros(count + 1)
    for i in range(count):
        rows = grid.rows[i]
        # A hair below, so that a single point left by rounding is found.
        here = expected[i] * (1.0 - 1e-9)
        bounds = [(here, here), (0.0, most[i + 1])]
        best = linprog([0.0, -1.0], rows, np.ones(len(rows)), bounds=bounds)
        expected[i + 1] = float(np.asarray(best.x)[1])
    np.testing.assert_allclose(squared_speeds(grid), expected, rtol=1e-5, atol=1e-9)


def test_toppra_is_loaded_without_what_draws() -> None:
    """And whoever draws afterwards has the real one."""
    program = (
        "import sys, planning.timing.speed.toppra\n"
        "assert not [name for name in sys.modules if name.startswith('matplotlib')]\n"
        "import matplotlib.pyplot\n"
        "assert callable(matplotlib.pyplot.figure)"
    )
    ran = subprocess.run([sys.executable, "-c", program], check=False, capture_output=True)
    assert ran.returncode == 0, ran.stderr
