"""Timing at given times, between states, and of paths whose numbers are rounded."""

from typing import Any

import numpy as np
import pytest
import toppra
from numpy.polynomial import polynomial as power_basis
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from benchmarks.judges.least_time import stops
from kinematics.arrays import Array
from kinematics.errors import InvalidOption, InvalidTrajectory, MissingLimit
from kinematics.robots import builtin_chain
from kinematics.trajectory.trajectory import Trajectory
from planning.retiming.retime import retime
from planning.retiming.retimed import PathToTime, Retimed
from planning.retiming.state_motion import time_states
from planning.timing.jerk.state_to_state import JointState
from planning.timing.options import TimingFailed, TimingOptions

FOUR = np.array([[0.0, 0.0], [1.0, 0.2], [1.2, 1.0], [0.3, 1.4]])
TIMES = [5.0, 5.5, 6.25, 7.0]
PATH = PathToTime(("a", "b"), FOUR)


def test_given_times_need_no_limits_and_the_peaks_are_reported() -> None:
    timed = retime(PATH, TimingOptions("spline", times=TIMES), {})
    expected = CubicSpline(TIMES, FOUR, bc_type="natural")
    dense = np.linspace(0.0, 2.0, 2001)
    np.testing.assert_allclose(timed.trajectory.sample(dense), expected(5.0 + dense), atol=1e-12)
    assert timed.begins == 5.0
    for order, name in ((1, "velocity"), (2, "acceleration"), (3, "jerk")):
        largest = np.abs(expected(5.0 + dense, order)).max(axis=0)
        np.testing.assert_allclose(timed.peaks[name], largest, rtol=1e-6)
    certificate = timed.certificate
    assert not certificate.verified
    assert certificate.violation is None
    assert not certificate.proved.limits
    assert any("no limits of velocity and acceleration" in r for r in certificate.proved.reasons)
    assert timed.factor == timed.needed_factor == 1.0


def test_the_limits_that_are_known_are_proved_and_the_others_noted() -> None:
    timing = TimingOptions("spline", times=TIMES)
    timed = retime(PATH, timing, {"velocity": np.full(2, 100.0)})
    assert timed.certificate.verified
    assert set(timed.certificate.limits) == {"velocity"}
    assert timed.notes[-1].startswith("No limits of acceleration are known")
    slow = retime(PATH, timing, {"velocity": np.full(2, 0.5)})
    assert not slow.certificate.verified
    assert slow.certificate.violation is not None
    assert slow.certificate.violation.kind == "velocity"


def test_times_that_are_to_be_scaled_need_limits() -> None:
    with pytest.raises(MissingLimit, match="no velocity limit"):
        retime(PATH, TimingOptions("spline", times=TIMES, scale_times=True), {})
    with pytest.raises(MissingLimit, match="no velocity limit"):
        retime(PATH, TimingOptions("spline"), {})


def test_knots_of_the_method_spline_are_times_too() -> None:
    timed = retime(PathToTime(("a", "b"), FOUR, np.array(TIMES)), TimingOptions("spline"), {})
    assert (timed.begins, timed.trajectory.duration) == (5.0, 2.0)
    both = PathToTime(("a", "b"), FOUR, np.array(TIMES))
    with pytest.raises(InvalidOption, match="both"):
        retime(both, TimingOptions("spline", times=TIMES), {})
    with pytest.raises(InvalidTrajectory, match="4 waypoints with 3 times"):
        retime(PATH, TimingOptions("spline", times=TIMES[:3]), {})


def test_a_natural_spline_tells_its_velocities_at_the_ends() -> None:
    timing = TimingOptions("spline", times=TIMES)
    start, end = CubicSpline(TIMES, FOUR, bc_type="natural")([5.0, 7.0], 1)
    notes = retime(PATH, timing, {}).notes
    assert f"begins with velocity [{start[0]:.6g}, {start[1]:.6g}]" in notes[0]
    assert f"ends with [{end[0]:.6g}, {end[1]:.6g}]" in notes[0]
    clamped = TimingOptions("spline", times=TIMES, interpolation="clamped_spline")
    assert not any("natural" in note for note in retime(PATH, clamped, {}).notes)


def test_a_robot_is_timed_from_a_negative_time_on() -> None:
    chain = builtin_chain("planar_rr")
    path = PathToTime(chain.joint_names, FOUR[:2])
    timed = retime(path, TimingOptions("spline", times=[-1.0, 9.0]), {}, chain)
    assert timed.begins == -1.0
    assert timed.certificate.verified


PANDA = builtin_chain("panda")
HOME = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
TIMING = TimingOptions("jerk_limited")
LIMITS = {name: np.full(2, value) for name, value in
          (("velocity", 1.0), ("acceleration", 4.0), ("jerk", 40.0))}  # fmt: skip


def test_the_motion_of_a_robot_is_certified_within_its_limits() -> None:
    end = JointState(HOME + 0.1, np.full(7, 0.1))
    timed = time_states(PANDA.joint_names, (JointState(HOME), end), TIMING, {}, PANDA)
    assert timed.certificate.verified
    assert set(timed.certificate.limits) == {"position", "velocity", "acceleration", "jerk"}
    assert timed.certificate.limits["jerk"].worst_ratio == pytest.approx(1.0, rel=1e-6)


def test_shares_of_the_limits_are_kept() -> None:
    states = JointState(HOME), JointState(HOME + 0.1)
    slow = TimingOptions("jerk_limited", velocity_scaling=0.05)
    timed = time_states(PANDA.joint_names, states, slow, {}, PANDA)
    ratios = timed.trajectory.peaks(1).value / PANDA.limits.velocity
    assert ratios.max() == pytest.approx(0.05, rel=1e-8)


def test_a_motion_that_overshoots_a_stop_is_not_verified() -> None:
    edge = HOME.copy()
    edge[0] = PANDA.limits.upper[0] - 1e-3
    start = JointState(edge, np.eye(7)[0])
    timed = time_states(PANDA.joint_names, (start, JointState(HOME)), TIMING, {}, PANDA)
    assert not timed.certificate.verified
    assert timed.certificate.violation is not None
    assert timed.certificate.violation.kind == "position"


def test_a_state_outside_the_stops_is_refused() -> None:
    out = HOME.copy()
    out[0] = 3.0
    with pytest.raises(InvalidTrajectory, match="to: joint 'panda_joint1' is at 3"):
        time_states(PANDA.joint_names, (JointState(HOME), JointState(out)), TIMING, {}, PANDA)


def test_a_note_says_where_no_straight_line_is_possible() -> None:
    bent = JointState(np.zeros(2), np.array([0.5, 0.0])), JointState(np.ones(2))
    assert "no straight line" in time_states("ab", bent, TIMING, LIMITS).notes[0]
    straight = JointState(np.zeros(2)), JointState(np.ones(2))
    assert time_states("ab", straight, TIMING, LIMITS).notes == ()
    assert time_states("ab", bent, TIMING, LIMITS, None, "time").notes == ()


@pytest.mark.parametrize("joint", range(7))
def test_a_measured_state_hardly_outside_its_limits_is_moved_onto_them(joint: int) -> None:
    position, velocity = HOME.copy(), np.zeros(7)
    position[joint] = PANDA.limits.upper[joint] * (1.0 + np.sign(PANDA.limits.upper[joint]) * 1e-4)
    velocity[joint] = -1.0001 * PANDA.limits.velocity[joint]
    states = JointState(position, velocity), JointState(HOME)
    timed = time_states(PANDA.joint_names, states, TIMING, {}, PANDA)
    assert timed.certificate.verified
    assert timed.trajectory.start[joint] == PANDA.limits.upper[joint]
    assert "position of from was outside" in timed.notes[0]
    assert "velocity of from was outside" in timed.notes[1]
    for wrong in (
        JointState(position + 1e-2 * np.eye(7)[joint]),
        JointState(HOME, 1.01 * velocity),
    ):
        with pytest.raises((InvalidTrajectory, InvalidOption)):
            time_states(PANDA.joint_names, (wrong, JointState(HOME)), TIMING, {}, PANDA)


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
    assert any("cut by at most" in note or "smooth curve" in note for note in stopping.notes)


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


def test_one_method_times_paths_whatever_its_solver_is_called_and_beats_stops() -> None:
    rng = np.random.default_rng(6)
    beaten = 0
    for _ in range(40):
        n, k = int(rng.integers(2, 8)), int(rng.integers(5, 40))
        shares = np.linspace(0.0, 1.0, k)[:, None]
        points = shares * rng.uniform(-1, 1, n) + 10.0 ** rng.uniform(-4, -1) * rng.normal(
            size=(k, n)
        )
        bounds = limits(n, jerk=6.0 * 10.0 ** rng.uniform(0.3, 2.0))
        tolerance = float(rng.choice([1e-4, 1e-3, 1e-2]))
        options: dict[str, Any] = {"method": "jerk_limited", "blend_tolerance": tolerance}
        usual = timed(points, bounds, **options)
        named = timed(points, bounds, solver="double_s", **options)
        assert usual.certificate.verified
        np.testing.assert_array_equal(named.trajectory.coefficients, usual.trajectory.coefficients)
        assert usual.timing is not None
        assert usual.timing.solver == "interior_point"
        stopping = stops(points, tuple(bounds.values()))
        assert usual.trajectory.duration <= stopping * (1.0 + 1e-9)
        beaten += usual.trajectory.duration < 0.9 * stopping
    assert beaten > 30


def test_a_motion_with_stops_is_taken_where_none_is_found_on_curves(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    points = np.random.default_rng(1).uniform(-1.0, 1.0, (6, 3))

    def nothing(*_: Any, **__: Any) -> None:
        raise TimingFailed("none")

    monkeypatch.setattr("planning.timing.jerk.jerk_limited._curved_phases", nothing)
    found = timed(points, method="jerk_limited", blend_tolerance=0.05)
    assert found.certificate.verified
    assert found.trajectory.duration == pytest.approx(stops(points, tuple(limits(3).values())))


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
