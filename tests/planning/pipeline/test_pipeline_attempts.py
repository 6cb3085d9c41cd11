"""The pipeline with planners of the test's own: what it makes of each kind of attempt."""

from dataclasses import dataclass

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.forward import forward
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.options import Options
from planning.pipeline import pipeline
from planning.planner import Query
from planning.problem import JointGoal, Problem
from planning.result import Attempt, Failure, Plan
from planning.timing.options import TimingOptions
from planning.tool_motions.tool_motion import line
from planning.tool_motions.tool_path import Tolerances, ToolPath
from planning.tool_paths.tool_following import lead_tool
from planning.values.deadline import Deadline
from tests.planning.scenes import HOME, box, builtin
from tests.planning.slider import slider

START, MIDDLE, GOAL = np.array([-0.6, 0.0]), np.array([0.0, 0.6]), np.array([0.6, 0.1])
WALL = Scene((box("wall", (0.1, 0.8, 0.4), (0.0, 0.0, 0.0)),))


@dataclass
class Given:
    """A planner that answers what it is given."""

    attempt: Attempt
    name: str = "given"
    needs_goals: bool = True
    queries: int = 0

    def plan(self, query: Query) -> Attempt:
        self.queries += 1
        return self.attempt


def run(
    monkeypatch: pytest.MonkeyPatch, scene: Scene, *planners: Given, timing: str = "toppra"
) -> Plan | Failure:
    monkeypatch.setattr(pipeline, "choose_planners", lambda problem, options: planners)
    problem = Problem(slider(), scene, START, (JointGoal(GOAL),))
    options = Options(timeout=20.0, timing=TimingOptions(timing))  # type: ignore[arg-type]
    return pipeline.plan(problem, options)


def names(answer: Plan | Failure) -> list[str]:
    return [stage.name for stage in answer.stages]


def path(*waypoints: Array) -> Attempt:
    return Attempt(np.array(waypoints), "Given.", notes=("a note",))


def test_planners_are_tried_in_turn_until_one_has_a_path(monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = Given(Attempt(None, "Nothing."), "first"), Given(path(START, MIDDLE, GOAL))
    third = Given(path(START, GOAL), "third")
    answer = run(monkeypatch, WALL, first, second, third)
    assert isinstance(answer, Plan)
    assert answer.planner == "given"
    assert (first.queries, second.queries, third.queries) == (1, 1, 0)
    expected = ["preflight", "first", "given", "shortcut", "clearance", "timing"]
    assert names(answer)[:6] == expected
    outcomes = {stage.name: stage.outcome for stage in answer.stages}
    assert (outcomes["first"], outcomes["given"]) == ("failed", "succeeded")
    assert "a note" in answer.notes


def test_a_path_that_is_not_free_is_not_answered(monkeypatch: pytest.MonkeyPatch) -> None:
    answer = run(monkeypatch, WALL, Given(path(START, GOAL)))
    assert isinstance(answer, Failure)
    assert answer.code == "INVALID_MOTION_PLAN"
    assert answer.stage == "certificate"
    assert answer.details["pair"] == ["ball", "wall"]


def test_a_search_without_a_path_is_diagnosed(monkeypatch: pytest.MonkeyPatch) -> None:
    answer = run(monkeypatch, WALL, Given(Attempt(None, "Nothing.", details={"tries": 3})))
    assert isinstance(answer, Failure)
    assert answer.code == "PLANNING_FAILED"
    assert answer.stage == "given"
    assert names(answer)[-1] == "diagnosis"
    assert answer.details["tries"] == 3
    assert answer.details["blocked_by"]


def test_a_failure_that_explains_itself_is_answered_as_it_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    failure = Failure("CODE", "message", "hint", "given", details={"a": 1})
    answer = run(monkeypatch, WALL, Given(Attempt(None, "Nothing.", failure=failure)))
    assert isinstance(answer, Failure)
    assert (answer.code, answer.message, answer.hint) == ("CODE", "message", "hint")
    assert answer.details == {"a": 1}
    assert set(names(answer)) == {"preflight", "given"}, "no diagnosis"


def test_goals_are_looked_for_only_where_a_planner_needs_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    blocked = Scene((box("crate", (0.3, 0.3, 0.3), (0.6, 0.1, 0.0)),))
    needing = run(monkeypatch, blocked, Given(path(START, MIDDLE)))
    assert isinstance(needing, Failure)
    assert needing.code == "GOAL_IN_COLLISION"
    other = run(monkeypatch, blocked, Given(path(START, MIDDLE), needs_goals=False))
    assert isinstance(other, Plan)
    np.testing.assert_allclose(other.trajectory.end, MIDDLE, atol=1e-9)


def led(
    monkeypatch: pytest.MonkeyPatch, *, method: str = "toppra", off: float = 0.0
) -> Plan | Failure:
    """Two motions of the panda's tool; the path of the second claims another line by ``off``."""
    robot = builtin("panda")
    T = forward(robot.chain, HOME)
    first, second = T.copy(), T.copy()
    first[1, 3] += 0.1
    second[1:3, 3] += [0.1, 0.1]
    motions = (line(T, first), line(first, second))
    checker = Checker.of(robot, Scene())
    whole = lead_tool(
        robot.chain, checker, HOME, motions, Tolerances(1e-4, 1e-3), Deadline.after(30.0)
    )
    moved = second.copy()
    moved[0, 3] += off
    tool_path = ToolPath(
        (motions[0], line(first, moved)), whole.segments, whole.fraction, None, whole.tolerances
    )
    attempt = Attempt(tool_path.waypoints, "Led.", tool_path=tool_path)
    planners = (Given(attempt, needs_goals=False),)
    monkeypatch.setattr(pipeline, "choose_planners", lambda problem, options: planners)
    problem = Problem(robot, Scene(), HOME, (JointGoal(whole.segments[-1].end),))
    timing = TimingOptions(method)  # type: ignore[arg-type]
    return pipeline.plan(problem, Options(timeout=30.0, timing=timing))


@pytest.mark.parametrize("method", ["toppra", "spline", "jerk_limited"])
def test_tool_paths_are_timed_from_rest_to_rest_and_not_shortened(
    monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    answer = led(monkeypatch, method=method)
    assert isinstance(answer, Plan), answer
    assert names(answer) == ["preflight", "given", "timing", "certificate"]
    first, second = answer.tool_motions
    assert first.begins == 0.0
    assert first.ends == second.begins
    assert second.ends == pytest.approx(answer.trajectory.duration)
    corner = answer.trajectory.sample([first.ends], 1)
    assert np.abs(corner).max() < 1e-9
    assert answer.certificate.path_deviation is not None
    assert answer.certificate.path_deviation.position <= 1e-4
    assert answer.fraction == 1.0


def test_a_tool_that_is_off_its_motion_is_not_answered(monkeypatch: pytest.MonkeyPatch) -> None:
    answer = led(monkeypatch, off=0.005)
    assert isinstance(answer, Failure)
    assert answer.details["kind"] == "path_deviation"
    assert "max_deviation" in answer.hint
    assert isinstance(led(monkeypatch, off=1e-6), Plan)
