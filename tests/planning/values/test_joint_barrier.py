"""Values of a joint that nothing passes: an elbow that would have to fold through its own arm."""

import math
import re
from functools import cache

import numpy as np
import pytest

from kinematics.robots import builtin_srdf, builtin_urdf
from kinematics.tree.serial_chain import serial_chain
from kinematics.tree.srdf import parse_srdf
from kinematics.urdf.urdf import parse_urdf
from obstacles.collision.checker import Checker
from obstacles.robots.robot_geometry import RobotGeometry, robot_geometry
from obstacles.scenes.scene import Scene
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.problem import JointGoal, Problem
from planning.result import Plan
from planning.values.deadline import Deadline
from planning.values.joint_barrier import joint_barrier
from tests.planning.scenes import HOME, builtin, planning_failure

NEVER = Deadline(math.inf)
START = np.array([0.0, -1.2, 1.5, -1.5, -1.57, 0.0])
TURN = 2.0 * math.pi
ELBOW = 2


@cache
def long_elbow() -> RobotGeometry:
    """A UR5e whose elbow turns further than once."""
    urdf = builtin_urdf("ur5e")
    first = urdf.index('<joint name="elbow_joint"')
    last = urdf.index("</joint>", first)
    wide = re.sub(r'(lower|upper)="(-?)[^"]*"', r'\1="\g<2>6.28"', urdf[first:last])
    description = parse_urdf(urdf[:first] + wide + urdf[last:])
    semantics = parse_srdf(builtin_srdf("ur5e"))
    chain = serial_chain(description, semantics=semantics)
    return robot_geometry(chain, description, {}, semantics)


@pytest.mark.parametrize("elbow", [1.5 - TURN, -1.2 + TURN, 4.5])
def test_an_elbow_beyond_its_own_collision_is_no_matter_of_time(elbow: float) -> None:
    goal = np.array([0.5, -1.0, elbow, -1.2, -1.57, 0.0])
    robot = long_elbow()
    assert Checker.of(robot, Scene()).all_valid(np.array([START, goal]))
    problem = Problem(robot, Scene(), START, (JointGoal(goal),))
    answer = planning_failure(problem, Options(timeout=3.0))
    assert answer.code in ("PLANNING_FAILED", "TIMED_OUT")
    assert "elbow_joint" in answer.message
    assert "likely none exists" in answer.message
    assert "More time does not help" in answer.hint
    assert answer.details["joint"] == "elbow_joint"
    assert abs(answer.details["value"]) == pytest.approx(math.pi, abs=0.4)
    # The other way round, where the arm does not fold through itself.
    around = answer.details["around"]
    assert around == pytest.approx(elbow - math.copysign(TURN, elbow - START[ELBOW]))
    goal[ELBOW] = around
    problem = Problem(robot, Scene(), START, (JointGoal(goal),))
    assert isinstance(plan(problem, Options()), Plan)


@pytest.mark.parametrize("seed", range(20))
def test_goals_that_can_be_reached_have_no_barrier(seed: int) -> None:
    checker, random = Checker.of(builtin("panda"), Scene()), np.random.default_rng(seed)
    low, high = builtin("panda").chain.sampling_bounds()
    drawn = random.uniform(low, high, (200, len(low)))
    goal = drawn[checker.each_valid(drawn)][0]
    assert joint_barrier(checker, HOME, [goal], seed, NEVER) is None
