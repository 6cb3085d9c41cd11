"""Answers may hold more than is known here, and are read where they are known."""

import json
from typing import Any

import pytest
from pydantic import ValidationError

import armwright_client as ours

PLAN: dict[str, Any] = {
    "status": "success",
    "frame": "base",
    "planner": "straight_line",
    "stages": [{"name": "straight_line", "outcome": "succeeded", "milliseconds": 1.5}],
    "path": {"joints": [[0.0], [1.0]], "length": 1.0},
    "trajectory": {
        "joint_names": ["j"],
        "duration": 1.0,
        "segments": [{"t0": 0, "t1": 1, "coefficients": [[0, 1]]}],
        "samples": {
            "time": [0.0],
            "position": [[0.0]],
            "velocity": [[1.0]],
            "acceleration": [[0.0]],
        },
    },
    "certificate": {
        "verified": True,
        "proved": {"limits": True, "collisions": True, "reasons": []},
        "min_clearance": 0.1,
        "clearance_pair": ["hand", "table"],
        "method": "distances",
        "limits": {"position": {"worst_ratio": 0.5, "joint": "j", "time": 0.5}},
    },
    "reproducibility": {
        "seed": 0,
        "robot_hash": "a",
        "scene_hash": "b",
        "request_hash": "c",
        "versions": {"armwright": "0.1.0"},
    },
}


def grown(value: Any) -> Any:
    """The same document from a service that answers more everywhere."""
    if isinstance(value, dict):
        return {name: grown(item) for name, item in value.items()} | {"from_the_future": [1, {}]}
    return [grown(item) for item in value] if isinstance(value, list) else value


def read(document: Any) -> ours.Plan:
    return ours.Plan.read(json.dumps(document).encode())


def test_a_plan_is_read() -> None:
    plan = read(PLAN)
    assert plan.trajectory.sample([0.25]) == [[0.25]]
    assert plan.certificate.clearance_pair == ("hand", "table")
    assert plan.certificate.limits is not None
    assert plan.certificate.limits.velocity is None
    assert plan.stages[0].detail is None
    assert plan.notes == []


def test_what_is_not_known_is_passed_over() -> None:
    document = grown(PLAN)
    document["reproducibility"]["versions"] = {"armwright": "0.1.0"}  # these names are open
    assert read(document) == read(PLAN)


def test_a_stored_scene_of_a_newer_service_can_be_stored_again() -> None:
    pose = {"position": [1, 2, 3]}
    obstacle = {"id": "a", "shape": {"type": "sphere", "radius": 1}, "pose": pose}
    document = {"name": "s", "obstacles": [obstacle]}
    scene = ours.Scene.read(json.dumps(grown(document)).encode())
    assert json.loads(scene.model_dump_json(exclude_none=True)) == document


@pytest.mark.parametrize(
    ("place", "value"),
    [("planner", 3), ("stages", None), ("trajectory", {}), ("certificate", {"verified": "maybe"})],
)
def test_what_has_another_type_is_told(place: str, value: object) -> None:
    with pytest.raises(ValidationError):
        read(PLAN | {place: value})


def test_problems_need_nothing() -> None:
    assert ours.Problem.read(b"{}") == ours.Problem()
    assert ours.Problem().type == "about:blank"
