"""Trajectories as messages and tables: times, values, digits, and what is refused."""

import csv
import io
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.trajectory.export import csv_text, joint_trajectory
from kinematics.trajectory.trajectory import MAX_SAMPLES, Trajectory, stay
from tests.properties import trajectories

PERIODS = st.floats(0.01, 3.0)


def ticks(message: dict[str, object]) -> list[int]:
    """Times of all points in whole nanoseconds."""
    points: list[dict[str, dict[str, int]]] = message["points"]  # type: ignore[assignment]
    stamps = [point["time_from_start"] for point in points]
    assert all(0 <= stamp["nanosec"] < 10**9 for stamp in stamps)
    return [stamp["sec"] * 10**9 + stamp["nanosec"] for stamp in stamps]


def column(message: dict[str, object], name: str) -> Array:
    """One quantity of all points, shape (p, n)."""
    points: list[dict[str, object]] = message["points"]  # type: ignore[assignment]
    return np.array([point[name] for point in points])


@given(trajectories(), PERIODS)
def test_points_are_samples_of_the_trajectory(trajectory: Trajectory, period: float) -> None:
    message = joint_trajectory(trajectory, period)
    times = trajectory.uniform_samples(period)
    for order, name in enumerate(("positions", "velocities", "accelerations")):
        told, exact = column(message, name), trajectory.sample(times, order)
        # An end that is at rest to rounding is told to be at rest.
        slow = (
            (order == 1) & (told == 0.0) & (np.abs(exact) <= 1e-7 * trajectory.peaks(1).value.max())
        )
        slow[1:-1] = False
        np.testing.assert_array_equal(told, np.where(slow, 0.0, exact))
    assert message["joint_names"] == list(trajectory.joint_names)
    assert all(point["effort"] == [] for point in message["points"])


@given(trajectories(), PERIODS)
def test_times_are_nanoseconds_that_strictly_increase_to_the_end(
    trajectory: Trajectory, period: float
) -> None:
    found = np.array(ticks(joint_trajectory(trajectory, period)))
    expected = trajectory.uniform_samples(period) * 1e9
    assert found[0] == 0
    assert (np.diff(found) > 0).all()
    assert np.abs(found - expected).max() <= 0.5 + 1e-6


def test_the_message_is_plain_json_with_its_header() -> None:
    message = joint_trajectory(stay(("a", "b"), [0.5, -1.0], 1.0), 0.5, "base_link")
    assert message["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": "base_link"}
    assert json.loads(json.dumps(message, allow_nan=False)) == message
    assert joint_trajectory(stay(("a",), [0.0]), 1.0)["header"]["frame_id"] == ""


@given(trajectories(), PERIODS)
def test_the_table_reads_back_bit_by_bit(trajectory: Trajectory, period: float) -> None:
    rows = list(csv.reader(io.StringIO(csv_text(trajectory, period))))
    times = trajectory.uniform_samples(period)
    values = [trajectory.sample(times, order) for order in range(3)]
    # Ends slower than 1e-7 of the largest speed are at rest.
    for end in (0, -1):
        ends = values[1][end]
        ends[np.abs(ends) <= 1e-7 * trajectory.peaks(1).value.max(initial=0.0)] = 0.0
    expected = np.column_stack([times, *values])
    np.testing.assert_array_equal(np.array(rows[1:], dtype=np.float64), expected)
    kinds = ("position", "velocity", "acceleration")
    assert rows[0] == [
        "time",
        *(f"{kind}.{name}" for kind in kinds for name in trajectory.joint_names),
    ]


def test_names_with_commas_and_quotes_stay_one_column() -> None:
    text = csv_text(stay(('a,"b"', "c\nd"), [0.0, 1.0], 1.0), 0.5)
    rows = list(csv.reader(io.StringIO(text)))
    assert rows[0][1:3] == ['position.a,"b"', "position.c\nd"]
    assert {len(row) for row in rows} == {7}


@pytest.mark.parametrize("period", [0.0, -1.0, float("nan"), float("inf"), 0.4 / MAX_SAMPLES])
def test_periods_that_make_no_table_are_refused(period: float) -> None:
    still = stay(("a",), [0.0], 1.0)
    for export in (joint_trajectory, csv_text):
        with pytest.raises(InvalidOption):
            export(still, period)
