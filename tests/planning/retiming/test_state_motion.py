"""Timed motions between two states: certificate, notes and refusals."""

import numpy as np
import pytest

from kinematics.errors import InvalidOption, InvalidTrajectory, MissingLimit
from kinematics.robots import builtin_chain
from planning.retiming.state_motion import time_states
from planning.timing.jerk.state_to_state import JointState
from planning.timing.options import TimingOptions

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
