"""Plans and proofs over HTTP: against the domain, and against sampling of what came back."""

import hashlib
import json
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
    ASIDE,
    FLOOR,
    HOME,
    POST,
    answer,
    scene,
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
    asked = PlanRequest.model_validate(BODY | {"seed": 3}).model_dump_json(exclude={"keep"})
    request_hash = hashlib.sha256(asked.encode()).hexdigest()
    assert found["reproducibility"]["request_hash"] == request_hash


@pytest.mark.parametrize("planner", ["auto", "rrt_connect", "potential_field"])
def test_the_same_request_gives_the_same_bytes(client: httpx.Client, planner: str) -> None:
    answers = [plan(client, seed=11, planner=planner) for _ in range(4)]
    first = json.dumps([answers[0][key] for key in ("trajectory", "path", "certificate")])
    for other in answers[1:]:
        assert json.dumps([other[key] for key in ("trajectory", "path", "certificate")]) == first
        assert other["reproducibility"] == answers[0]["reproducibility"]
    versions = answers[0]["reproducibility"]["versions"]
    assert {"armwright", "ompl", "numpy", "python-fcl"} <= set(versions)


def test_stored_and_inline_scenes_plan_alike(client: httpx.Client) -> None:
    answer(client.post("/v1/scenes", json={"name": "planned", **PLACE}), 201)
    stored, inline = plan(client, scene="planned"), plan(client)
    assert stored["trajectory"] == inline["trajectory"]
    hashes = [found["reproducibility"]["scene_hash"] for found in (stored, inline)]
    assert hashes[0] == hashes[1]


def test_samples_only_on_request(client: httpx.Client) -> None:
    found = plan(client, timing={"sample_period": 0.05})
    samples = found["trajectory"]["samples"]
    times = np.array(samples["time"])
    assert times[0] == 0.0
    assert times[-1] == found["trajectory"]["duration"]
    np.testing.assert_allclose(np.diff(times)[:-1], 0.05)
    segments = found["trajectory"]["segments"]
    for i, t in enumerate(times):
        segment = next(s for s in segments if t < s["t1"] or s is segments[-1])
        for order, name in enumerate(("position", "velocity", "acceleration")):
            expected = [
                polynomial.polyval(t - segment["t0"], polynomial.polyder(c, order))
                for c in segment["coefficients"]
            ]
            np.testing.assert_allclose(samples[name][i], expected, atol=1e-9)


def test_margins_are_kept(client: httpx.Client) -> None:
    found = plan(client, margin=0.01, scene=scene(POST | {"margin": 0.02}, FLOOR))
    exact = world(scene(POST))
    for row in positions(found["trajectory"], 100):
        exact.set_configuration(row)
        for k in range(len(exact.pairs)):
            if "post" in exact.pair_names(k):
                assert exact.distance(k) >= 0.03 - 1e-6
