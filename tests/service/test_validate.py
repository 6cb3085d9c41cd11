"""POST /v1/validate: certificates of given motions."""

import threading
from typing import Any

import httpx
import numpy as np
import pytest

from armwright_wire.motions.certificate import CertificateAnswer
from kinematics.robots import builtin_chain
from tests.service.planning import PLACE, plan, world
from tests.service.robots import (
    ASIDE,
    HOME,
    answer,
)


def validate(client: httpx.Client, trajectory: dict[str, Any], **more: Any) -> dict[str, Any]:
    body = {"robot": "panda", "scene": PLACE, "trajectory": trajectory} | more
    found = answer(client.post("/v1/validate", json=body))
    CertificateAnswer.model_validate(found)
    return found


def test_other_orders_of_joints_and_other_origins_of_time(client: httpx.Client) -> None:
    trajectory = plan(client)["trajectory"]
    order = [3, 1, 0, 2, 6, 5, 4]
    shuffled = {
        "joint_names": [trajectory["joint_names"][k] for k in order],
        "segments": [
            {
                "t0": segment["t0"] + 5.0,
                "t1": segment["t1"] + 5.0,
                "coefficients": [segment["coefficients"][k] for k in order],
            }
            for segment in trajectory["segments"]
        ],
    }
    proved, original = validate(client, shuffled), validate(client, trajectory)
    assert proved["verified"] is True
    assert proved["min_clearance"] == pytest.approx(original["min_clearance"])
    for name, use in original["limits"].items():
        told = proved["limits"][name]
        assert told["worst_ratio"] == pytest.approx(use["worst_ratio"])
        # A limit may be used as much at several times, by several joints: rounding picks one.
        assert 5.0 <= told["time"] <= 5.0 + trajectory["duration"]


def through_the_post(duration: float = 3.0) -> dict[str, Any]:
    return {
        "samples": {"time": [0.0, duration], "position": [HOME, ASIDE]},
        "interpolation": "clamped_spline",
    }


def test_a_collision_is_found_with_its_time(client: httpx.Client) -> None:
    found = validate(client, through_the_post())
    assert found["verified"] is False
    violation = found["violation"]
    assert violation["kind"] == "collision"
    assert "post" in violation["pair"]
    s = violation["time"] / 3.0
    q = np.array(HOME) + (3 * s**2 - 2 * s**3) * (np.array(ASIDE) - np.array(HOME))
    assert world().clearance(q).distance <= 1e-6


def test_what_is_too_fast_is_told_by_joint(client: httpx.Client) -> None:
    found = validate(client, through_the_post(0.2), scene=None)
    assert found["verified"] is False
    assert found["violation"]["kind"] in ("velocity", "acceleration")
    assert found["violation"]["joint"] == "panda_joint1"
    velocity = found["limits"]["velocity"]
    limit = builtin_chain("panda").limits.velocity[0]
    assert velocity["worst_ratio"] == pytest.approx(1.5 * 1.2 / 0.2 / limit)
    slow = validate(client, through_the_post(3.0), scene=None)
    assert slow["verified"] is True
    tight = validate(client, through_the_post(3.0), scene=None, limits={"velocity": [0.1] * 7})
    assert tight["violation"]["kind"] == "velocity"
    assert tight["limits"]["velocity"]["worst_ratio"] == pytest.approx(1.5 * 1.2 / 3.0 / 0.1)


def test_interpolations_of_samples(client: httpx.Client) -> None:
    middle = (0.5 * (np.array(HOME) + np.array(ASIDE))).tolist()
    still, moving = [0.0] * 7, [0.05] * 7
    samples: dict[str, Any] = {"time": [0.0, 3.0, 6.0], "position": [HOME, middle, ASIDE]}
    given = {"velocity": [still, moving, still], "acceleration": [still] * 3}
    for interpolation in ("cubic", "quintic"):
        body = {"samples": samples | given, "interpolation": interpolation}
        assert validate(client, body, scene=None)["verified"] is True
    for interpolation in ("natural_spline", "clamped_spline"):
        body = {"samples": samples, "interpolation": interpolation}
        assert validate(client, body, scene=None)["verified"] is True
    crooked = samples | {"position": [HOME, HOME, ASIDE]}
    found = validate(client, {"samples": crooked, "interpolation": "linear"}, scene=None)
    assert found["verified"] is False
    assert found["violation"]["kind"] == "continuity"
    assert found["violation"]["time"] == 3.0
    rows = np.array(HOME) + np.outer([0.0, 0.1, 0.0, 0.4], [1.0, 0, 0, 0, 0, 0, 0])
    zigzag = {"time": [0.0, 1.0, 2.0, 3.0], "position": rows.tolist()}
    found = validate(client, {"samples": zigzag, "interpolation": "linear"}, scene=None)
    assert found["violation"]["time"] == 1.0, "the first jump, not the largest"


def test_many_at_once_do_not_disturb_each_other(client: httpx.Client) -> None:
    expected = {seed: plan(client, seed=seed)["trajectory"] for seed in range(3)}
    wrong: list[int] = []

    def ask(seed: int) -> None:
        if plan(client, seed=seed)["trajectory"] != expected[seed]:
            wrong.append(seed)

    threads = [threading.Thread(target=ask, args=(k % 3,)) for k in range(12)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []
