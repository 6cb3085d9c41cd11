"""Constraints over HTTP: configurations, plans, foreign motions, and what is refused."""

import time
from typing import Any

import httpx
import numpy as np
import pytest

from armwright_wire.motions.certificate import CertificateAnswer
from armwright_wire.plans.plan import PlanAnswer
from armwright_wire.robots.kinematics import IkAnswer
from kinematics.forward import forward
from kinematics.robots import builtin_chain
from service.endpoints.ik import task
from tests.service.endpoints.ask import PANDA, problem_of
from tests.service.robots import HOME, POST, answer, problem, scene

CHAIN = builtin_chain("panda")
UPRIGHT = {
    "type": "orientation", "axis": [0, 0, 1], "direction": [0, 0, -1], "cone_angle": 0.1745
}  # fmt: skip
PLACE = {
    "type": "position",
    "region": {"type": "sphere", "center": [0.4, 0.3, 0.4], "radius": 1e-3},
}


def ik(client: httpx.Client, **body: Any) -> Any:
    return ik_answer(client, **body)["solutions"]


def ik_answer(client: httpx.Client, **body: Any) -> Any:
    found = answer(client.post("/v1/robots/panda/ik", json={"method": "constrained"} | body))
    IkAnswer.model_validate(found)
    return found


def tilt(q: Any) -> float:
    return float(np.arccos(np.clip(-forward(CHAIN, q)[2, 2], -1.0, 1.0)))


def at(client: httpx.Client, y: float) -> Any:
    region = {"type": "sphere", "center": [0.4, y, 0.4], "radius": 1e-3}
    wanted = [UPRIGHT | {"cone_angle": 0.12}, {"type": "position", "region": region}]
    return ik(client, constraints=wanted, seed_joints=HOME)[0]["joints"]


def test_constraints_alone_say_what_is_wanted(client: httpx.Client) -> None:
    (best,) = ik(client, constraints=[UPRIGHT, PLACE])
    assert tilt(best["joints"]) <= 0.1745 + 1e-6
    tip = forward(CHAIN, best["joints"])[:3, 3]
    assert np.linalg.norm(tip - [0.4, 0.3, 0.4]) <= 1e-3 + 1e-6
    assert best["position_error"] is None
    assert [(use["constraint"], use["unit"], use["hard"]) for use in best["constraints"]] == [
        (0, "rad", True), (1, "m", True)
    ]  # fmt: skip
    assert all(use["residual"] <= 1e-6 for use in best["constraints"])


@pytest.mark.parametrize("method", ["auto", "constrained"])
def test_a_pose_with_a_margin(client: httpx.Client, method: str) -> None:
    pose = {"position": [0.4, -0.2, 0.4], "rpy": [np.pi, 0, 0]}
    body = {"method": method, "pose": pose, "scene": scene(POST)}
    (best,) = ik(client, **body, constraints=[{"type": "clearance", "margin": 0.02}])
    assert best["collision_free"] is True
    assert best["clearance"] > 0.0
    assert best["position_error"] < 1e-6
    assert best["orientation_error"] < 1e-6
    assert best["constraints"][-1]["name"] == "pose of the tip seen from the base"


def test_a_plan_holds_them_for_every_instant(client: httpx.Client) -> None:
    body = {
        "robot": "panda", "scene": scene(POST), "start": {"joints": at(client, -0.3)},
        "goal": {"joints": at(client, 0.0)}, "timeout": 60,
        "constraints": [UPRIGHT, {"type": "tool_speed", "limit": 0.4}],
        "timing": {"sample_period": 0.01},
    }  # fmt: skip
    found = answer(client.post("/v1/plan", json=body))
    PlanAnswer.model_validate(found)
    certificate = found["certificate"]
    assert certificate["verified"]
    assert certificate["path_constraint_residual"] == 0.0
    assert certificate["path_constraints"][0]["residual"] <= 1e-6
    assert certificate["limits"]["tool_speed"]["worst_ratio"] <= 1.0 + 1e-9
    assert max(map(tilt, found["trajectory"]["samples"]["position"])) <= 0.1745 + 1e-6
    # What was answered proves itself, and a narrower cone finds where it does not.
    proof = {name: body[name] for name in ("robot", "scene", "constraints")}
    proof["trajectory"] = {"segments": found["trajectory"]["segments"]}
    judged = answer(client.post("/v1/validate", json=proof))
    CertificateAnswer.model_validate(judged)
    assert judged["verified"]
    widest = max(map(tilt, found["trajectory"]["samples"]["position"]))
    proof["constraints"] = [UPRIGHT | {"cone_angle": 0.9 * widest}]
    judged = answer(client.post("/v1/validate", json=proof))
    assert not judged["verified"]
    assert judged["violation"]["kind"] == "path_constraint"
    assert judged["path_constraint_residual"] > 0.05 * widest


def plan(client: httpx.Client, code: str, **change: Any) -> Any:
    body = {"robot": "panda", "start": {"joints": HOME}, "goal": {"joints": HOME}} | change
    return problem(client.post("/v1/plan", json=body), 422, code)


def test_violations_name_the_constraint_and_by_how_much(client: httpx.Client) -> None:
    held = at(client, 0.3)
    tilted = [*held[:5], held[5] + 0.5, held[6]]
    excess = tilt(tilted) - 0.1745
    ends = {"start": {"joints": held}, "goal": {"joints": held}, "constraints": [UPRIGHT]}
    for end, code in (
        ("start", "START_STATE_VIOLATES_PATH_CONSTRAINTS"),
        ("goal", "GOAL_VIOLATES_PATH_CONSTRAINTS"),
    ):
        document = plan(client, code, **(ends | {end: {"joints": tilted}}))
        assert document["details"]["constraint"] == 0
        assert document["details"]["residual"] == pytest.approx(excess, abs=1e-6)
        assert document["stage"] == end


def planes(*heights: float) -> list[dict[str, Any]]:
    return [
        {"type": "position", "region": {"type": "plane", "point": [0, 0, z], "normal": [0, 0, 1],
                                        "tolerance": 0.01}}
        for z in heights
    ]  # fmt: skip


def test_impossible_sets_name_their_conflict(client: httpx.Client) -> None:
    document = plan(client, "INVALID_GOAL_CONSTRAINTS", constraints=[UPRIGHT, *planes(0.2, 0.6)])
    assert document["details"]["constraints"] == [1, 2]
    assert "0.38 m" in document["hint"]
    body = {"method": "constrained", "constraints": planes(0.2, 0.6)}
    refused = client.post("/v1/robots/panda/ik", json=body)
    document = problem(refused, 422, "INVALID_GOAL_CONSTRAINTS")
    assert document["details"]["conflict"] == [0, 1]
    np.testing.assert_allclose(document["details"]["relaxations"], 0.38, atol=1e-3)


@pytest.mark.parametrize("share", [0.1, 0.4])
def test_an_impossible_set_costs_no_more_than_its_timeout(share: float) -> None:
    """A search for who excludes whom among twelve planes ends at a share of the time it takes."""
    body = {"method": "constrained", "constraints": planes(*np.arange(12) / 12)}
    for _ in range(2):  # The first one also loads kernels.
        began = time.process_time()
        assert problem_of(task.ik, PANDA, body | {"timeout": 60.0}).details["conflict"]
        timeout = share * (time.process_time() - began)
    began = time.process_time()
    late = problem_of(task.ik, PANDA, body | {"timeout": timeout})
    assert time.process_time() - began < timeout + 0.1
    assert late.code in ("NO_IK_SOLUTION", "INVALID_GOAL_CONSTRAINTS")
    assert late.details["deterministic"] is False
    assert late.details["nearest_joints"]


def test_a_search_that_time_ended_says_so(client: httpx.Client) -> None:
    assert ik_answer(client, constraints=[UPRIGHT, PLACE], timeout=60.0)["deterministic"]
    body = {"method": "constrained", "constraints": [UPRIGHT, PLACE], "timeout": 1e-6}
    late = problem_of(task.ik, PANDA, body)
    assert late.details["deterministic"] is False
