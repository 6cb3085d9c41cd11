"""Tours over HTTP: order, legs that others prove once more, jobs, and what is refused."""

from typing import Any

import httpx
import pytest

from armwright_wire.plans.tour import TourAnswer
from tests.service.conftest import Served
from tests.service.jobs.requests import ended, submit
from tests.service.robots import FLOOR, POST, answer, problem, scene

DOWN = [1.0, 0.0, 0.0, 0.0]
START = {"joints": [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]}
GOALS = [
    {"id": f"hole_{k}", "pose": {"position": [0.45, y, 0.4], "quaternion_xyzw": DOWN},
     "tolerance": {"free": ["rz"], "samples": 3}, "dwell": 0.5}
    for k, y in enumerate((-0.35, 0.08, -0.1, -0.22))
]  # fmt: skip


def body(**fields: Any) -> dict[str, Any]:
    given = {"robot": "panda", "scene": scene(FLOOR, POST), "start": START, "goals": GOALS,
             "rounds": 2, "timeout": 60.0}  # fmt: skip
    return {name: value for name, value in (given | fields).items() if value is not None}


@pytest.fixture(scope="module")
def tour(served: Served) -> dict[str, Any]:
    found: dict[str, Any] = answer(served.client.post("/v1/tours", json=body(end="start")))
    TourAnswer.model_validate(found)
    return found


def test_legs_are_valid_for_the_service_that_proves_motions(
    client: httpx.Client, tour: dict[str, Any]
) -> None:
    assert tour["status"] == "complete"
    assert sorted(tour["order"]) == [goal["id"] for goal in GOALS]
    assert [leg["target"] for leg in tour["legs"]] == [*tour["order"], None]
    assert [leg["origin"] for leg in tour["legs"]] == [None, *tour["order"]]
    for leg in tour["legs"]:
        motion = {"joint_names": tour["joint_names"], "segments": leg["trajectory"]["segments"]}
        about = {"robot": "panda", "scene": scene(FLOOR, POST), "trajectory": motion}
        assert answer(client.post("/v1/validate", json=about))["verified"]
        assert leg["certificate"]["verified"]


def test_visits_say_which_configuration_was_chosen_and_what_it_costs(
    client: httpx.Client, tour: dict[str, Any]
) -> None:
    for visit in tour["visits"]:
        chosen = visit["configuration"]
        assert chosen["found"] >= 1
        assert set(chosen["costs"]) == {
            "motion_time", "joint_limits", "manipulability", "clearance", "turns",
        }  # fmt: skip
        assert chosen["limit_share"] >= 0.02 or "limit" in chosen["reason"]
    only_time = dict.fromkeys(("joint_limits", "manipulability", "clearance", "turns"), 0.0)
    quick = answer(client.post("/v1/tours", json=body(end="start", goal_costs=only_time)))
    assert quick["time"] <= tour["time"] + 1e-6
    costs = [visit["configuration"]["costs"] for visit in quick["visits"]]
    assert all(cost["joint_limits"] == cost["turns"] == 0.0 for cost in costs)


def test_the_same_seed_gives_the_same_bytes(client: httpx.Client) -> None:
    asked = body(rounds=1)
    first, second = (client.post("/v1/tours", json=asked).content for _ in range(2))
    assert first == second


def test_as_a_job_it_reports_progress_and_the_same(client: httpx.Client) -> None:
    asked = body(rounds=0)
    result = ended(client, submit(client, asked, "/v1/tours"))["result"]
    assert result.pop("plan_id")  # answers of jobs are kept
    assert result == answer(client.post("/v1/tours", json=asked))


def test_what_is_out_of_reach_is_named_or_left_out(client: httpx.Client) -> None:
    far = {"id": "far", "pose": {"position": [2.0, 0.0, 0.4], "quaternion_xyzw": DOWN}}
    inside = {"id": "inside", "joints": [*START["joints"][:3], -0.1, *START["joints"][4:]]}
    goals = [GOALS[0], far, GOALS[1], inside]
    rules = [["far", "hole_1"]]
    asked = body(goals=goals, rounds=0, precedence=rules)
    refusal = problem(client.post("/v1/tours", json=asked), 422, "NO_IK_SOLUTION")
    assert "goals[1] ('far')" in refusal["detail"]
    named = {one["index"] for one in refusal["details"]["unvisited"]}
    assert 1 in named
    partial = answer(client.post("/v1/tours", json=asked | {"allow_partial": True}))
    assert partial["status"] == "partial"
    codes = {one["id"]: one["code"] for one in partial["unvisited"]}
    assert codes["far"] == "NO_IK_SOLUTION"
    assert codes["hole_1"] == "PREDECESSOR_LEFT_OUT"
    assert "hole_0" in partial["order"]


def test_constraints_hold_on_every_leg_and_the_tour_is_kept(client: httpx.Client) -> None:
    cone = {"type": "orientation", "axis": [0, 0, 1], "direction": [0, 0, -1], "cone_angle": 0.4}
    asked = body(start=None, goals=GOALS[:2], constraints=[cone], rounds=0, keep=True)
    found = answer(client.post("/v1/tours", json=asked))
    (proved,) = found["legs"][0]["certificate"]["path_constraints"]
    assert proved["residual"] <= 0.0
    kept = answer(client.get(f"/v1/plans/{found['plan_id']}"))
    assert kept["operation"] == "POST /v1/tours"
    assert kept["answer"]["order"] == found["order"]
    narrow = cone | {"direction": [1, 0, 0]}
    refusal = problem(
        client.post("/v1/tours", json=asked | {"constraints": [narrow]}), 422,
        "GOAL_VIOLATES_PATH_CONSTRAINTS",
    )  # fmt: skip
    assert refusal["details"]["unvisited"][0]["index"] == 0


def test_a_deadline_is_kept(client: httpx.Client) -> None:
    refusal = problem(client.post("/v1/tours", json=body(timeout=0.01)), 504, "TIMED_OUT")
    assert "allow" in str(refusal["hint"]).lower()
