"""References by name against their formulas and scipy, and the trajectory's samples."""

from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from kinematics.errors import InvalidOption, InvalidRobotState, InvalidTrajectory
from kinematics.trajectory.trajectory import Trajectory
from tests.dynamics.samples import planar_rr
from tracking.simulation.references import ReferenceSignal, hold, sine, spline, step

ARM = planar_rr()


def test_a_sine_is_one_with_its_derivatives() -> None:
    center, size = np.array([0.2, -0.3]), np.array([0.5, 1.5])
    hertz, phase = np.array([0.7, 2.0]), np.array([0.4, -1.0])
    motion = sine(ARM, center, size, hertz, phase, 3.0)
    t = np.linspace(0.0, 3.0, 1001)
    turn = 2.0 * np.pi * hertz
    angle = t[:, None] * turn + phase
    np.testing.assert_allclose(motion.sample(t), center + size * np.sin(angle), atol=1e-14)
    rate = size * turn * np.cos(angle)
    np.testing.assert_allclose(motion.sample(t, 1), rate, atol=1e-12)
    bend = -size * turn**2 * np.sin(angle)
    np.testing.assert_allclose(motion.sample(t, 2), bend, atol=1e-10)
    # One number holds for all joints, and a sine of no frequency stands still.
    still = sine(ARM, center, 0.5, 0.0, np.pi / 2.0, 2.0)
    np.testing.assert_allclose(still.sample([0.0, 1.0]), [center + 0.5] * 2)
    assert still.pieces == 1


def test_a_step_jumps_at_its_time() -> None:
    motion = step(ARM, [0.1, 0.2], [0.5, -0.4], 0.5, 2.0)
    np.testing.assert_array_equal(motion.sample([0.4, 0.6]), [[0.1, 0.2], [0.5, -0.4]])
    np.testing.assert_allclose(motion.jumps(0), [[0.4, -0.6]])
    at_once = step(ARM, [0.1, 0.2], [0.5, -0.4], 0.0, 2.0)
    np.testing.assert_array_equal(at_once.start, [0.5, -0.4])


def test_a_hold_stands_still() -> None:
    motion = hold(ARM, [0.1, 0.2], 2.0)
    assert motion.duration == 2.0
    np.testing.assert_array_equal(motion.sample([0.0, 2.0]), [[0.1, 0.2]] * 2)
    assert motion.peaks(1).value.max() == 0.0


@pytest.mark.parametrize(
    ("name", "ends"), [("clamped_spline", "clamped"), ("natural_spline", "natural")]
)
def test_a_spline_is_that_of_scipy(name: str, ends: Any) -> None:
    points, times = [[0.0, 0.1], [0.5, -0.2], [0.2, 0.4]], [0.0, 0.7, 1.5]
    motion = spline(ARM, points, times, name)
    t = np.linspace(0.0, 1.5, 50)
    exact = CubicSpline(times, points, bc_type=ends)
    np.testing.assert_allclose(motion.sample(t), exact(t), atol=1e-13)


def test_faults_say_what_is_wrong() -> None:
    with pytest.raises(InvalidRobotState, match=r"reference\.joints"):
        hold(ARM, [0.1], 1.0)
    with pytest.raises(InvalidRobotState, match="batch"):
        hold(ARM, [[0.1, 0.2]], 1.0)
    with pytest.raises(InvalidOption, match="would step at 2 s"):
        step(ARM, [0.1, 0.2], [0.1, 0.3], 2.0, 2.0)
    with pytest.raises(InvalidOption, match="frequency of a reference is -1"):
        sine(ARM, [0.0, 0.0], 1.0, [1.0, -1.0], 0.0, 1.0)
    with pytest.raises(InvalidOption, match="periods"):
        sine(ARM, [0.0, 0.0], 1.0, 1e6, 0.0, 1.0)
    with pytest.raises(InvalidOption, match="2 points and 3 times"):
        spline(ARM, [[0.0, 0.0], [1.0, 1.0]], [0.0, 1.0, 2.0], "clamped_spline")
    with pytest.raises(InvalidOption, match="the first at 1 s"):
        spline(ARM, [[0.0, 0.0], [1.0, 1.0]], [1.0, 2.0], "clamped_spline")
    with pytest.raises(InvalidTrajectory):
        spline(ARM, [[0.0, 0.0], [1.0, 1.0], [0.0, 0.0]], [0.0, 1.0, 1.0], "clamped_spline")


def random_trajectory(seed: int) -> Trajectory:
    rng = np.random.default_rng(seed)
    breaks = np.concatenate([[0.0], np.cumsum(rng.uniform(0.1, 1.0, 5))])
    return Trajectory(("a", "b"), breaks, rng.normal(size=(5, 2, 1 + seed % 6)))


@pytest.mark.parametrize("seed", range(12))
def test_equals_the_samples_of_the_trajectory(seed: int) -> None:
    trajectory = random_trajectory(seed)
    signal = ReferenceSignal(trajectory)
    times = np.linspace(0.0, trajectory.duration, 101)[:-1]
    for t in [*times, *trajectory.breaks[:-1]]:
        got = signal.at(t)
        parts = (got.position, got.velocity, got.acceleration)
        for order, part in enumerate(parts):
            np.testing.assert_allclose(part, trajectory.sample([t], order)[0], atol=1e-12)


def test_the_piece_decides_at_a_break() -> None:
    trajectory = random_trajectory(4)
    signal = ReferenceSignal(trajectory)
    t = float(trajectory.breaks[2])
    u = t - trajectory.breaks[1]
    left = np.polynomial.polynomial.polyval(u, trajectory.coefficients[1].T)
    np.testing.assert_allclose(signal.at(t, 1).position, left, atol=1e-12)
    np.testing.assert_array_equal(signal.at(t).position, trajectory.coefficients[2, :, 0])


def test_rests_after_the_end() -> None:
    trajectory = random_trajectory(3)
    signal = ReferenceSignal(trajectory)
    for t in (trajectory.duration, trajectory.duration + 7.0):
        got = signal.at(t)
        np.testing.assert_array_equal(got.position, trajectory.end)
        np.testing.assert_array_equal(got.velocity, 0.0)
        np.testing.assert_array_equal(got.acceleration, 0.0)
    assert signal.breaks(trajectory.duration) == list(trajectory.breaks[1:-1])
    assert signal.breaks(trajectory.duration + 1.0) == list(trajectory.breaks[1:])
