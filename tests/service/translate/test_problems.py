"""Planning problems and options from the wire."""

from typing import Any

import numpy as np
import pytest

from armwright_wire.plans.plan import PlanRequest
from obstacles.scenes.scene import Scene
from planning.problem import JointGoal, PoseGoal
from service.translate.problems import options, planner_name, problem
from tests.planning.scenes import builtin

ROBOT = builtin("planar_rr")


def request(**fields: Any) -> PlanRequest:
    least = {"robot": "planar_rr", "start": {"joints": [0.0, 0.1]}, "goal": {"joints": [0.5, 0.6]}}
    return PlanRequest.model_validate(least | fields)


@pytest.mark.parametrize(
    ("given", "known"),
    [("RRTConnect", "rrt_connect"), ("rrt_connect", "rrt_connect"), ("AUTO", "auto"),
     ("unheard_of", "unheard_of")],
)  # fmt: skip
def test_planners_may_be_written_as_ompl_writes_them(given: str, known: str) -> None:
    assert planner_name(given) == known


def test_goals_of_each_form() -> None:
    pose = {"position": [1.0, 0.2, 0.0], "rpy": [0.0, 0.0, 0.3]}
    either = {"any_of": [{"joints": [0.1, 0.2]}, {"pose": pose, "position_tolerance": 0.01}]}
    made = problem(request(goal=either, margin=0.02), ROBOT, Scene())
    assert made.margin == 0.02
    np.testing.assert_array_equal(made.start, [0.0, 0.1])
    first, second = made.goals
    assert isinstance(first, JointGoal)
    np.testing.assert_array_equal(first.joints, [0.1, 0.2])
    assert isinstance(second, PoseGoal)
    assert second.position_tolerance == 0.01
    c, s = np.cos(0.3), np.sin(0.3)
    expected = [[c, -s, 0, 1.0], [s, c, 0, 0.2], [0, 0, 1, 0], [0, 0, 0, 1]]
    np.testing.assert_allclose(second.T_base_tip, expected, atol=1e-15)


def test_options_carry_the_time_that_is_left() -> None:
    made = options(request(planner="RRTConnect", planner_options={"range": 0.5}, seed=3),
                   ROBOT.chain, 1.5)  # fmt: skip
    assert (made.planner, made.timeout, made.seed) == ("rrt_connect", 1.5, 3)
    assert made.planner_options == {"range": 0.5}
    assert made.refine is None
    assert options(request(refine=True), ROBOT.chain, 1.0).refine is not None
    assert options(request(refine=False), ROBOT.chain, 1.0).refine is None
