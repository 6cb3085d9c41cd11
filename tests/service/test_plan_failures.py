"""POST /v1/plan without a plan: codes, hints and details."""

import time

import httpx
import pytest

from tests.service.planning import BODY, plan, world
from tests.service.robots import (
    ACCELERATIONS,
    HOME,
    POST,
    answer,
    bench,
    problem,
    scene,
)


def test_a_start_in_collision_names_the_pair_and_the_depth(client: httpx.Client) -> None:
    box = POST | {"id": "crate", "pose": {"position": [0.3, 0.0, 0.0]}}
    document = problem(
        client.post("/v1/plan", json=BODY | {"scene": scene(box)}), 422, "START_STATE_IN_COLLISION"
    )
    assert document["stage"] == "start"
    assert "crate" in document["details"]["pair"]
    exact = world(scene(box)).collisions(HOME)
    assert document["details"]["depth"] == pytest.approx(exact[0].depth, abs=1e-9)
    assert document["details"]["stages"][0]["outcome"] == "failed"


def test_a_motion_lasts_as_long_as_its_pieces_do_whatever_duration_says(
    client: httpx.Client,
) -> None:
    motion = plan(client, scene=None)["trajectory"]
    answers = [
        client.post("/v1/validate", json={"robot": "panda", "trajectory": motion | changed}).json()
        for changed in ({}, {"duration": 2.0 * motion["duration"]})
    ]
    assert answers[0]["verified"] is True
    assert answers[0] == answers[1]


def test_a_missing_acceleration_limit_names_joints_and_remedy(client: httpx.Client) -> None:
    answer(client.post("/v1/robots", json=bench("limitless", joint_limits=None)), 201)
    body = {
        "robot": "limitless",
        "start": {"joints": [0.0, 0.0]},
        "goal": {"joints": [0.5, 0.5]},
    }
    document = problem(client.post("/v1/plan", json=body), 422, "MISSING_LIMIT")
    assert document["details"]["joints"] == ["shoulder", "elbow"]
    assert document["details"]["quantity"] == "acceleration"
    assert "joint_limits" in document["hint"]
    motion = {"samples": {"time": [0, 9], "position": [[0, 0], [0.5, 0.5]]}}
    body = {
        "robot": "limitless",
        "trajectory": motion | {"interpolation": "clamped_spline"},
    }
    problem(client.post("/v1/validate", json=body), 422, "MISSING_LIMIT")
    body["limits"] = {"acceleration": [5.0, 5.0]}
    assert answer(client.post("/v1/validate", json=body))["verified"]


def test_uploaded_robots_plan(client: httpx.Client) -> None:
    answer(client.post("/v1/robots", json=bench("bench", joint_limits=ACCELERATIONS)), 201)
    ball = {"id": "ball", "shape": {"type": "sphere", "radius": 0.05}}
    body = {
        "robot": "bench",
        "scene": scene(ball | {"pose": {"position": [0.0, 0.0, 0.65]}}),
        "start": {"joints": [-0.8, 0.0]},
        "goal": {"joints": [0.8, 0.0]},
    }
    found = answer(client.post("/v1/plan", json=body))
    assert found["certificate"]["verified"]
    assert found["certificate"]["clearance_pair"] == ["upper", "ball"]


def test_no_way_at_all_is_told_in_time_with_what_was_tried(client: httpx.Client) -> None:
    answer(client.post("/v1/robots", json=bench("stuck")), 201)
    # The lower link has to pass through it: the shoulder can't turn the other way round.
    ball = {"id": "ball", "shape": {"type": "sphere", "radius": 0.02}}
    body = {
        "robot": "stuck",
        "scene": scene(ball | {"pose": {"position": [0.0, 0.0, 0.2]}}),
        "start": {"joints": [-1.5, 0.0]},
        "goal": {"joints": [1.5, 0.0]},
        "timeout": 0.8,
    }
    start = time.monotonic()
    document = problem(client.post("/v1/plan", json=body), 504, "TIMED_OUT")
    assert 0.5 < time.monotonic() - start < 10.0, "no way would be looked for without end"
    assert document["hint"]
    tried = [stage["name"] for stage in document["details"]["stages"]]
    cascade = ["straight_line", "rrt_connect"]
    # With the preferred clearance first, then with half of it, then as near as the margin allows.
    assert tried == ["preflight", *cascade, *cascade, *cascade, "diagnosis"]
    assert document["details"]["blocked_by"][0]["pair"] == ["lower", "ball"]
    assert document["details"]["would_unblock"] == ["ball"]


def test_a_deadline_too_short_is_a_timeout(client: httpx.Client) -> None:
    response = client.post("/v1/plan", json=BODY | {"timeout": 0.001, "planner": "rrt_connect"})
    document = problem(response, 504, "TIMED_OUT")
    assert document["hint"]
