"""Diagnoses of a ball that slides on a table, where the answer is known."""

import numpy as np
import pytest

from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.options import Options
from planning.pipeline.diagnosis import diagnose
from planning.pipeline.pipeline import plan
from planning.problem import JointGoal, Problem
from planning.result import Failure
from planning.values.deadline import Deadline
from tests.planning.scenes import HOME, box, builtin, shelf
from tests.planning.slider import slider


def walled() -> Scene:
    """A wall across the whole table, and a pebble beside it that is in nobody's way."""
    wall = box("wall", (0.1, 3.0, 0.4), (0.0, 0.0, 0.0))
    return Scene((wall, box("pebble", (0.04, 0.04, 0.4), (-0.5, 0.4, 0.0))))


@pytest.mark.parametrize("planner", ["auto", "straight_line", "rrt_connect"])
def test_a_search_that_fails_names_what_is_in_the_way(planner: str) -> None:
    goal = JointGoal(np.array([0.6, 0.1]))
    problem = Problem(slider(), walled(), np.array([-0.6, 0.0]), (goal,))
    answer = plan(problem, Options(planner=planner, timeout=2.0))
    assert isinstance(answer, Failure)
    assert answer.code in {"TIMED_OUT", "PLANNING_FAILED"}
    details = answer.details
    first = details["blocked_by"][0]
    assert first["pair"] == ["ball", "wall"]
    assert 0.5 < first["share"] <= 1.0
    assert sum(item["share"] for item in details["blocked_by"]) == pytest.approx(1.0)
    assert details["would_unblock"] == ["wall"]
    assert details["tried_without"][0] == "wall"
    assert 0.5 < details["start_freedom"] <= 1.0
    assert answer.stages[-1].name == "diagnosis"
    assert "wall" in answer.stages[-1].detail


def test_a_start_that_is_shut_in_has_no_freedom() -> None:
    sides = [
        box("east", (0.02, 0.3, 0.4), (0.08, 0.0, 0.0)),
        box("west", (0.02, 0.3, 0.4), (-0.08, 0.0, 0.0)),
        box("north", (0.3, 0.02, 0.4), (0.0, 0.08, 0.0)),
        box("south", (0.3, 0.02, 0.4), (0.0, -0.08, 0.0)),
    ]
    robot, scene = slider(), Scene(tuple(sides))
    start, goals = np.zeros(2), [np.array([0.6, 0.6])]
    checker = Checker.of(robot, scene)
    found = diagnose(robot, scene, checker, start, goals, Deadline.after(2.0), seed=1)
    assert found.start_freedom == 0.0
    assert found.goal_freedom == 1.0
    assert {name for pair, _ in found.blocked_by for name in pair} == {
        "ball", "east", "west", "north", "south"}  # fmt: skip
    assert set(found.would_unblock) == set(found.tried)
    none = diagnose(robot, Scene(), Checker.of(robot, Scene()), start, goals, Deadline.after(1.0))
    assert none.blocked_by == ()
    assert none.sentence


def test_it_looks_no_longer_than_it_may() -> None:
    robot, scene = builtin("panda"), shelf()
    checker = Checker.of(robot, scene)
    deadline = Deadline.after(0.0)
    found = diagnose(robot, scene, checker, HOME, [HOME + 0.1], deadline)
    assert found.motions == 0
    assert found.tried == ()
