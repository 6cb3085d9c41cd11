"""Optimised plans over HTTP."""

from typing import Any

import httpx
import numpy as np
import pytest

from armwright_wire.plans.plan import PlanAnswer
from tests.service.robots import ASIDE, FLOOR, HOME, POST, answer, scene

BODY: dict[str, Any] = {
    "robot": "panda",
    "scene": scene(POST, FLOOR),
    "start": {"joints": HOME},
    "goal": {"joints": ASIDE},
    "timeout": 300.0,
}


def plan(client: httpx.Client, **changes: Any) -> dict[str, Any]:
    found = answer(client.post("/v1/plan", json=BODY | changes))
    PlanAnswer.model_validate(found)
    assert found["certificate"]["verified"]
    return found


def test_the_planner_optimize_is_no_worse_than_the_ladder(client: httpx.Client) -> None:
    known, better = plan(client), plan(client, planner="optimize")
    assert better["trajectory"]["duration"] <= known["trajectory"]["duration"]
    smooth = plan(client, planner="optimize", planner_options={"objective": "jerk"})
    assert smooth["planner"] == "optimize"
    assert smooth["certificate"]["limits"]["jerk"]["worst_ratio"] <= 1.0
    names = [stage["name"] for stage in better["stages"]]
    # What is known is proved before it is optimised, and again what came of that.
    first, *more = [i for i, name in enumerate(names) if name == "certificate"]
    assert names.index("timing") < first < names.index("optimize")
    assert bool(more) == (better["planner"] == "optimize")
    np.testing.assert_allclose(better["path"]["joints"][0], HOME, atol=1e-9)
    np.testing.assert_allclose(better["path"]["joints"][-1], ASIDE, atol=1e-9)


@pytest.mark.parametrize(
    "refine", [True, {"objective": "jerk"}, {"objective": {"time": 1.0, "energy": 1e-4}}]
)
def test_any_planner_is_refined(client: httpx.Client, refine: Any) -> None:
    # The path of this seed leaves something to be gained.
    better = plan(client, planner="rrt_connect", refine=refine, seed=1)
    assert better["planner"] == "optimize"
    assert "rrt_connect" in [stage["name"] for stage in better["stages"]]


def test_refine_false_is_none(client: httpx.Client) -> None:
    assert plan(client, refine=False)["trajectory"] == plan(client)["trajectory"]
