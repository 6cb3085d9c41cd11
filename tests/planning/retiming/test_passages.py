"""Motions that pass waypoints at given times, with given velocities or with any."""

from typing import Any

import numpy as np
import pytest
from ruckig import InputParameter, Ruckig, Trajectory

import armwright as aw
from kinematics.arrays import Array
from kinematics.errors import InvalidOption, InvalidTrajectory
from planning.timing.options import TimingFailed

POINTS = np.array([[0.0, 0.0], [1.0, 0.2], [1.2, 1.0], [0.3, 1.4]])
TIMES = [0.5, 2.0, 3.5, 5.0]
LIMITS: dict[str, Any] = {
    "velocity": [1.0, 1.5],
    "acceleration": [4.0, 3.0],
    "jerk": [40.0, 30.0],
}


def passed(points: Array, times: Any, velocities: Any = None, **more: Any) -> aw.Retimed:
    tolerance, stretches = more.pop("tolerance", None), more.pop("limits_at", ())
    limits = more.pop("limits", LIMITS)
    options = aw.TimingOptions("jerk_limited", times=times, velocities=velocities, **more)
    return aw.retime(
        points, limits=limits, timing_options=options, tolerance=tolerance, limits_at=stretches
    )


def least_time(points: Array, velocities: Array, limits: dict[str, Array]) -> float:
    """Least time of a leg without acceleration at its ends, by ruckig itself."""
    leg = InputParameter(points.shape[1])
    leg.current_position, leg.target_position = points.tolist()
    leg.current_velocity, leg.target_velocity = velocities.tolist()
    leg.max_velocity, leg.max_acceleration, leg.max_jerk = (
        np.asarray(limits[name]).tolist() for name in ("velocity", "acceleration", "jerk")
    )
    found = Trajectory(points.shape[1])
    Ruckig(points.shape[1]).calculate(leg, found)
    return float(found.duration)


@pytest.mark.parametrize("seed", range(40))
def test_waypoints_are_passed_at_their_times_or_the_leg_is_named(seed: int) -> None:
    rng = np.random.default_rng(seed)
    k, n = int(rng.integers(2, 9)), int(rng.integers(1, 7))
    points = np.cumsum(rng.normal(size=(k, n)), axis=0)
    limits = {"velocity": rng.uniform(1.0, 3.0, n), "acceleration": rng.uniform(2.0, 9.0, n)}
    limits["jerk"] = rng.uniform(10.0, 100.0) * limits["acceleration"]
    velocities = rng.uniform(-0.5, 0.5, (k, n)) * limits["velocity"]
    legs = [
        least_time(points[i : i + 2], velocities[i : i + 2], limits) for i in range(k - 1)
    ]  # fmt: skip
    # The least times can be had, and longer ones mostly.
    times = rng.uniform(-3.0, 3.0) + np.concatenate([[0.0], np.cumsum(legs)])
    found = passed(points, times.tolist(), velocities.tolist(), limits=limits)
    assert found.certificate.verified
    assert found.begins == times[0]
    at = times - times[0]
    np.testing.assert_allclose(found.trajectory.sample(at), points, atol=1e-9)
    np.testing.assert_allclose(found.trajectory.sample(at, 1), velocities, atol=1e-8)
    assert found.trajectory.duration == pytest.approx(at[-1], rel=1e-12)
    # What is less is refused, with the leg and its least time.
    short = int(rng.integers(k - 1))
    times[short + 1 :] -= 0.05 * legs[short]
    with pytest.raises(TimingFailed, match="takes at least") as refused:
        passed(points, times.tolist(), velocities.tolist(), limits=limits)
    assert refused.value.details["waypoints"] == [short, short + 1]
    assert refused.value.details["least_duration"] == pytest.approx(legs[short], rel=1e-6)


def test_waypoints_without_a_velocity_are_passed_smoothly() -> None:
    found = passed(POINTS, TIMES)
    assert found.certificate.verified
    at = np.array(TIMES) - TIMES[0]
    np.testing.assert_allclose(found.trajectory.sample(at), POINTS, atol=1e-9)
    rates = found.trajectory.sample(at, 1)
    assert np.abs(rates[[0, -1]]).max() < 1e-9
    assert np.abs(rates[1:-1]).max(axis=1).min() > 0.3
    some = passed(POINTS, TIMES, [None, [0.5, 0.4], None, [0.0, 0.1]])
    rates = some.trajectory.sample(at, 1)
    np.testing.assert_allclose(rates[[1, 3]], [[0.5, 0.4], [0.0, 0.1]], atol=1e-9)
    # Where a spline is too fast, a rest at the waypoints may be had.
    assert passed(POINTS, [0.0, 1.7, 2.75, 3.95]).certificate.verified


def test_odd_times_are_refused() -> None:
    for times, velocities in (
        (TIMES[:3], None),
        ([0.0, 1.0, 1.0, 2.0], None),
        ([0.0, 1.0, np.nan, 2.0], None),
        (TIMES, [None]),
        (TIMES, [[0.0], None, None, None]),
    ):
        with pytest.raises(InvalidTrajectory):
            passed(POINTS, times, velocities)
    with pytest.raises(InvalidOption, match=r"velocities\[1\] is 2 for joint 'joint_1'"):
        passed(POINTS, TIMES, [None, [2.0, 0.0], None, None])
    for more, said in (
        ({"tolerance": 1e-3}, "path.tolerance"),
        ({"blend_tolerance": 1e-3}, "blend_tolerance"),
        ({"interpolation": "linear"}, "interpolation"),
        ({"start_velocity": [0.0, 0.0]}, "start_velocity"),
        ({"limits_at": [aw.Stretch(0, 1, velocity=np.ones(2))]}, "limits_at"),
        ({"duration": 9.0}, "duration"),
    ):
        with pytest.raises(InvalidOption, match=said):
            passed(POINTS, TIMES, **more)
    for method in (None, "toppra"):
        with pytest.raises(InvalidOption, match="belongs to the methods spline and jerk_limited"):
            aw.TimingOptions(method, times=TIMES)
    with pytest.raises(InvalidOption, match="velocities belongs"):
        aw.TimingOptions("jerk_limited", velocities=[None, None])
    with pytest.raises(InvalidOption, match="of a plan belongs to the method spline"):
        aw.Options(timing=aw.TimingOptions("jerk_limited", times=TIMES))
