"""Events of closed loops: every break, call and disturbance, each once and in order."""

import numpy as np
import pytest

from kinematics.errors import InvalidOption
from kinematics.trajectory.trajectory import Trajectory
from tracking.simulation.disturbance import EncoderNoise
from tracking.simulation.options import SimulationOptions
from tracking.simulation.references import ReferenceSignal
from tracking.simulation.schedule import periods, schedule


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
