"""What a run of a closed loop needs: states, limits, references, disturbances, noise."""

import math
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from kinematics.errors import InvalidOption, InvalidRobotState, InvalidTrajectory
from kinematics.robots import builtin_chain
from kinematics.trajectory.trajectory import Trajectory
from tests.dynamics.samples import planar_rr
from tracking.simulation.disturbance import Disturbance, EncoderNoise
from tracking.simulation.references import ReferenceSignal, hold, sine, spline, step
from tracking.simulation.result import settling_time
from tracking.simulation.setup import SimulationOptions, schedule

CHAIN = builtin_chain("planar_rr")
# ---------------------------------------------------------------------------------- options


def options_with(name: str, value: Any) -> SimulationOptions:
    fields: dict[str, Any] = {name: value}
    return SimulationOptions(**fields)


@pytest.mark.parametrize(
    "name", ["duration", "sample_period", "control_period", "settling_tolerance"]
)
@pytest.mark.parametrize("value", [0.0, -1.0, math.inf, math.nan])
def test_times_and_tolerances_are_positive(name: str, value: float) -> None:
    with pytest.raises(InvalidOption, match=f"{name} is"):
        options_with(name, value)
    assert getattr(options_with(name, 1e-300), name) == 1e-300


@pytest.mark.parametrize("name", ["relative_tolerance", "absolute_tolerance"])
def test_tolerances_of_a_step_are_within_their_bounds(name: str) -> None:
    for value in (1e-13, 1e-2):
        assert getattr(options_with(name, value), name) == value
    for value in (np.nextafter(1e-13, 0.0), np.nextafter(1e-2, 1.0), math.nan, 0.0, -1e-8):
        with pytest.raises(InvalidOption, match=f"{name} is"):
            options_with(name, value)


def test_a_run_may_cost_one_evaluation_at_least() -> None:
    assert SimulationOptions(max_evaluations=1).max_evaluations == 1
    with pytest.raises(InvalidOption, match="max_evaluations is 0"):
        SimulationOptions(max_evaluations=0)


# ----------------------------------------------------------------- disturbances and noise


def test_a_disturbance_is_one_number_or_one_a_joint() -> None:
    constant, amplitude = Disturbance(2.0, [3.0, 4.0]).parts(CHAIN)
    np.testing.assert_array_equal(constant, [2.0, 2.0])
    np.testing.assert_array_equal(amplitude, [3.0, 4.0])
    for wrong, name in (
        (Disturbance([1.0]), "disturbance"),
        (Disturbance(0.0, [1.0] * 3), "amplitude"),
        (Disturbance(math.nan), "disturbance"),
        (Disturbance([[1.0, 2.0]]), "has the shape"),
    ):
        with pytest.raises(InvalidRobotState, match=name):
            wrong.parts(CHAIN)


@pytest.mark.parametrize(
    "fields",
    [{"wrench": [1.0] * 5}, {"wrench": [math.inf] * 6}, {"frequency": -1.0}, {"start": -0.1},
     {"frequency": math.nan}, {"start": 1.0, "end": 1.0}, {"end": math.nan}],
)  # fmt: skip
def test_disturbances_that_are_none_are_refused(fields: dict[str, Any]) -> None:
    with pytest.raises(InvalidOption):
        Disturbance(**fields)


def test_noise_has_the_deviations_that_were_asked_for_and_comes_again() -> None:
    noise = EncoderNoise(0.1, 2.0, seed=3)
    drawn = noise.draw(20_000, 2)
    assert drawn.shape == (20_000, 2, 2)
    np.testing.assert_allclose(drawn.std(axis=(0, 2)), [0.1, 2.0], rtol=0.02)
    np.testing.assert_allclose(drawn.mean(axis=0), 0.0, atol=0.05)
    np.testing.assert_array_equal(drawn, EncoderNoise(0.1, 2.0, seed=3).draw(20_000, 2))
    assert (EncoderNoise(0.1, 2.0, seed=4).draw(5, 2) != drawn[:5]).all()
    for wrong in ({"position": -1.0}, {"velocity": math.inf}, {"seed": -1}, {"period": 0.0}):
        with pytest.raises(InvalidOption):
            EncoderNoise(**wrong)


# ---------------------------------------------------------------------------------- settling


@pytest.mark.parametrize(
    ("errors", "expected"),
    [([0.0, 0.0, 0.0], 0.0), ([1.0, 0.0, 0.0], 1.0), ([0.0, 1.0, 0.0], 2.0),
     ([0.0, 0.0, 1.0], None), ([0.1, 0.1, 0.1], 0.0), ([-1.0, 0.05, -0.1], 1.0)],
)  # fmt: skip
def test_a_robot_has_settled_from_where_it_stays_within_the_tolerance(
    errors: list[float], expected: float | None
) -> None:
    times = np.arange(3.0)
    error = np.column_stack([np.array(errors), np.zeros(3)])
    assert settling_time(times, error, 0.1) == expected
    assert settling_time(times, error[:, ::-1], 0.1) == expected


def signal() -> ReferenceSignal:
    """Pieces that end at 0.3, 0.5 and 1 s."""
    breaks = np.array([0.0, 0.3, 0.5, 1.0])
    return ReferenceSignal(Trajectory(("slide",), breaks, np.zeros((3, 1, 2))))


def test_noise_of_a_continuous_controller_changes_without_calls() -> None:
    events = schedule(signal(), 0.3, SimulationOptions(), None, EncoderNoise(1e-3, period=0.1))
    assert events.times == pytest.approx([0.0, 0.1, 0.2, 0.3])
    assert not events.called.any()
    assert events.noises.tolist() == [0, 1, 2]
    assert events.noise.shape == (3, 2, 1)


def test_events_that_differ_by_rounding_are_one() -> None:
    options = SimulationOptions(control_period=0.1 + 1e-15)
    events = schedule(signal(), 1.0, options, None, None)
    assert len(events.times) == 11
    assert np.diff(events.times).min() > 0.05


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
    with pytest.raises(InvalidRobotState, match="has the shape"):
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
