"""Timing of paths whose numbers are rounded: sampled arcs and lines, zigzags of rounding height."""

from typing import Any

import numpy as np
import pytest
import toppra
from numpy.polynomial import polynomial as power_basis
from scipy.spatial import cKDTree

from kinematics.arrays import Array
from kinematics.robots import builtin_chain
from kinematics.trajectory.trajectory import Trajectory
from planning.retiming.retime import PathToTime, Retimed, retime
from planning.timing.failure import TimingFailed
from planning.timing.options import TimingOptions

METHODS: tuple[dict[str, Any], ...] = (
    {"method": "toppra"},
    {"method": "jerk_limited"},
    {"method": "jerk_limited", "solver": "double_s"},
    {},
)


def limits(n: int, velocity: float = 1.5, acceleration: float = 6.0, jerk: float = 80.0) -> Any:
    values = (("velocity", velocity), ("acceleration", acceleration), ("jerk", jerk))
    return {name: np.full(n, value) for name, value in values}


def timed(points: Array, bounds: dict[str, Array] | None = None, **options: Any) -> Retimed:
    n = points.shape[1]
    names = tuple(f"joint_{i}" for i in range(n))
    return retime(PathToTime(names, points), TimingOptions(**options), bounds or limits(n))


def largest_jump(motion: Trajectory, order: int) -> float:
    """Largest jump of a derivative between pieces, by numpy's polynomials."""
    rows, h = motion.coefficients, np.diff(motion.breaks)
    jumps = [
        power_basis.polyval(h[i], power_basis.polyder(rows[i, j], order))
        - power_basis.polyval(0.0, power_basis.polyder(rows[i + 1, j], order))
        for i in range(len(rows) - 1)
        for j in range(motion.n)
    ]
    return float(np.abs(jumps).max(initial=0.0))


def arc(rng: np.random.Generator, count: int) -> Array:
    """Even samples of an arc in a random plane of joint space, shape (count, n)."""
    plane, _ = np.linalg.qr(rng.normal(size=(int(rng.integers(2, 8)), 2)))
    angles = np.linspace(0.0, rng.uniform(0.5, 6.0), count)
    circle = np.stack([np.cos(angles), np.sin(angles)])
    return np.asarray(rng.uniform(0.1, 0.5) * (plane @ circle).T)


def least_time(points: Array, bounds: dict[str, Array]) -> float:
    """Least time of the spline through points without a jerk limit, by the toppra package."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    knots = np.concatenate([[0.0], np.cumsum(steps)])
    path = toppra.SplineInterpolator(knots / knots[-1], points)
    constraints = [
        kind(np.column_stack([-bounds[name], bounds[name]]))
        for kind, name in (
            (toppra.constraint.JointVelocityConstraint, "velocity"),
            (toppra.constraint.JointAccelerationConstraint, "acceleration"),
        )
    ]
    solver = toppra.algorithm.TOPPRA(constraints, path, np.linspace(0.0, 1.0, 300))
    return float(solver.compute_trajectory(0.0, 0.0).duration)


@pytest.mark.parametrize("seed", range(30))
def test_zigzags_of_rounding_height_are_timed_without_a_jump(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = np.zeros((int(rng.integers(4, 20)), 2))
    points[:, 0] = np.arange(len(points)) * rng.uniform(0.05, 0.4)
    points[1::2, 1] = 10.0 ** rng.uniform(-9, -4)
    tolerance = float(rng.choice([1e-3, 1e-2, 5e-2]))
    for options in METHODS:
        found = timed(points, blend_tolerance=tolerance, **options)
        assert found.certificate.verified, options
        assert largest_jump(found.trajectory, 0) < 1e-9
        assert largest_jump(found.trajectory, 1) < 1e-9


@pytest.mark.parametrize("seed", range(20))
def test_evenly_sampled_arcs_are_timed(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = arc(rng, int(rng.integers(10, 60))).round(int(rng.choice([6, 9, 12])))
    bounds = limits(points.shape[1])
    for options in METHODS:
        found = timed(points, bounds, blend_tolerance=0.01, **options)
        assert found.certificate.verified, options
        if options.get("method") == "toppra":
            assert found.trajectory.duration < 1.25 * least_time(points, bounds)


def test_a_spline_that_leaves_a_range_is_refused_with_joint_and_waypoints() -> None:
    chain = builtin_chain("ur5e")
    points = np.tile([0.0, -1.4, 0.0, -1.0, 0.3, 0.1], (4, 1))
    points[:, 2] = [2.2, 3.1, 3.12, 2.0]
    path = PathToTime(chain.joint_names, points)
    for options in (
        {"method": "toppra", "interpolation": "natural_spline"},
        {"method": "spline", "interpolation": "natural_spline"},
    ):
        with pytest.raises(TimingFailed, match=r"'elbow_joint'.*between waypoints 2 and 3"):
            retime(path, TimingOptions(**options), {}, chain)  # type: ignore[arg-type]
    assert retime(path, TimingOptions(method="toppra"), {}, chain).certificate.verified


def test_no_factor_is_told_where_no_stretching_helps() -> None:
    chain = builtin_chain("ur5e")
    points = np.zeros((3, 6))
    points[1, 2], points[2, 2] = 3.1, 0.0
    path = PathToTime(chain.joint_names, points)
    for last, is_curable in ((3.1, True), (3.2, False)):
        points[1, 2] = last
        fast = retime(path, TimingOptions("spline", times=[0.0, 0.5, 1.0]), {}, chain)
        assert not fast.certificate.verified
        assert (fast.needed_factor is not None) is is_curable
        if fast.needed_factor is not None:
            times = [0.0, 0.5 * fast.needed_factor, fast.needed_factor]
            slow = retime(path, TimingOptions("spline", times=times), {}, chain)
            assert slow.certificate.verified
            assert slow.needed_factor == 1.0


@pytest.mark.parametrize("seed", range(20))
def test_lines_of_rounded_waypoints_take_what_the_line_takes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, decimals = int(rng.integers(2, 8)), int(rng.integers(3, 7))
    ends = rng.uniform(-1.0, 1.0, (2, n))
    shares = np.linspace(0.0, 1.0, int(rng.integers(10, 200)))[:, None]
    points = (ends[0] + shares * (ends[1] - ends[0])).round(decimals)
    for options in METHODS:
        for tolerance in (None, 5e-3):
            found = timed(points, blend_tolerance=tolerance, **options)
            assert found.certificate.verified
            straight = timed(points[[0, -1]], **options).trajectory.duration
            assert found.trajectory.duration == pytest.approx(straight, rel=1e-3)
            assert any("left out" in note for note in found.notes)


@pytest.mark.parametrize("options", METHODS)
def test_recorded_paths_take_what_few_waypoints_take(options: dict[str, Any]) -> None:
    rng = np.random.default_rng(4)
    middle, way, waves = rng.uniform(-1.0, 1.0, 6), rng.uniform(-1.0, 1.0, 6), rng.uniform(2, 8, 6)

    def path(count: int) -> Array:
        u = np.linspace(0.0, 1.0, count)[:, None]
        return np.asarray(middle + u * way + 0.2 * np.sin(u * waves))

    recorded = timed(path(3000).round(4), blend_tolerance=1e-3, **options)
    few = timed(path(40), blend_tolerance=1e-3, **options)
    assert recorded.certificate.verified
    assert recorded.trajectory.duration < 1.15 * few.trajectory.duration
    times = np.linspace(0.0, recorded.trajectory.duration, 2000)
    off, _ = cKDTree(path(50_000)).query(recorded.trajectory.sample(times))
    assert np.max(off) < 1e-3 + 1.3e-4  # a rounded point of six joints is up to 1.22e-4 off
    stopping = timed(path(3000).round(4), **options)
    assert stopping.certificate.verified
    assert stopping.trajectory.duration < 3.0 * few.trajectory.duration
    assert any("cut by at most" in note for note in stopping.notes)


@pytest.mark.parametrize("seed", range(30))
def test_splines_leave_out_nearly_repeated_waypoints(seed: int) -> None:
    rng = np.random.default_rng(seed)
    few = rng.uniform(-0.6, 0.6, (int(rng.integers(3, 8)), int(rng.integers(2, 8))))
    at = int(rng.integers(1, len(few) - 1))
    near = few[at] + 10.0 ** rng.uniform(-7, -4.5) * rng.normal(size=few.shape[1])
    points = np.insert(few, at + 1, near, axis=0)
    for options in (
        {"method": "toppra", "interpolation": "natural_spline"},
        {"method": "jerk_limited", "interpolation": "clamped_spline"},
        {"method": "spline", "interpolation": "natural_spline"},
    ):
        found, expected = timed(points, **options), timed(few, **options)  # type: ignore[arg-type]
        assert found.certificate.verified
        assert found.trajectory.duration == pytest.approx(expected.trajectory.duration, rel=1e-9)
        assert any(f"leaves out waypoint(s) {at + 1}, at most" in note for note in found.notes)


def test_the_optimum_on_a_grid_is_never_slower_than_closed_forms() -> None:
    rng = np.random.default_rng(6)
    solvers = set()
    for _ in range(40):
        n, k = int(rng.integers(2, 8)), int(rng.integers(5, 40))
        shares = np.linspace(0.0, 1.0, k)[:, None]
        points = shares * rng.uniform(-1, 1, n) + 10.0 ** rng.uniform(-4, -1) * rng.normal(
            size=(k, n)
        )
        bounds = limits(n, jerk=6.0 * 10.0 ** rng.uniform(0.3, 2.0))
        tolerance = float(rng.choice([1e-4, 1e-3, 1e-2]))
        options: dict[str, Any] = {"method": "jerk_limited", "blend_tolerance": tolerance}
        grid = timed(points, bounds, **options)
        closed = timed(points, bounds, solver="double_s", **options)
        assert grid.certificate.verified
        assert grid.trajectory.duration <= closed.trajectory.duration * (1.0 + 1e-12)
        assert grid.timing is not None
        solvers.add(grid.timing.solver)
    assert solvers == {"interior_point", "double_s"}


def test_another_solver_is_tried_where_one_finds_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    points = np.random.default_rng(1).uniform(-1.0, 1.0, (6, 3))

    def nothing(*_: Any, **__: Any) -> None:
        raise TimingFailed("none")

    monkeypatch.setattr("planning.timing.method.time_path_with_jerk", nothing)
    found = timed(points, method="jerk_limited", blend_tolerance=0.05)
    assert found.certificate.verified
    assert found.timing is not None
    assert found.timing.solver == "double_s"


@pytest.mark.parametrize(("method", "count"), [("toppra", 60), ("jerk_limited", 8)])
def test_velocities_at_the_ends_keep_to_the_legs_there(method: str, count: int) -> None:
    rng = np.random.default_rng(2)
    for _ in range(10):
        points = arc(rng, count).round(6)
        legs = np.diff(points, axis=0)[[0, -1]]
        speeds = 0.05 * legs / np.linalg.norm(legs, axis=1)[:, None]
        found = timed(
            points, blend_tolerance=0.01, method=method,
            start_velocity=speeds[0].tolist(), end_velocity=speeds[1].tolist(),
        )  # fmt: skip
        assert found.certificate.verified
        ends = found.trajectory.sample([0.0, found.trajectory.duration], 1)
        np.testing.assert_allclose(ends, speeds, atol=1e-9)
