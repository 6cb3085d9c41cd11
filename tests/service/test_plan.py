"""Plans over HTTP: the domain's, as sampled, with a preferred clearance, and why there is none."""

import hashlib
import time
from typing import Any

import httpx
import numpy as np
import pytest
from numpy.polynomial import polynomial

from armwright_wire.plans.plan import PlanRequest
from armwright_wire.scenes.scene import Scene
from kinematics.arrays import Array
from kinematics.robots import builtin_chain
from planning.options import Options
from planning.pipeline import pipeline
from planning.problem import JointGoal, Problem
from planning.result import Plan
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import builtin_reference
from service.translate import poses
from tests.service.planning import BODY, PLACE, plan, world
from tests.service.robots import (
    ACCELERATIONS,
    ASIDE,
    HOME,
    POST,
    answer,
    bench,
    problem,
    scene,
    stuck,
)


def positions(trajectory: dict[str, Any], count: int = 400) -> Array:
    """Samples of a trajectory by numpy's polynomials, from the answer alone."""
    rows = []
    for t in np.linspace(0.0, trajectory["duration"], count):
        segment = next(s for s in trajectory["segments"] if t <= s["t1"] + 1e-12)
        rows.append([polynomial.polyval(t - segment["t0"], c) for c in segment["coefficients"]])
    return np.array(rows)


def test_a_plan_around_an_obstacle_is_what_it_says(client: httpx.Client) -> None:
    found = plan(client)
    assert found["status"] == "success"
    outcomes = {stage["name"]: stage["outcome"] for stage in found["stages"]}
    assert outcomes["straight_line"] == "failed"
    assert outcomes[found["planner"]] == outcomes["certificate"] == "succeeded"
    trajectory, certificate = found["trajectory"], found["certificate"]
    assert trajectory["joint_names"] == list(builtin_chain("panda").joint_names)
    assert trajectory["samples"] is None
    np.testing.assert_allclose(found["path"]["joints"][0], HOME)
    np.testing.assert_allclose(found["path"]["joints"][-1], ASIDE)
    q = positions(trajectory)
    np.testing.assert_allclose(q[0], HOME, atol=1e-12)
    np.testing.assert_allclose(q[-1], ASIDE, atol=1e-9)
    exact = world()
    nearest = min(exact.clearance(row).distance for row in q)
    assert certificate["verified"] is True
    assert 0.0 < certificate["min_clearance"] <= nearest + 1e-9
    assert certificate["min_clearance"] > 0.5 * nearest
    for use in certificate["limits"].values():
        assert use is None or 0.0 < use["worst_ratio"] <= 1.0 + 1e-9
    ends = [found["trajectory"]["segments"][k] for k in (0, -1)]
    assert ends[0]["t0"] == 0.0
    assert ends[1]["t1"] == trajectory["duration"]


def test_it_is_what_the_domain_plans(client: httpx.Client) -> None:
    found = plan(client, seed=3)
    geometry = worker_cache.robot(builtin_reference("panda")).geometry
    obstacles = poses.scene(Scene.model_validate(PLACE))
    made = Problem(geometry, obstacles, np.array(HOME), (JointGoal(np.array(ASIDE)),))
    direct = pipeline.plan(made, Options(timeout=20.0, seed=3))
    assert isinstance(direct, Plan)
    assert found["planner"] == direct.planner
    told = [segment["coefficients"] for segment in found["trajectory"]["segments"]]
    np.testing.assert_array_equal(np.array(told), direct.trajectory.coefficients)
    told_breaks = [segment["t1"] for segment in found["trajectory"]["segments"]]
    assert told_breaks == direct.trajectory.breaks[1:].tolist()
    assert found["reproducibility"]["robot_hash"] == geometry.content_hash
    assert found["reproducibility"]["scene_hash"] == obstacles.content_hash
    left_out = {"keep", "tool", "tcp", "witness"}  # a tool is part of the robot's hash
    asked = PlanRequest.model_validate(BODY | {"seed": 3}).model_dump_json(exclude=left_out)
    request_hash = hashlib.sha256(asked.encode()).hexdigest()
    assert found["reproducibility"]["request_hash"] == request_hash


def test_stored_and_inline_scenes_plan_alike(client: httpx.Client) -> None:
    answer(client.post("/v1/scenes", json={"name": "planned", **PLACE}), 201)
    stored, inline = plan(client, scene="planned"), plan(client)
    assert stored["trajectory"] == inline["trajectory"]
    hashes = [found["reproducibility"]["scene_hash"] for found in (stored, inline)]
    assert hashes[0] == hashes[1]


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
    # The lower link has to pass through the ball: the shoulder can't turn the other way round.
    start = time.monotonic()
    document = problem(client.post("/v1/plan", json=stuck("stuck", 0.8)), 504, "TIMED_OUT")
    assert 0.5 < time.monotonic() - start < 10.0, "no way would be looked for without end"
    assert document["hint"]
    tried = [stage["name"] for stage in document["details"]["stages"]]
    cascade = ["straight_line", "rrt_connect"]
    # With the preferred clearance first, then as near as the margin allows.
    assert tried == ["preflight", *cascade, *cascade, "diagnosis"]
    assert document["details"]["blocked_by"][0]["pair"] == ["lower", "ball"]
    assert document["details"]["would_unblock"] == ["ball"]


def test_the_answer_tells_where_the_motion_is_nearer(client: httpx.Client) -> None:
    found = plan(client, clearance={"preferred": 0.3})
    told, duration = found["clearance"], found["trajectory"]["duration"]
    assert told["own_links"] == 0.005
    assert told["spans"]
    for span in told["spans"]:
        assert 0.0 <= span["begins"] < span["ends"] <= duration
        assert 0.0 <= span["distance"] <= 0.3
    total = sum(span["ends"] - span["begins"] for span in told["spans"])
    assert told["time_below"] == pytest.approx(total)
    least = min(span["distance"] for span in told["spans"])
    assert least >= found["certificate"]["min_clearance"] - 1e-9


def test_least_is_the_margin(client: httpx.Client) -> None:
    by_name = plan(client, margin=0.004, clearance={"preferred": 0.0})
    other = plan(client, clearance={"preferred": 0.0, "least": 0.004})
    assert by_name["trajectory"] == other["trajectory"]
    assert other["clearance"]["least"] == 0.004
    assert other["certificate"]["min_obstacle_clearance"] >= 0.004
