"""Motions between two states over HTTP."""

from typing import Any

import httpx
import numpy as np
import pytest
from ruckig import InputParameter, Ruckig, Trajectory

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


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"to": None}, "give path, or both from and to"),
        ({"path": {"joints": [[0.0, 0.0], [1.0, 1.0]]}}, "from belongs to two states"),
        ({"timing": {"times": [0.0, 1.0]}}, "timing.times belongs to a path"),
        ({"timing": {"method": "toppra"}}, "can only be jerk_limited"),
        ({"to": {"position": [1.0]}}, "to.position has 1 value(s) in place of 2"),
        ({"to": {"position": [1.0, 1.0], "velocity": [1.0]}}, "to.velocity has 1 value(s) for 2"),
        ({"joint_names": ["a", "a"]}, "2 different names"),
        ({"limits": {"velocity": [1.0, 1.0], "acceleration": [1.0, 1.0]}}, "no jerk limit"),
    ],
)
def test_bad_states_are_refused(client: httpx.Client, change: dict[str, Any], words: str) -> None:
    body = {name: value for name, value in (STATES | change).items() if value is not None}
    response = client.post("/v1/retime", json=body)
    assert response.status_code == 422
    assert words in response.text
