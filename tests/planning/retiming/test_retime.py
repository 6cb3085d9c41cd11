"""Timing of given paths: what comes out, what is told, what is refused."""

import re
from typing import Any

import numpy as np
import pytest
import toppra
from scipy.interpolate import CubicSpline

import armwright as aw
from benchmarks.judges.ratios import worst_ratio
from kinematics.arrays import Array
from kinematics.errors import InvalidTrajectory
from kinematics.robots import builtin_chain
from planning.retiming.retime import retime
from planning.retiming.retimed import PathToTime, Retimed
from planning.timing.options import Payload, TimingFailed, TimingOptions

NAMES = ("a", "b", "c")
POINTS = np.random.default_rng(0).uniform(-1.0, 1.0, (6, 3))
ORDERS = ((1, "velocity"), (2, "acceleration"))
LIMITS = {"velocity": np.ones(3), "acceleration": np.full(3, 4.0), "jerk": np.full(3, 30.0)}


def timed(points: Array = POINTS, knots: Array | None = None, **options: Any) -> Retimed:
    return retime(PathToTime(NAMES, points, knots), TimingOptions(**options), LIMITS)


@pytest.mark.parametrize("interpolation", ["linear", "natural_spline", "clamped_spline"])
@pytest.mark.parametrize("method", ["toppra", "jerk_limited"])
def test_limits_are_certified(method: str, interpolation: str) -> None:
    tolerance = 0.05 if interpolation == "linear" else None
    found = timed(method=method, interpolation=interpolation, blend_tolerance=tolerance)
    assert found.certificate.verified
    assert found.needed_factor == found.factor == 1.0
    assert "position" not in found.certificate.limits
    orders = ("velocity", "acceleration", "jerk")[: 3 if method == "jerk_limited" else 2]
    for order, name in enumerate(orders, 1):
        ratio = worst_ratio(found.trajectory, LIMITS[name], order)
        assert ratio <= 1.0 + 1e-9
        assert found.certificate.limits[name].worst_ratio == pytest.approx(ratio, rel=1e-9)
    np.testing.assert_allclose(found.trajectory.end, POINTS[-1], atol=1e-12)


def test_splines_are_timed_as_asked_or_stretched_by_the_least_factor() -> None:
    times = np.array([0.0, 1.0, 1.5, 2.5, 3.0, 4.0])
    told = timed(method="spline", times=times.tolist())
    expected = CubicSpline(times, POINTS, bc_type="natural")
    dense = np.linspace(0.0, 4.0, 300)
    np.testing.assert_allclose(told.trajectory.sample(dense), expected(dense), atol=1e-12)
    assert not told.certificate.verified
    assert told.needed_factor is not None
    assert told.needed_factor > 1.0
    scaled = timed(method="spline", times=times.tolist(), scale_times=True)
    assert scaled.certificate.verified
    assert scaled.factor == pytest.approx(told.needed_factor, rel=1e-9)
    # The least: something is at its limit.
    used = max(report.worst_ratio for report in scaled.certificate.limits.values())
    assert used == pytest.approx(1.0, abs=1e-9)
    slow = timed(method="spline", times=(10.0 * times).tolist(), scale_times=True)
    assert slow.factor == 1.0
    by_knots = timed(knots=times, method="spline")
    assert by_knots.trajectory == told.trajectory


def test_clamped_splines_take_boundary_velocities() -> None:
    times = np.arange(6) * 5.0
    start, end = np.array([0.1, -0.2, 0.0]), np.array([0.0, 0.1, 0.1])
    found = timed(
        method="spline", times=times.tolist(), interpolation="clamped_spline",
        start_velocity=start.tolist(), end_velocity=end.tolist(),
    )  # fmt: skip
    expected = CubicSpline(times, POINTS, bc_type=((1, start), (1, end)))
    dense = np.linspace(0.0, 25.0, 300)
    np.testing.assert_allclose(found.trajectory.sample(dense), expected(dense), atol=1e-12)
    np.testing.assert_array_equal(found.trajectory.sample([0.0], 1)[0], start)


@pytest.mark.parametrize("interpolation", ["linear", "natural_spline", "clamped_spline"])
def test_the_toppra_package_is_run_and_its_slowing_down_told(
    monkeypatch: pytest.MonkeyPatch, interpolation: str
) -> None:
    calls = []
    solve = toppra.algorithm.TOPPRA.compute_parameterization

    def counted(self: Any, *args: Any, **more: Any) -> Any:
        calls.append(args)
        return solve(self, *args, **more)

    monkeypatch.setattr(toppra.algorithm.TOPPRA, "compute_parameterization", counted)
    options: dict[str, Any] = {"method": "toppra", "interpolation": interpolation}
    if interpolation == "linear":
        options["blend_tolerance"] = 0.05
    ours = timed(**options)
    assert not calls
    package = timed(**options, solver="toppra")
    assert calls
    assert package.certificate.verified
    for order, name in enumerate(("velocity", "acceleration"), 1):
        assert worst_ratio(package.trajectory, LIMITS[name], order) <= 1.0 + 1e-9
    assert package.trajectory != ours.trajectory
    assert package.trajectory.duration == pytest.approx(ours.trajectory.duration, rel=0.05)
    (note,) = [note for note in package.notes if "toppra's answer" in note]
    assert not any("toppra's answer" in note for note in ours.notes)
    told = re.search(r"slowed down by (\S+) % \((\S+) s\)", note)
    assert told is not None
    seconds = float(told.group(2))
    answered = package.trajectory.dilate(1.0 - seconds / package.trajectory.duration)
    broken = max(worst_ratio(answered, LIMITS[name], k) ** (1 / k) for k, name in ORDERS)
    assert broken > 1.0
    # Both are told with three digits.
    assert broken - 1.0 == pytest.approx(float(told.group(1)) / 100.0, rel=1e-2)


def test_the_toppra_package_keeps_boundary_velocities() -> None:
    rise = CubicSpline(np.arange(6.0), POINTS, bc_type="natural")(0.0, 1) * 0.1
    knots = np.arange(6.0)
    found = timed(knots=knots, interpolation="natural_spline", solver="toppra", start_velocity=rise)
    assert found.certificate.verified
    np.testing.assert_allclose(found.trajectory.sample([0.0], 1)[0], rise, rtol=1e-8)


def test_what_the_toppra_package_cannot_time_is_a_failure_with_a_hint() -> None:
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (6, 3))
    points[3] = points[2] + 1e-10
    assert timed(points, blend_tolerance=0.1).certificate.verified
    assert timed(points, blend_tolerance=0.1, solver="toppra").certificate.verified
    far = {"velocity": np.full(3, 1e-300), "acceleration": np.full(3, 1e300)}
    with pytest.raises(TimingFailed, match=r"toppra.*out of range") as failure:
        retime(PathToTime(NAMES, POINTS), TimingOptions(solver="toppra"), far)
    assert failure.value.hint is not None
    assert "timing.solver" in failure.value.hint


def test_odd_paths() -> None:
    for points in (POINTS[:1], np.repeat(POINTS[:1], 4, axis=0)):
        still = timed(points)
        assert still.certificate.verified
        assert "no length" in still.notes[0]
    for method in ("toppra", "jerk_limited"):
        twice = timed(np.repeat(POINTS, 2, axis=0), method=method, blend_tolerance=0.1)
        assert "Waypoint 3 repeats waypoint 2." in twice.notes
        once = timed(method=method, blend_tolerance=0.1)
        assert twice.trajectory.duration == pytest.approx(once.trajectory.duration, rel=1e-9)
        back = timed(POINTS[[0, 1, 0, 2]], method=method, blend_tolerance=0.1)
        assert "The motion stops at waypoint(s) 1." in back.notes
        tiny = timed(1e-10 * POINTS, method=method, blend_tolerance=0.1)
        assert tiny.certificate.verified
        assert any("is only" in note for note in tiny.notes)
    twice = timed(np.repeat(POINTS, 2, axis=0), interpolation="natural_spline")
    once = timed(interpolation="natural_spline")
    assert twice.trajectory.duration == pytest.approx(once.trajectory.duration, rel=1e-9)
    with pytest.raises(InvalidTrajectory, match=r"time 1 .* is not after time 0"):
        timed(interpolation="natural_spline", knots=np.array([0.0, 0.0, 1.0, 2.0, 3.0, 4.0]))


def test_torques_payload_and_tool_speed_of_a_robot() -> None:
    chain = builtin_chain("panda")
    rng = np.random.default_rng(1)
    points = rng.uniform(-0.5, 0.5, (5, 7)) + np.array([0.0, 0.0, 0.0, -1.5, 0.0, 1.5, 0.0])
    path = PathToTime(chain.joint_names, points)
    ways: tuple[dict[str, Any], ...] = (
        {"method": "toppra"},
        {"method": "jerk_limited"},
        {"solver": "toppra"},
    )
    for how in ways:
        options = TimingOptions(
            **how, blend_tolerance=0.1, torque_limits=True,
            payload=Payload(3.0, (0.0, 0.0, 0.1)), tool_speed=0.5,
        )  # fmt: skip
        found = retime(path, options, {}, chain)
        assert found.certificate.verified
        for name in ("position", "torque", "tool_speed"):
            assert found.certificate.limits[name].worst_ratio <= 1.0 + 1e-9
        assert found.certificate.limits["tool_speed"].worst_ratio > 0.98
    outside = PathToTime(chain.joint_names, np.array([points[0], points[0] + 3.0]))
    with pytest.raises(TimingFailed, match=r"limit.*, between waypoints 0 and 1") as failure:
        retime(outside, TimingOptions(), {}, chain)
    assert failure.value.details["joint"] in chain.joint_names
    assert failure.value.hint == "Give waypoints within the joint's limits."


def test_stops_are_named_by_their_place_on_the_path() -> None:
    """A path that returns to its start was said to stop at waypoint 0 on its way."""
    limits = {"velocity": np.ones(2), "acceleration": np.full(2, 2.0)}
    random = np.random.default_rng(3)
    back = np.array([[0.0, 0.0], [0.0, 0.1], [0.0, 0.0], [0.1, 0.0], [0.0, 0.0]])
    corners = np.array([[0.0, 0.0], [0.1, 0.0], [0.0, 0.1], [0.1, 0.1]])
    paths = [back, *(corners[random.integers(0, 4, 8)] for _ in range(30))]
    for points in paths:
        if not np.ptp(points, axis=0).any():
            continue
        found = retime(PathToTime(("a", "b"), points), TimingOptions(), limits)
        # Where the motion stands still, in turn: its waypoints, those that repeat left out.
        still = found.trajectory.breaks[
            np.abs(found.trajectory.sample(found.trajectory.breaks, 1)).max(axis=1) < 1e-6
        ]
        places = found.trajectory.sample(still)
        notes = [note for note in found.notes if note.startswith("The motion stops at")]
        named = [int(word) for word in re.findall(r"\d+", notes[0])] if notes else []
        assert named == sorted(set(named))
        assert all(0 < k < len(points) - 1 for k in named)
        np.testing.assert_allclose(points[named].reshape(-1, 2), places[1:-1], atol=1e-9)
    assert (
        "The motion stops at waypoint(s) 1, 2, 3."
        in retime(PathToTime(("a", "b"), back), TimingOptions(), limits).notes
    )


def test_a_tolerance_within_rounding_is_refused_as_one() -> None:
    u = np.linspace(0.0, 1.0, 600)[:, None]
    noise = np.random.default_rng(0).normal(size=(600, 1))
    path = 0.7 + 1e-9 * u * np.cos(40.0 * u) + 1e-12 * noise
    limits = {"velocity": [1.0], "acceleration": [5.0], "jerk": [100.0]}
    with pytest.raises(TimingFailed, match="farther than 1e-14") as refused:
        aw.retime(path, limits=limits, tolerance=1e-14)
    assert refused.value.hint is not None
    assert "larger path.tolerance" in refused.value.hint
