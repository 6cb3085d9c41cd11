"""Optimised plans over HTTP."""

from typing import Any

import httpx
import numpy as np
import pytest

from armwright_wire.plans.plan import PlanAnswer
from kinematics.forward import forward
from kinematics.robots import builtin_chain
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


def test_ipopt_is_asked_for_by_name(client: httpx.Client) -> None:
    options = {"planner": "rrt_connect", "seed": 1}
    usual = plan(client, **options, refine={"solver": "piqp"})["trajectory"]["duration"]
    other = plan(client, **options, refine={"solver": "ipopt"})["trajectory"]["duration"]
    np.testing.assert_allclose(other, usual, rtol=0.03)


def test_wishes_cost(client: httpx.Client) -> None:
    chain = builtin_chain("panda")
    here, there = (forward(chain, q)[:3, 3] for q in (HOME, ASIDE))
    region = {"type": "line", "point": here.tolist(), "direction": (there - here).tolist(),
              "tolerance": 0.005}  # fmt: skip
    strayed = []
    for weight in (1e-3, 1e4):
        wish = {"type": "position", "region": region, "weight": weight}
        # Nothing but the wish keeps the motion from the line.
        found = plan(client, planner="optimize", constraints=[wish], clearance={"preferred": 0.0})
        (use,) = found["certificate"]["path_constraints"]
        assert use["hard"] is False
        strayed.append(use["residual"])
    assert strayed[1] < 0.5 * strayed[0]


def test_refine_false_is_none(client: httpx.Client) -> None:
    assert plan(client, refine=False)["trajectory"] == plan(client)["trajectory"]


def test_ends_that_move(client: httpx.Client) -> None:
    v = [0.2, -0.1, 0.1, 0.0, 0.1, 0.0, -0.2]
    start = {"joints": HOME, "velocities": v, "accelerations": [0.0] * 7}
    goal = {"joints": ASIDE, "velocities": [-x for x in v]}
    found = plan(client, start=start, goal=goal, planner="optimize")
    segments = found["trajectory"]["segments"]
    np.testing.assert_allclose([row[1] for row in segments[0]["coefficients"]], v, atol=1e-8)
    last = segments[-1]
    h = last["t1"] - last["t0"]
    ends = [
        sum(k * c * h ** (k - 1) for k, c in enumerate(row) if k) for row in last["coefficients"]
    ]
    np.testing.assert_allclose(ends, [-x for x in v], atol=1e-8)
