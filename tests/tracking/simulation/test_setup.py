"""What a run of a closed loop needs: states, limits, options, disturbances, noise, events."""

import math
from typing import Any

import numpy as np
import pytest

from kinematics.errors import InvalidOption, InvalidRobotState
from kinematics.robots import builtin_chain
from kinematics.trajectory.trajectory import Trajectory
from tracking.simulation.disturbance import Disturbance, EncoderNoise
from tracking.simulation.references import ReferenceSignal
from tracking.simulation.result import settling_time
from tracking.simulation.setup import SimulationOptions, periods, schedule

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
        (Disturbance([[1.0, 2.0]]), "batch"),
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


def test_the_last_period_may_be_short_but_not_nothing() -> None:
    assert list(periods(1.0, 0.3, "period")) == pytest.approx([0.0, 0.3, 0.6, 0.9])
    assert list(periods(0.9, 0.3, "period")) == pytest.approx([0.0, 0.3, 0.6])
    assert list(periods(0.1, 0.3, "period")) == [0.0]
    with pytest.raises(InvalidOption, match="control_period"):
        periods(10.0, 1e-9, "control_period")
