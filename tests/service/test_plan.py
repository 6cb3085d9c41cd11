"""Plans over HTTP: the domain's, every planner by its name, refinement, and the field."""

import hashlib
import time
from typing import Any

import httpx
import numpy as np
import pytest
from numpy.polynomial import polynomial

from armwright_wire.plans.plan import PlanAnswer, PlanRequest
from armwright_wire.robots.potential import PotentialAnswer
from armwright_wire.scenes.scene import Scene
from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.robots import builtin_chain
from planning.options import Options
from planning.pipeline import pipeline
from planning.pipeline.path_search import PLANNERS
from planning.problem import JointGoal, Problem
from planning.result import Plan
from planning.sampling.planners import PLANNERS as SAMPLING
from planning.sampling.planners import planner_by_name
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import builtin_reference
from service.translate import poses
from tests.service.planning import BODY, PLACE, plan, world
from tests.service.robots import (
    ACCELERATIONS,
    ASIDE,
    DETOUR,
    FLOOR,
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


PLANNERS_BODY = DETOUR | {"timeout": 20.0, "seed": 1}
#: A pose over the table's far side, and a configuration inside the post.
POSE = {"position": [0.35, 0.5, 0.4], "rpy": [3.1, 0.0, 0.3]}
INSIDE = [0.58, 0.4, 0.0, -1.6, 0.0, 2.0, 0.785]


def quick(planner: str) -> dict[str, Any]:
    """Options with which a planner comes to an end soon, wherever it runs."""
    if planner == "potential_field":
        return {"preset": "thorough", "escapes": 5, "max_iterations": 200}
    kind = planner_by_name(planner)
    if kind.batch is not None:
        return {"num_samples": 300}
    if "goal_bias" in kind.options and kind.improves:
        return {"range": 2.0, "goal_bias": 0.3, "max_iterations": 800}
    if planner == "aorrtc":
        return {"cost_threshold": 20.0}
    return {"max_edges": 300, "max_iterations": 1000} if kind.improves else {}


def plan_of_planners(client: httpx.Client, planner: str, **changes: Any) -> dict[str, Any]:
    body = PLANNERS_BODY | {"planner": planner, "planner_options": quick(planner)} | changes
    found = answer(client.post("/v1/plan", json=body))
    PlanAnswer.model_validate(found)
    assert found["planner"] == planner
    assert found["certificate"]["verified"] is True
    return found


def end(found: dict[str, Any]) -> np.ndarray:
    return np.array(found["path"]["joints"][-1])


@pytest.mark.parametrize("planner", ["potential_field", "rrt_connect", "bit_star", "prm"])
def test_any_of_several_goals(client: httpx.Client, planner: str) -> None:
    near = {"pose": POSE, "position_tolerance": 2e-3, "orientation_tolerance": 0.02}
    goals = [{"joints": INSIDE}, near, {"joints": ASIDE}]
    found = plan_of_planners(client, planner, goal={"any_of": goals})
    q = end(found)
    tip = forward(builtin_chain("panda"), q)
    at_pose = np.linalg.norm(tip[:3, 3] - POSE["position"]) <= 2e-3
    assert at_pose or np.allclose(q, ASIDE)
    assert np.allclose(found["path"]["joints"][0], HOME)


def test_planners_that_improve_tell_their_progress(client: httpx.Client) -> None:
    found, again = (plan_of_planners(client, "bit_star") for _ in range(2))
    lengths = [step["length"] for step in found["progress"]]
    assert lengths
    assert lengths == sorted(lengths, reverse=True)
    assert lengths == [step["length"] for step in again["progress"]]
    assert found["trajectory"] == again["trajectory"]
    assert not any("looked for shorter" in note for note in found["notes"])
    late = plan_of_planners(client, "bit_star", planner_options={}, timeout=5.0)
    assert any("looked for shorter" in note for note in late["notes"])


def test_the_field_tells_where_it_went(client: httpx.Client) -> None:
    goal = {"joints": [0.4, *HOME[1:]]}
    found = plan_of_planners(
        client, "potential_field", goal=goal, planner_options={}, scene=scene(FLOOR)
    )
    told = found["potential_field"]
    assert len(told["joints"]) == len(told["potentials"]) == told["iterations"] + 2
    assert told["joints"][0] == HOME
    assert told["potentials"][-1] < told["potentials"][0]
    assert found["progress"] == []
    short = {"max_iterations": 1, "fallback": None}
    body = PLANNERS_BODY | {"planner": "potential_field", "planner_options": short}
    stuck = problem(client.post("/v1/plan", json=body), 422, "PLANNING_FAILED")
    assert stuck["details"]["iterations"] == 1
    assert len(stuck["details"]["joints"]) == 7
    assert stuck["details"]["potential"] > 0.0
    assert stuck["details"]["ending"] == "steps_used_up"
    way = stuck["details"]["potential_field"]
    assert len(way["joints"]) == len(way["potentials"]) == 2
    assert way["joints"][0] == HOME
    assert way["joints"][-1] == stuck["details"]["joints"]
    assert way["potentials"][-1] == stuck["details"]["potential"]


def test_names_as_ompl_writes_them(client: httpx.Client) -> None:
    for written, name in (("RRTConnect", "rrt_connect"), ("PRM", "prm"), ("KPIECE1", "kpiece1")):
        body = PLANNERS_BODY | {"planner": written}
        assert answer(client.post("/v1/plan", json=body))["planner"] == name


def test_openapi_names_every_planner_and_option(client: httpx.Client) -> None:
    fields = client.get("/openapi.json").json()["components"]["schemas"]["PlanRequest"][
        "properties"
    ]
    for name in PLANNERS:
        assert name in fields["planner"]["description"]
    for name in SAMPLING:
        for option in planner_by_name(name).options:
            assert option in fields["planner_options"]["description"]


def test_a_path_to_be_kept_is_the_fields_own_or_none(client: httpx.Client) -> None:
    ball = {"id": "ball", "shape": {"type": "sphere", "radius": 0.1}}
    body = {
        "robot": "planar_rr", "start": {"joints": [0.0, 0.0]}, "goal": {"joints": [1.5, 0.0]},
        "scene": scene(ball | {"pose": {"position": [1.3, 0.0, 1.3]}}),
        "planner": "potential_field", "timeout": 5.0,
    }  # fmt: skip
    assert answer(client.post("/v1/plan", json=body))["planner"] == "rrt_connect"
    kept = client.post("/v1/plan", json=body | {"planner_options": {"keep_path": True}})
    assert problem(kept, 422, "PLANNING_FAILED")["stage"] == "potential_field"


def refined(client: httpx.Client, **changes: Any) -> dict[str, Any]:
    found = answer(client.post("/v1/plan", json=DETOUR | {"timeout": 300.0} | changes))
    PlanAnswer.model_validate(found)
    assert found["certificate"]["verified"]
    return found


@pytest.mark.parametrize(
    "refine", [True, {"objective": "jerk"}, {"objective": {"time": 1.0, "energy": 1e-4}}]
)
def test_any_planner_is_refined(client: httpx.Client, refine: Any) -> None:
    # The path of this seed leaves something to be gained.
    better = refined(client, planner="rrt_connect", refine=refine, seed=1)
    assert better["planner"] == "optimize"
    assert "rrt_connect" in [stage["name"] for stage in better["stages"]]


def test_refine_false_is_none(client: httpx.Client) -> None:
    assert refined(client, refine=False)["trajectory"] == refined(client)["trajectory"]


GOAL = [0.6, -0.3, 0.0, -2.0, 0.0, 1.8, 0.785]


def potential(client: httpx.Client, joints: Any, robot: str = "panda", **more: Any) -> Any:
    body = {"joints": joints, "goal_joints": GOAL, "scene": scene(POST, FLOOR)} | more
    found = answer(client.post(f"/v1/robots/{robot}/potential", json=body))
    PotentialAnswer.model_validate(found)
    return found


def test_projections_by_fcl_make_the_same_field(client: httpx.Client) -> None:
    exact, fcl = potential(client, HOME), potential(client, HOME, engine="fcl")
    assert fcl != exact
    assert fcl["potential"] == pytest.approx(exact["potential"], rel=1e-6)
    assert fcl["joint_force"] == pytest.approx(exact["joint_force"], rel=1e-5, abs=1e-6)


def test_at_the_goal_nothing_pulls(client: httpx.Client) -> None:
    found = potential(client, GOAL, scene=None)
    assert found["potential"] == 0.0
    assert found["gradient"] == [0.0] * 7
    assert found["control_points"][0]["projection"] is None
    assert found["control_points"][0]["distance"] is None
    assert found["control_points"][0]["obstacle"] is None
