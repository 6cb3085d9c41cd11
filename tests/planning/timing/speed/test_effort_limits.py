"""Rows of torque and tool speed on paths against pinocchio's dynamics; slowing down."""

import numpy as np
import pytest

from dynamics.model.payload import with_motors
from kinematics.arrays import Array
from kinematics.robots import builtin_chain
from kinematics.trajectory.trajectory import Trajectory
from planning.timing.options import TimingFailed
from planning.timing.speed.effort_limits import knot_limits, slow_down
from planning.timing.time_scaling import ScaledTime
from planning.values.limits import EffortLimits
from tests.planning.pinocchio_arm import PinocchioArm

CHAIN = builtin_chain("panda")
HOME = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
#: The bounds aim this much below the limits.
HEADROOM = 2e-3


ORACLE = PinocchioArm()


def draw(seed: int, count: int) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(seed)
    q = HOME + rng.uniform(-0.5, 0.5, (count, 7))
    return q, rng.normal(size=(count, 7)), rng.normal(size=(count, 7))


def test_rows_say_which_path_accelerations_pinocchios_torques_allow() -> None:
    q, q1, q2 = draw(0, 200)
    effort = np.array([87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0])
    limits = knot_limits(EffortLimits(CHAIN, effort), q, q1, q2)
    assert np.isinf(limits.caps).all()
    rng = np.random.default_rng(1)
    u, x = rng.normal(size=200) * 30.0, rng.uniform(0.0, 20.0, 200)
    a, b, low, high = np.moveaxis(limits.rows, -1, 0)
    used = a * u[:, None] + b * x[:, None]
    allowed = ((low <= used) & (used <= high)).all(axis=1)
    within = np.array(
        [
            np.abs(
                ORACLE.torque(q[i], np.sqrt(x[i]) * q1[i], u[i] * q1[i] + x[i] * q2[i])
                / (effort * (1.0 - HEADROOM))
            ).max()
            <= 1.0
            for i in range(200)
        ]
    )
    assert 20 < within.sum() < 180
    np.testing.assert_array_equal(allowed, within)


def test_rows_with_friction_stand_in_on_the_safe_side() -> None:
    chain = with_motors(CHAIN, viscous_friction=np.full(7, 3.0))
    q, q1, q2 = draw(2, 200)
    effort = np.full(7, 87.0)
    rng = np.random.default_rng(3)
    u, x = rng.normal(size=200) * 30.0, rng.uniform(0.0, 20.0, 200)
    limits = knot_limits(EffortLimits(chain, effort), q, q1, q2, guess=x)
    a, b, low, high = np.moveaxis(limits.rows, -1, 0)
    used = a * u[:, None] + b * x[:, None]
    allowed = ((low <= used) & (used <= high)).all(axis=1)
    assert 20 < allowed.sum() < 180
    for i in np.flatnonzero(allowed):
        qd = np.sqrt(x[i]) * q1[i]
        tau = ORACLE.torque(q[i], qd, u[i] * q1[i] + x[i] * q2[i]) + 3.0 * qd
        assert (np.abs(tau) <= effort).all()


def test_caps_are_those_of_pinocchios_tip_velocity() -> None:
    q, q1, q2 = draw(4, 50)
    limits = knot_limits(EffortLimits(CHAIN, None, 0.7), q, q1, q2)
    assert limits.rows.shape == (50, 0, 4)
    for i in range(50):
        speed = np.linalg.norm(ORACLE.tip_velocity(q[i], np.sqrt(limits.caps[i]) * q1[i]))
        assert speed == pytest.approx(0.7, rel=1e-9)


def cubic(duration: float) -> Trajectory:
    """From rest to rest in a cubic of time."""
    step = np.array([1.0, 0.6, -0.5, 0.7, 0.3, 0.4, 0.2])
    c = np.zeros((1, 7, 4))
    c[0, :, 0] = HOME
    c[0, :, 2] = 3.0 * step / duration**2
    c[0, :, 3] = -2.0 * step / duration**3
    return Trajectory(CHAIN.joint_names, np.array([0.0, duration]), c)


def sampled_uses(motion: Trajectory, effort: Array) -> tuple[float, float]:
    times = np.linspace(0.0, motion.duration, 800)
    rows = [motion.sample(times, order) for order in range(3)]
    torque = max(
        float((np.abs(ORACLE.torque(*state)) / effort).max()) for state in zip(*rows, strict=True)
    )
    speed = max(
        float(np.linalg.norm(ORACLE.tip_velocity(*state))) for state in zip(*rows[:2], strict=True)
    )
    return torque, speed


def test_motions_are_slowed_down_until_both_limits_hold_and_hardly_more() -> None:
    fast = cubic(0.3)
    times = np.linspace(0.0, fast.duration, 200)
    at_rest = np.array([ORACLE.torque(q, 0.0 * q, 0.0 * q) for q in fast.sample(times)])
    effort = 1.5 * np.abs(at_rest).max(axis=0) + 3.0
    for loads, index, limit in (
        (EffortLimits(CHAIN, effort), 0, 1.0),
        (EffortLimits(CHAIN, None, 0.5), 1, 0.5),
    ):
        assert sampled_uses(fast, effort)[index] > 1.2 * limit
        slow = slow_down(loads, ScaledTime(fast, 2.0))
        used = sampled_uses(slow.trajectory, effort)[index]
        assert used <= limit
        assert used > 0.97 * limit
        ratio = slow.trajectory.duration / fast.duration
        assert slow.factor == pytest.approx(2.0 * ratio, rel=1e-12)
        # What keeps the limits stays as it is.
        again = slow_down(loads, slow)
        assert again.trajectory is slow.trajectory


def test_a_motion_that_no_slowing_down_helps_is_refused() -> None:
    held = np.abs(ORACLE.torque(HOME, 0.0 * HOME, 0.0 * HOME))
    with pytest.raises(TimingFailed, match="no slower motion"):
        slow_down(EffortLimits(CHAIN, 0.5 * held + 0.01), ScaledTime(cubic(0.5), 1.0))
