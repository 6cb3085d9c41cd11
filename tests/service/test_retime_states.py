"""Motions between two states, and splines at given times, over HTTP."""

from typing import Any

import httpx
import numpy as np
import pytest
from ruckig import InputParameter, Ruckig, Trajectory
from scipy.interpolate import CubicSpline

STATES: dict[str, Any] = {
    "from": {"position": [0.0, 0.0], "velocity": [0.5, 0.0], "acceleration": [1.0, 0.0]},
    "to": {"position": [1.0, 0.5], "velocity": [0.0, 0.2]},
    "limits": {"velocity": [1.0, 1.0], "acceleration": [4.0, 4.0], "jerk": [40.0, 40.0]},
}


def test_two_states_are_joined_in_the_least_time(client: httpx.Client) -> None:
    body = STATES | {"timing": {"sample_period": 0.01}}
    response = client.post("/v1/retime", json=body)
    assert response.status_code == 200, response.text
    answer = response.json()
    certificate, samples = answer["certificate"], answer["trajectory"]["samples"]
    assert certificate["verified"] is True
    assert certificate["proved"]["collisions"] is False
    assert certificate["limits"]["jerk"]["worst_ratio"] == pytest.approx(1.0, rel=1e-8)
    for name in ("position", "velocity", "acceleration"):
        assert samples[name][0] == STATES["from"][name]
        expected = STATES["to"].get(name, [0.0, 0.0])
        np.testing.assert_allclose(samples[name][-1], expected, rtol=0, atol=1e-9)
    assert answer["trajectory"]["joint_names"] == ["joint1", "joint2"]
    assert "no straight line" in answer["notes"][0]

    wanted, motion = InputParameter(2), Trajectory(2)
    wanted.current_velocity, wanted.current_acceleration = [0.5, 0.0], [1.0, 0.0]
    wanted.target_position, wanted.target_velocity = [1.0, 0.5], [0.0, 0.2]
    wanted.max_velocity, wanted.max_acceleration = [1.0, 1.0], [4.0, 4.0]
    wanted.max_jerk = [40.0, 40.0]
    Ruckig(2).calculate(wanted, motion)
    assert answer["trajectory"]["duration"] == pytest.approx(motion.duration, rel=1e-8)
    for time, row in zip(samples["time"], samples["position"], strict=True):
        at, _, _ = motion.at_time(time)
        np.testing.assert_allclose(row, at, atol=1e-7)


def test_a_start_beyond_the_limit_is_refused_by_its_joint(client: httpx.Client) -> None:
    body = {
        "from": {"position": [0.0], "velocity": [1200.0]},
        "to": {"position": [500.0]},
        "joint_names": ["rail"],
        "limits": {"velocity": [800.0], "acceleration": [2e3], "jerk": [2e4]},
    }
    response = client.post("/v1/retime", json=body)
    assert response.status_code == 422
    document = response.json()
    assert "from: the velocity of joint 'rail' is 1200, its limit is 800" in document["detail"]
    assert document["details"]["limit"] == 800.0
    body["from"] = {"position": [0.0], "velocity": [790.0]}
    answer = client.post("/v1/retime", json=body).json()
    assert answer["trajectory"]["segments"][0]["coefficients"][0][1] == 790.0


def test_times_from_any_number_need_no_limits(client: httpx.Client) -> None:
    times, joints = [5.0, 5.5, 6.25, 7.0], [[0.0, 0.0], [1.0, 0.2], [1.2, 1.0], [0.3, 1.4]]
    timing = {"method": "spline", "times": times, "sample_period": 0.1}
    response = client.post("/v1/retime", json={"path": {"joints": joints}, "timing": timing})
    assert response.status_code == 200, response.text
    answer = response.json()
    segments, samples = answer["trajectory"]["segments"], answer["trajectory"]["samples"]
    assert [segments[0]["t0"], *(segment["t1"] for segment in segments)] == times
    expected = CubicSpline(times, joints, bc_type="natural")
    assert (samples["time"][0], samples["time"][-1]) == (5.0, 7.0)
    np.testing.assert_allclose(samples["position"], expected(samples["time"]), atol=1e-12)
    rates = expected(np.linspace(5.0, 7.0, 20_001), 1)
    np.testing.assert_allclose(answer["peaks"]["velocity"], np.abs(rates).max(axis=0), rtol=1e-6)
    certificate = answer["certificate"]
    assert certificate["verified"] is False
    assert certificate["violation"] is None
    assert "no limits of velocity and acceleration" in " ".join(certificate["proved"]["reasons"])
    known = {"path": {"joints": joints}, "timing": timing, "limits": {"velocity": [0.5, 9.0]}}
    certificate = client.post("/v1/retime", json=known).json()["certificate"]
    assert certificate["violation"]["time"] >= 5.0


def test_a_plan_by_a_natural_spline_is_refused_with_its_velocities(client: httpx.Client) -> None:
    body = {
        "robot": "planar_rr",
        "start": {"joints": [0.0, 0.0]},
        "goal": {"joints": [0.7, 0.0]},
        "timing": {"method": "spline", "interpolation": "natural_spline", "times": [0.0, 1.0]},
    }
    response = client.post("/v1/plan", json=body)
    assert response.status_code == 422, response.text
    document = response.json()
    assert "would begin with 0.7 in joint" in document["detail"]
    assert "clamped_spline" in document["hint"]
    np.testing.assert_allclose(document["details"]["start_velocity"], [0.7, 0.0])
