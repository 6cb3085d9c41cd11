"""Every planner by its name over HTTP, plans that are optimised, and the potential of the field."""

from typing import Any

import httpx
import numpy as np
import pytest

from armwright_wire.plans.plan import PlanAnswer
from armwright_wire.robots.potential import PotentialAnswer
from kinematics.forward import forward
from kinematics.robots import builtin_chain
from planning.pipeline.path_search import PLANNERS
from planning.sampling.planners import PLANNERS as SAMPLING
from planning.sampling.planners import planner_by_name
from tests.service.robots import ASIDE, DETOUR, FLOOR, HOME, POST, answer, problem, scene

BODY = DETOUR | {"timeout": 20.0, "seed": 1}
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


def plan(client: httpx.Client, planner: str, **changes: Any) -> dict[str, Any]:
    body = BODY | {"planner": planner, "planner_options": quick(planner)} | changes
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
    found = plan(client, planner, goal={"any_of": goals})
    q = end(found)
    tip = forward(builtin_chain("panda"), q)
    at_pose = np.linalg.norm(tip[:3, 3] - POSE["position"]) <= 2e-3
    assert at_pose or np.allclose(q, ASIDE)
    assert np.allclose(found["path"]["joints"][0], HOME)


def test_planners_that_improve_tell_their_progress(client: httpx.Client) -> None:
    found, again = (plan(client, "bit_star") for _ in range(2))
    lengths = [step["length"] for step in found["progress"]]
    assert lengths
    assert lengths == sorted(lengths, reverse=True)
    assert lengths == [step["length"] for step in again["progress"]]
    assert found["trajectory"] == again["trajectory"]
    assert not any("looked for shorter" in note for note in found["notes"])
    late = plan(client, "bit_star", planner_options={}, timeout=5.0)
    assert any("looked for shorter" in note for note in late["notes"])


def test_the_field_tells_where_it_went(client: httpx.Client) -> None:
    goal = {"joints": [0.4, *HOME[1:]]}
    found = plan(client, "potential_field", goal=goal, planner_options={}, scene=scene(FLOOR))
    told = found["potential_field"]
    assert len(told["joints"]) == len(told["potentials"]) == told["iterations"] + 2
    assert told["joints"][0] == HOME
    assert told["potentials"][-1] < told["potentials"][0]
    assert found["progress"] == []
    short = {"max_iterations": 1, "fallback": None}
    body = BODY | {"planner": "potential_field", "planner_options": short}
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
        body = BODY | {"planner": written}
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
