"""Stops over HTTP: proved with plans, proofs and timings, and as motions of kept plans."""

import json
from typing import Any

import httpx
import numpy as np
import pytest

from armwright_client import Client
from armwright_wire.plans.kept_plan import StopAnswer
from kinematics.trajectory.trajectory import Trajectory
from tests.service.planning import BODY, PLACE, plan
from tests.service.robots import answer, problem

#: Limits of weak brakes: with these stops take a fifth of a radian and more.
WEAK = {"acceleration": [1.5] * 7}


@pytest.fixture(scope="module")
def kept(client: httpx.Client) -> dict[str, Any]:
    """A plan with proved stops, which was kept."""
    return plan(client, stops="both", limits=WEAK, keep=True)


def trajectory(motion: dict[str, Any]) -> Trajectory:
    """A trajectory of an answer."""
    segments = motion["segments"]
    breaks = [segments[0]["t0"], *(one["t1"] for one in segments)]
    pieces = [one["coefficients"] for one in segments]
    return Trajectory(tuple(motion["joint_names"]), np.array(breaks), np.array(pieces))


def test_a_plan_tells_of_its_stops_only_where_they_are_asked_for(
    client: httpx.Client, kept: dict[str, Any]
) -> None:
    assert plan(client)["certificate"].get("stops") is None
    stops = kept["certificate"]["stops"]
    assert stops["kind"] == "both"
    assert stops["proved"]
    assert stops["message"] is None
    assert 0.0 < stops["longest"] < kept["trajectory"]["duration"]
    assert stops["worst"]["clearance"] > 0.0
    assert [stage["name"] for stage in kept["stages"]][-1] == "stops"


def test_a_motion_whose_joints_can_not_stop_in_time_is_slowed_down(client: httpx.Client) -> None:
    fast = plan(client, limits={"acceleration": [15.0] * 7}, margin=0.0)
    about = {"robot": "panda", "scene": PLACE, "trajectory": fast["trajectory"]}
    weak = {"velocity": [9.0] * 7, "acceleration": [15.0] * 7, "jerk": [1e5] * 7}
    sound = answer(client.post("/v1/validate", json=about | {"limits": weak, "stops": "joints"}))
    assert sound["verified"]
    assert sound["stops"]["kind"] == "joints"
    # Of a proof nothing is slowed down.
    assert sound["stops"]["slowed"] == 0.0


@pytest.mark.parametrize("kind", ["path", "joints"])
def test_a_stop_of_a_kept_plan_begins_on_it_and_ends_at_rest(
    client: httpx.Client, kept: dict[str, Any], kind: Any
) -> None:
    motion, at = trajectory(kept["trajectory"]), 0.4 * kept["trajectory"]["duration"]
    with Client(str(client.base_url)) as connected:
        told = connected.plans.stop(kept["plan_id"], at, kind=kind)
    assert isinstance(told, StopAnswer)
    assert told.certificate.verified
    assert told.kind == kind
    stop = trajectory(told.trajectory.model_dump())
    for order in range(2):
        np.testing.assert_allclose(
            stop.sample([0.0], order), motion.sample([at], order), atol=1e-12
        )
    np.testing.assert_allclose(stop.sample([stop.duration], 1), 0.0, atol=1e-9)
    assert stop.duration <= kept["certificate"]["stops"]["longest"] + 1e-9


def test_stops_and_witnesses_of_a_kept_plan_are_of_its_robot_with_its_tool(
    client: httpx.Client,
) -> None:
    made = plan(client, tool="suction_cup", keep=True)
    bare = plan(client, keep=True)
    place = f"/v1/plans/{made['plan_id']}"
    stopped = answer(client.post(f"{place}/stop", json={"at": 0.1}))
    asked, told = made["certificate"]["premises"], stopped["certificate"]["premises"]
    assert (told["tool"], told["robot_hash"]) == (asked["tool"], asked["robot_hash"])
    assert asked["tool"] == "suction_cup/tip"
    document = answer(client.get(f"{place}/witness"))
    assert "suction_cup" in json.dumps(document)
    assert "suction_cup" not in json.dumps(
        answer(client.get(f"/v1/plans/{bare['plan_id']}/witness"))
    )


def test_a_kept_proof_has_stops_too(client: httpx.Client, kept: dict[str, Any]) -> None:
    body = {"robot": "panda", "scene": PLACE, "trajectory": kept["trajectory"], "keep": True}
    proof = answer(client.post("/v1/validate", json=body | {"limits": WEAK, "stops": "path"}))
    assert proof["stops"]["proved"]
    body = {"at": 0.3, "kind": "joints"}
    stops = [
        answer(client.post(f"/v1/plans/{of['plan_id']}/stop", json=body)) for of in (proof, kept)
    ]
    assert stops[0]["trajectory"] == stops[1]["trajectory"]


def test_what_has_no_stop_is_refused(client: httpx.Client, kept: dict[str, Any]) -> None:
    url = f"/v1/plans/{kept['plan_id']}/stop"
    late = problem(client.post(url, json={"at": 1e3}), 422, "VALIDATION_ERROR")
    assert "outside the motion" in late["detail"]
    problem(client.post(url, json={"at": 0.1, "kind": "both"}), 422, "VALIDATION_ERROR")
    problem(client.post("/v1/plans/none/stop", json={"at": 0.1}), 404, "NOT_FOUND")
    checked = {"robot": "panda", "joints": BODY["start"]["joints"], "keep": True}
    still = answer(client.post("/v1/check", json=checked))["plan_id"]
    told = problem(
        client.post(f"/v1/plans/{still}/stop", json={"at": 0.0}), 422, "VALIDATION_ERROR"
    )
    assert "no single motion" in told["detail"]
    problem(client.post("/v1/plan", json=BODY | {"stops": "any"}), 422, "VALIDATION_ERROR")


def test_a_timed_path_has_a_bound_of_its_longest_stop(client: httpx.Client) -> None:
    body = {
        "path": {"joints": [[0.0, 0.0], [1.0, 0.2], [1.2, 1.0]]},
        "limits": {"velocity": [1.0, 1.0], "acceleration": [4.0, 4.0]},
        "timing": {"method": "toppra"},
        "stops": "path",
    }
    stops = answer(client.post("/v1/retime", json=body))["certificate"]["stops"]
    assert stops["proved"]
    # At full speed a joint alone takes v / a.
    assert stops["longest"] >= 1.0 / 4.0
    problem(client.post("/v1/retime", json=body | {"stops": "joints"}), 422, "VALIDATION_ERROR")


def test_every_leg_of_a_tour_and_stage_of_a_task_has_stops(client: httpx.Client) -> None:
    goals = [BODY["start"], BODY["goal"]]
    common = {"robot": "panda", "scene": PLACE, "limits": WEAK, "stops": "joints", "timeout": 60.0}
    tour = answer(client.post("/v1/tours", json=common | {"goals": goals, "end": "start",
                                                        "start": BODY["start"]}))  # fmt: skip
    stages = [{"kind": "move", "goal": BODY["goal"]}, {"kind": "move", "goal": BODY["start"]}]
    task = common | {"start": BODY["start"], "stages": stages}
    done = answer(client.post("/v1/tasks", json=task))
    for leg in (*tour["legs"], *done["stages"]):
        if np.ptp([one["coefficients"][0][0] for one in leg["trajectory"]["segments"]]) == 0.0:
            continue
        stops = leg["certificate"]["stops"]
        assert (stops["kind"], stops["proved"]) == ("joints", True)
        # The validated motion has them too.
        about = {"robot": "panda", "scene": PLACE, "trajectory": leg["trajectory"],
                 "limits": WEAK, "stops": "joints"}  # fmt: skip
        assert answer(client.post("/v1/validate", json=about))["stops"]["proved"]
    blended = task | {"stages": [{**stages[0], "blend": 0.1}, stages[1]]}
    told = problem(client.post("/v1/tasks", json=blended), 422, "VALIDATION_ERROR")
    assert "leave blend of stage 0 out" in told["detail"]
