"""Joints that a task gives: what is wrong with them is told at once, by pair and depth."""

import time

import numpy as np
import pytest

import armwright as aw
from kinematics.forward import forward
from obstacles.collision.checker import Checker
from planning.options import Options
from planning.problem import JointGoal
from planning.sequence.result import SequenceFailure, SequencePlan, TaskOptions
from planning.sequence.search import plan_task
from planning.sequence.stage import Move, StageSettings, Straight
from planning.sequence.task import Task
from planning.sequence.world import World
from tests.planning.scenes import HOME, builtin
from tests.planning.sequence import crate

ARMS = ["panda", "ur5e", "iiwa14", "kr6_sixx"]
TIMEOUT = 30.0


def colliding_joints(name: str, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Random joints of an arm that do not touch themselves, and some that do."""
    random, checker = np.random.default_rng(seed), Checker.of(builtin(name), aw.Scene())
    low, high = builtin(name).chain.sampling_bounds()
    drawn = random.uniform(low, high, (4000, len(low)))
    valid = checker.each_valid(drawn)
    return drawn[valid][0], drawn[~valid][0]


def refused(task: Task) -> SequenceFailure:
    began = time.monotonic()
    answer = plan_task(task, TaskOptions(TIMEOUT))
    assert isinstance(answer, SequenceFailure)
    assert time.monotonic() - began < 0.5 * TIMEOUT
    return answer


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("name", ARMS)
def test_a_start_or_a_last_move_that_touches_is_told_before_any_search(
    name: str, seed: int
) -> None:
    free, touching = colliding_joints(name, seed)
    world = World(builtin(name), aw.Scene())
    there = Move((JointGoal(free),))
    for start, goal, code, index in (
        (touching, free, "START_STATE_IN_COLLISION", 0),
        (free, touching, "GOAL_IN_COLLISION", 1),
    ):
        answer = refused(Task(world, start, (there, Move((JointGoal(goal),)))))
        assert (answer.code, answer.stage, answer.details["index"]) == (code, index, index)
        assert len(answer.details["pair"]) == 2
        assert answer.details["depth"] > 0.0
        assert f"stage {index} (move)" in answer.message


def test_a_limit_is_told_too() -> None:
    beyond = np.array(HOME)
    beyond[3] = 0.3
    task = Task(World(builtin("panda"), aw.Scene()), HOME, (Move((JointGoal(beyond),)),))
    answer = refused(task)
    assert answer.code == "GOAL_STATE_INVALID"
    assert answer.details["joint"] == "panda_joint4"


def test_what_is_carried_away_is_not_in_the_way_of_a_later_goal() -> None:
    # The last move of the task ends where the crate stood.
    plan = crate.plan()
    at_pick = plan.stages[2].trajectory.end
    stages = (*crate.stages()[:-1], Move((JointGoal(at_pick),)))
    answer = plan_task(Task(crate.world(), crate.HOME, stages), TaskOptions(TIMEOUT))
    assert isinstance(answer, SequencePlan), answer


def test_the_free_motion_that_no_alternative_passes_is_blamed() -> None:
    # Of two goals the one is stretched out, so that the tool can't rise from it, and no straight
    # motion leads to the other: a ball is in between. The first stage is what cuts both off.
    turned, stretched = np.array(HOME), np.array([0.0, 0.0, 0.0, -0.1, 0.0, 1.6, 0.8])
    turned[0] = 1.4
    middle = np.array(HOME)
    middle[0] = 0.7
    ball = aw.Obstacle(
        "ball", aw.Sphere(0.05), aw.pose(forward(builtin("panda").chain, middle)[:3, 3])
    )
    settings = StageSettings(options=Options(planner="straight_line", timeout=5.0))
    stages = (
        Move((JointGoal(turned), JointGoal(stretched)), settings=settings),
        Straight("lift", [0, 0, 1], "root", 0.1, 0.1),
    )
    answer = refused(Task(World(builtin("panda"), aw.Scene([ball])), HOME, stages))
    assert (answer.code, answer.stage) == ("PLANNING_FAILED", 0)
    assert "ball" in answer.message or "no path" in answer.message
