"""Splines at given times: without limits, from any first time, with their velocities told."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from kinematics.errors import InvalidOption, InvalidTrajectory, MissingLimit
from kinematics.robots import builtin_chain
from planning.retiming.retime import PathToTime, retime
from planning.retiming.state_motion import time_states
from planning.timing.jerk.state_to_state import JointState
from planning.timing.options import TimingOptions

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


def test_a_limit_that_is_missing_is_named() -> None:
    states = JointState(np.zeros(2)), JointState(np.ones(2))
    without = {name: LIMITS[name] for name in ("velocity", "acceleration")}
    with pytest.raises(MissingLimit, match="no jerk limit is known"):
        time_states("ab", states, TIMING, without)


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
