"""Splines at given times: without limits, from any first time, with their velocities told."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from kinematics.errors import InvalidOption, InvalidTrajectory, MissingLimit
from kinematics.robots import builtin_chain
from planning.retiming.retime import PathToTime, retime
from planning.timing.options import TimingOptions

POINTS = np.array([[0.0, 0.0], [1.0, 0.2], [1.2, 1.0], [0.3, 1.4]])
TIMES = [5.0, 5.5, 6.25, 7.0]
PATH = PathToTime(("a", "b"), POINTS)


def test_given_times_need_no_limits_and_the_peaks_are_reported() -> None:
    timed = retime(PATH, TimingOptions("spline", times=TIMES), {})
    expected = CubicSpline(TIMES, POINTS, bc_type="natural")
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
    timed = retime(PathToTime(("a", "b"), POINTS, np.array(TIMES)), TimingOptions("spline"), {})
    assert (timed.begins, timed.trajectory.duration) == (5.0, 2.0)
    both = PathToTime(("a", "b"), POINTS, np.array(TIMES))
    with pytest.raises(InvalidOption, match="both"):
        retime(both, TimingOptions("spline", times=TIMES), {})
    with pytest.raises(InvalidTrajectory, match="4 waypoints with 3 times"):
        retime(PATH, TimingOptions("spline", times=TIMES[:3]), {})


def test_a_natural_spline_tells_its_velocities_at_the_ends() -> None:
    timing = TimingOptions("spline", times=TIMES)
    start, end = CubicSpline(TIMES, POINTS, bc_type="natural")([5.0, 7.0], 1)
    notes = retime(PATH, timing, {}).notes
    assert f"begins with velocity [{start[0]:.6g}, {start[1]:.6g}]" in notes[0]
    assert f"ends with [{end[0]:.6g}, {end[1]:.6g}]" in notes[0]
    clamped = TimingOptions("spline", times=TIMES, interpolation="clamped_spline")
    assert not any("natural" in note for note in retime(PATH, clamped, {}).notes)


def test_a_robot_is_timed_from_a_negative_time_on() -> None:
    chain = builtin_chain("planar_rr")
    path = PathToTime(chain.joint_names, POINTS[:2])
    timed = retime(path, TimingOptions("spline", times=[-1.0, 9.0]), {}, chain)
    assert timed.begins == -1.0
    assert timed.certificate.verified
