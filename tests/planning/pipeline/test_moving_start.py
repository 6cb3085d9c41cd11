"""Plans that begin while the arm moves, by planners that begin at rest."""

import numpy as np
import pytest

from kinematics.errors import InvalidOption
from kinematics.pose import transform
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.problem import JointGoal, Problem
from planning.result import Failure, Plan
from planning.timing.options import Method, TimingOptions
from tests.planning.scenes import builtin

START = np.array([0.6, -0.5, 0.0, -2.2, 0.0, 1.7, 0.8])
GOAL = START * np.array([-1.0, 1, 1, 1, 1, 1, 1])
POST = Obstacle("post", Box((0.1, 0.1, 1.0)), transform(None, (0.5, 0.0, 0.5)))
MOVING = np.array([-0.5, 0.3, 0.0, 0.2, 0.0, 0.0, 0.4])
TURNING = np.array([2.0, -1.0, 0.0, 0.0, 0.0, 1.0, 0.0])


def _problem(velocity: np.ndarray, scene: Scene = Scene((POST,))) -> Problem:  # noqa: B008
    robot = builtin("panda")
    return Problem(robot, scene, START, (JointGoal(GOAL),), start_velocity=velocity,
                   start_acceleration=TURNING)  # fmt: skip


@pytest.mark.parametrize("planner", ["auto", "rrt_connect", "prm", "potential_field"])
@pytest.mark.parametrize("method", ["jerk_limited", "toppra"])
def test_any_planner_and_timing_leaves_a_moving_start(planner: str, method: Method) -> None:
    options = Options(planner=planner, timing=TimingOptions(method), timeout=4.0, stops="both")
    found = plan(_problem(MOVING), options)
    assert isinstance(found, Plan), found
    assert found.certificate.verified
    assert found.stops is not None
    assert found.stops.proved
    rates = [found.trajectory.sample([0.0], order)[0] for order in range(3)]
    assert np.allclose(rates, [START, MOVING, TURNING], atol=1e-9)
    assert np.allclose(found.trajectory.end, GOAL)
    assert found.trajectory.continuity().velocity < 1e-9
    assert "brakes to rest" in found.notes[-1]


def test_a_start_that_can_not_brake_in_time_is_refused() -> None:
    wall = Obstacle("wall", Box((0.4, 0.4, 1.0)), transform(None, (0.55, 0.42, 0.5)))
    near = np.array([0.0, -0.5, 0.0, -2.2, 0.0, 1.7, 0.8])
    toward = np.array([2.1, 0, 0, 0, 0, 0, 0])
    robot = builtin("panda")
    for q0 in np.linspace(0.6, -1.0, 81):
        start = near + np.array([q0, 0, 0, 0, 0, 0, 0])
        goal = JointGoal(start - np.array([0.2, 0, 0, 0, 0, 0, 0]))
        still = plan(Problem(robot, Scene((wall,)), start, (goal,)), Options(timeout=4.0))
        if isinstance(still, Plan):
            break
    moving = Problem(robot, Scene((wall,)), start, (goal,), start_velocity=toward)
    answer = plan(moving, Options(timeout=4.0))
    assert isinstance(answer, Failure)
    assert answer.code in {"INVALID_MOTION_PLAN", "START_STATE_IN_COLLISION"}
    assert "wall" in answer.message


def test_goals_that_move_still_need_an_optimised_motion() -> None:
    robot = builtin("panda")
    goal = JointGoal(GOAL, np.full(7, 0.1))
    problem = Problem(robot, Scene(), START, (goal,), start_velocity=MOVING)
    with pytest.raises(InvalidOption, match="only an optimised motion"):
        plan(problem, Options())
