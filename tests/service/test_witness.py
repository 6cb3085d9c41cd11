"""Witnesses of tasks and tours over HTTP: each stage and leg, with what the robot holds in it."""

import base64
import itertools
from typing import Any

import httpx
import pytest

from tests.planning.witness.problems import checker, rejected
from tests.service.robots import answer, problem
from tests.service.test_tasks import TASK


def read(certificate: dict[str, Any]) -> dict[str, Any]:
    """The document of a certificate's witness, accepted by the checker."""
    told = certificate["witness"]
    document: dict[str, Any] = checker().read(base64.b64decode(told["compact"]))
    assert rejected(document) is None
    assert document["unwitnessed"] == told["unwitnessed"]
    assert document["hashes"]["scene"] == certificate["premises"]["scene_hash"]
    return document


def test_stages_of_a_task_are_witnessed_with_what_is_held(client: httpx.Client) -> None:
    """The crate stands on the base until it is attached, and then hangs on a body."""
    kept = answer(client.post("/v1/tasks", json=TASK | {"witness": True, "keep": True}))
    documents = [read(stage["certificate"]) for stage in kept["stages"]]
    for before, after in itertools.pairwise(documents):
        assert after["start"] == pytest.approx(before["goal"], abs=1e-9)
    bodies = []
    for stage, document in zip(kept["stages"], documents, strict=True):
        held = {item["id"] for item in stage["after"]["attached"]}
        (crate,) = (row for row in document["solids"] if row["name"] == "crate")
        assert (crate["body"] >= 0) is ("crate" in held)
        bodies.append(crate["body"])
        moving = stage["fingers"] is not None
        assert {"what": "fingers", "count": 1} in document["unwitnessed"] or not moving
    assert {body >= 0 for body in bodies} == {True, False}
    k = bodies.index(max(bodies))
    at = f"/v1/plans/{kept['plan_id']}/witness"
    assert answer(client.get(f"{at}?part={k}")) == documents[k]
    file = client.get(f"{at}?form=compact&part={k}").content
    assert base64.b64encode(file).decode() == kept["stages"][k]["certificate"]["witness"]["compact"]
    told = problem(client.get(f"{at}?part={len(bodies)}"), 422, "VALIDATION_ERROR")
    assert "no part" in told["detail"]
    # Motion that the crate may not make once it hangs on the arm: a larger one is rejected.
    grown = documents[k]
    next(row for row in grown["solids"] if row["name"] == "crate")["rounding"] += 0.5
    assert "not proved apart" in str(rejected(grown))
