"""Plans that leave the motion of a kept plan, over HTTP."""

from typing import Any

import httpx
import numpy as np
import pytest

from tests.service.planning import BODY, PLACE, plan
from tests.service.robots import answer, problem
from tests.service.test_stops import trajectory


@pytest.fixture(scope="module")
def kept(client: httpx.Client) -> dict[str, Any]:
    return plan(client, keep=True)


def test_a_plan_leaves_a_kept_one_in_the_same_state(
    client: httpx.Client, kept: dict[str, Any]
) -> None:
    old, at = trajectory(kept["trajectory"]), 0.4
    start = {"plan": kept["plan_id"], "at": at}
    back = {"joints": old.start.tolist()}
    found = answer(
        client.post("/v1/plan", json=BODY | {"start": start, "goal": back, "keep": True})
    )
    assert found["planner"] != "stop"
    assert found["certificate"]["verified"]
    assert any("proved together with the motion that it leaves" in n for n in found["notes"])
    new = trajectory(found["trajectory"])
    for order in range(3):
        assert np.allclose(new.sample([0.0], order), old.sample([at], order), atol=1e-9)
    assert np.allclose(new.end, old.start)
    # What the arm runs in all: the old piece and the new motion.
    head = old.split(at)[0]
    joined = {"joint_names": list(old.joint_names), "segments": [
        {"t0": t0, "t1": t1, "coefficients": c.tolist()}
        for motion, begins in ((head, 0.0), (new, at))
        for t0, t1, c in zip(motion.breaks[:-1] + begins, motion.breaks[1:] + begins,
                             motion.coefficients, strict=True)]}  # fmt: skip
    about = {"robot": "panda", "scene": PLACE, "trajectory": joined}
    assert answer(client.post("/v1/validate", json=about))["verified"]


def test_the_stop_of_the_old_motion_is_answered_where_no_new_one_is_proved(
    client: httpx.Client, kept: dict[str, Any]
) -> None:
    old, at = trajectory(kept["trajectory"]), 0.4
    blocked = {"joints": [0.0, 1.7, 0.0, -0.2, 0.0, 0.5, 0.0]}
    body = BODY | {"start": {"plan": kept["plan_id"], "at": at}, "goal": blocked}
    found = answer(client.post("/v1/plan", json=body))
    assert found["planner"] == "stop"
    assert found["certificate"]["verified"]
    assert "no new motion was proved" in found["notes"][-1]
    stop = trajectory(found["trajectory"])
    for order in range(2):
        assert np.allclose(stop.sample([0.0], order), old.sample([at], order), atol=1e-9)
    assert np.abs(stop.sample([stop.duration], 1)).max() < 1e-9


def test_odd_splices_are_refused(client: httpx.Client, kept: dict[str, Any]) -> None:
    for start, code, word in (
        ({"plan": "nothing", "at": 0.1}, "NOT_FOUND", "nothing"),
        ({"plan": kept["plan_id"], "at": 99.0}, "VALIDATION_ERROR", "outside the motion"),
        ({"plan": kept["plan_id"], "at": 0.1, "velocities": [0.0] * 7}, "VALIDATION_ERROR",
         "velocities"),
        ({"joints": BODY["start"]["joints"], "at": 0.1}, "VALIDATION_ERROR", "at"),
    ):  # fmt: skip
        status = 404 if code == "NOT_FOUND" else 422
        said = problem(client.post("/v1/plan", json=BODY | {"start": start}), status, code)
        assert word in said["detail"]
