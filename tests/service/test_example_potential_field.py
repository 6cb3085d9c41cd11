"""Potential fields by FCL, splines in time, and OMPL where the field is stuck: over HTTP."""

import importlib.util
from pathlib import Path
from types import ModuleType
from typing import Any

import httpx
import pytest

from armwright_client import Client, PlanningFailed
from tests.service.robots import answer, problem

SOURCE = Path(__file__).parents[2] / "examples/potential_field.py"


@pytest.fixture(scope="module")
def example() -> ModuleType:
    spec = importlib.util.spec_from_file_location("potential_field_example", SOURCE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_example_prints_what_its_page_says(
    client: httpx.Client, example: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    with Client(str(client.base_url)) as connected:
        assert example.turn_all(connected)
    page = (SOURCE.parents[1] / "docs/potential_fields.md").read_text("utf-8")
    assert capsys.readouterr().out.strip() in page


@pytest.mark.parametrize("name", ["panda", "ur5e", "iiwa14"])
def test_the_field_plans_where_it_arrives_and_its_fallback_where_not(
    client: httpx.Client, example: ModuleType, name: str
) -> None:
    with Client(str(client.base_url)) as connected:
        post = example.plan(connected, name, 0.2, 0.3)
        pillar = example.plan(connected, name, 0.5, 0.05)
        other = example.plan(connected, name, 0.5, 0.05, fallback="PRM")
        with pytest.raises(PlanningFailed) as stuck:
            example.plan(connected, name, 0.5, 0.05, fallback=None)
    assert (post.planner, pillar.planner, other.planner) == (
        "potential_field", "rrt_connect", "prm",
    )  # fmt: skip
    assert post.potential_field is not None
    assert post.potential_field.iterations > 10
    for plan in (post, pillar, other):
        assert plan.certificate.verified
        assert plan.timing.method == "spline"
    stages = {stage.name: stage for stage in pillar.stages}
    assert list(stages)[:3] == ["preflight", "potential_field", "rrt_connect"]
    assert stages["potential_field"].outcome == "failed"
    assert stages["potential_field"].detail.startswith(("Blocked", "A kink", "A local minimum"))
    assert stages["rrt_connect"].outcome == "succeeded"
    assert stuck.value.details["ending"] in ("blocked", "kink", "local_minimum")


def asked(**options: Any) -> dict[str, Any]:
    return {
        "robot": "planar_rr", "start": {"joints": [0.0, 0.0]}, "goal": {"joints": [1.5, 0.0]},
        "scene": {"obstacles": [{
            "id": "ball", "shape": {"type": "sphere", "radius": 0.1},
            "pose": {"position": [1.3, 0.0, 1.3]},
        }]},
        "planner": "potential_field", "planner_options": options, "timeout": 5.0,
    }  # fmt: skip


def test_a_path_to_be_kept_is_the_fields_own_or_none(client: httpx.Client) -> None:
    assert answer(client.post("/v1/plan", json=asked()))["planner"] == "rrt_connect"
    kept = problem(client.post("/v1/plan", json=asked(keep_path=True)), 422, "PLANNING_FAILED")
    assert kept["stage"] == "potential_field"
    both = client.post("/v1/plan", json=asked(keep_path=True, fallback="rrt_connect"))
    assert "Leave one of them out" in problem(both, 422, "VALIDATION_ERROR")["hint"]


@pytest.mark.parametrize("name", ["auto", "optimize", "magic", 3])
def test_only_planners_of_ompl_are_fallbacks(client: httpx.Client, name: object) -> None:
    refused = problem(client.post("/v1/plan", json=asked(fallback=name)), 422, "VALIDATION_ERROR")
    assert "planner_options.fallback" in refused["detail"]
