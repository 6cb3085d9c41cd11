"""Plans and proofs over HTTP: against the domain, and against sampling of what came back."""

import json
from typing import Any

import httpx
import numpy as np
import pytest
from numpy.polynomial import polynomial

from armwright_wire.scenes.scene import Scene
from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.pose import from_rpy
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
    problem,
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


def test_a_pose_is_reached_within_its_tolerance(client: httpx.Client) -> None:
    goal = {"pose": {"position": [0.4, -0.3, 0.4], "rpy": [3.1, 0.1, 0.0]}}
    found = plan(client, goal=goal)
    reached = forward(builtin_chain("panda"), positions(found["trajectory"])[-1])
    np.testing.assert_allclose(reached[:3, 3], [0.4, -0.3, 0.4], atol=1e-4)
    np.testing.assert_allclose(reached[:3, :3], from_rpy([3.1, 0.1, 0.0]), atol=1e-3)


def test_any_of_several_goals(client: httpx.Client) -> None:
    unreachable = {"pose": {"position": [3.0, 0.0, 0.0]}}
    found = plan(client, goal={"any_of": [unreachable, {"joints": ASIDE}]})
    np.testing.assert_allclose(found["path"]["joints"][-1], ASIDE)


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


def test_scaling_slows_down(client: httpx.Client) -> None:
    slow = plan(client, timing={"velocity_scaling": 0.2, "acceleration_scaling": 0.1})
    limits = slow["certificate"]["limits"]
    assert limits["velocity"]["worst_ratio"] <= 1.0 + 1e-9
    assert slow["trajectory"]["duration"] > 2.0 * plan(client)["trajectory"]["duration"]
    request = {"robot": "panda", "scene": PLACE, "trajectory": slow["trajectory"]}
    proved = answer(client.post("/v1/validate", json=request))
    assert proved["limits"]["velocity"]["worst_ratio"] <= 0.2 + 1e-9
    assert proved["limits"]["acceleration"]["worst_ratio"] <= 0.1 + 1e-9


def test_the_toppra_package_times_plans_and_its_cost_is_told(client: httpx.Client) -> None:
    found = plan(client, timing={"method": "toppra", "solver": "toppra"})
    assert found["certificate"]["verified"] is True
    for quantity in ("velocity", "acceleration"):
        assert found["certificate"]["limits"][quantity]["worst_ratio"] <= 1.0 + 1e-9
    assert any("toppra's answer" in note for note in found["notes"])
    assert not any("toppra's answer" in note for note in plan(client)["notes"])


def test_margins_are_kept(client: httpx.Client) -> None:
    found = plan(client, margin=0.01, scene=scene(POST | {"margin": 0.02}, FLOOR))
    exact = world(scene(POST))
    for row in positions(found["trajectory"], 100):
        exact.set_configuration(row)
        for k in range(len(exact.pairs)):
            if "post" in exact.pair_names(k):
                assert exact.distance(k) >= 0.03 - 1e-6


def test_what_is_held_is_planned_with(client: httpx.Client) -> None:
    rod = {
        "id": "rod",
        "shape": {"type": "cylinder", "radius": 0.02, "height": 0.3},
        "pose": {"position": [0.0, 0.0, 0.2]},
        "link": "panda_hand",
        "touch_links": ["panda_leftfinger", "panda_rightfinger"],
    }
    links = client.get("/v1/robots/panda").json()["links"]
    rod["touch_links"] = [name for name in links if "finger" in name]
    found = plan(client, attached=[rod])
    assert found["reproducibility"]["robot_hash"] != plan(client)["reproducibility"]["robot_hash"]


def test_a_start_a_hair_outside_is_snapped_and_told(client: httpx.Client) -> None:
    upper = float(builtin_chain("panda").limits.upper[3])
    start = [*HOME[:3], upper + 5e-7, 0.0, 1.571, 0.785]
    found = plan(client, start={"joints": start}, scene=None)
    assert found["notes"]
    assert found["path"]["joints"][0][3] == upper
    tolerance = {"start_state_tolerance": 1e-9}
    response = client.post("/v1/plan", json=BODY | {"start": {"joints": start}} | tolerance)
    details = problem(response, 422, "START_STATE_INVALID")["details"]
    assert details["joint"] == "panda_joint4"
    assert details["limit"] == upper
