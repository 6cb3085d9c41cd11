"""Planners by name, the cascade, and what the pipeline makes of each kind of attempt."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.errors import InvalidGoal, InvalidOption
from kinematics.forward import forward
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.constrained.checker import ConstrainedChecker
from planning.constrained.projected_rrt import ProjectedRrt
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import JointConstraint
from planning.options import CartesianOptions, Options, ToolMotionOptions
from planning.pipeline import pipeline
from planning.pipeline.path_search import CASCADE, PLANNERS, choose_planners
from planning.pipeline.pipeline import plan
from planning.planner import Query, Ready
from planning.problem import JointGoal, PoseGoal, Problem
from planning.result import Attempt, Failure, Plan
from planning.sampling.planners import PLANNERS as OMPL_PLANNERS
from planning.search.rrt_connect import RrtConnect
from planning.timing.options import TimingOptions
from planning.tool_paths.planner import Cartesian
from planning.values.deadline import Deadline
from tests.planning.scenes import HOME, box, builtin, planning_failure
from tests.planning.slider import slider

START, GOAL = np.array([-0.6, 0.0]), np.array([0.6, 0.1])
WALL = Scene((box("wall", (0.1, 1.0, 0.4), (0.0, 0.0, 0.0)),))
SHUT = Scene((box("wall", (0.1, 3.0, 0.4), (0.0, 0.0, 0.0)),))


def problem(scene: Scene) -> Problem:
    return Problem(slider(), scene, START, (JointGoal(GOAL),))


def query(scene: Scene, *, constrained: bool = False, seconds: float = 20.0) -> Query:
    checker = Checker.of(slider(), scene)
    if constrained:
        rows = ConstraintSet(slider().chain, (JointConstraint("jy", 0.0, 1.0, 1.0),))
        spare = np.zeros(len(rows.rows))
        checker = ConstrainedChecker(checker.model, 0.0, constraints=rows, spare=spare)
    ready = Ready(START, [GOAL], (checker,), ())
    return Query(problem(scene), ready, checker, 3, Deadline.after(seconds))


def chosen(planner: str, options: Mapping[str, Any] | None = None) -> list[str]:
    given = Options(planner=planner, planner_options=options or {})
    return [planner.name for planner in choose_planners(problem(WALL), given)]


def test_every_name_has_its_planner() -> None:
    assert set(PLANNERS) == {
        "auto", "straight_line", "potential_field", "cartesian", "optimize", *OMPL_PLANNERS,
    }  # fmt: skip
    for name in set(PLANNERS) - {"auto", "optimize"}:
        assert chosen(name) == [name]
    assert chosen("auto") == ["straight_line", "rrt_connect"]
    assert chosen("optimize") == chosen("auto")


def test_only_the_cartesian_planner_needs_no_goal_configurations() -> None:
    for name in PLANNERS:
        needs = {p.needs_goals for p in choose_planners(problem(WALL), Options(planner=name))}
        assert needs == {name != "cartesian"}


@pytest.mark.parametrize("name", ["auto", "straight_line", "cartesian"])
def test_planners_without_options_take_none(name: str) -> None:
    with pytest.raises(InvalidOption, match="has no options"):
        chosen(name, {"range": 0.5})


@pytest.mark.parametrize("name", ["potential_field", "rrt_connect", "prm"])
def test_options_of_another_planner_are_refused(name: str) -> None:
    with pytest.raises(InvalidOption, match="has no option 'speed'"):
        chosen(name, {"speed": 1.0})


def test_unknown_planners_are_refused_with_the_known_ones() -> None:
    with pytest.raises(InvalidOption, match="there is no planner 'magic'") as caught:
        chosen("magic")
    assert caught.value.details["planners"] == list(PLANNERS)


def test_the_cascade_finds_a_way_round_a_wall_with_its_trees_at_the_latest() -> None:
    straight, trees = (planner.plan(query(WALL)) for planner in CASCADE)
    assert straight.waypoints is None
    assert straight.detail == "Blocked: ball and wall."
    assert trees.waypoints is not None
    assert np.array_equal(trees.waypoints[[0, -1]], [START, GOAL])
    assert Checker.of(slider(), WALL).polyline(trees.waypoints)[0].free


def test_a_path_under_constraints_is_not_left_to_forces_or_free_trees() -> None:
    constrained = query(Scene(), constrained=True)
    _, trees = (planner.plan(constrained) for planner in CASCADE)
    assert trees.waypoints is not None
    assert "along the constraints" in trees.detail
    (named,) = choose_planners(constrained.problem, Options(planner="rrt_connect"))
    assert "along the constraints" in named.plan(constrained).detail


def test_the_fallback_has_its_turn_with_the_exact_robot_only() -> None:
    class Fallback:
        name = "fallback"
        needs_goals = True
        queries = 0

        def plan(self, query: Query) -> Attempt:
            self.queries += 1
            return Attempt(None, "Nothing.")

    fallback = Fallback()
    trees = RrtConnect(fallback, max_edges=300, max_edges_in_hulls=200)
    exact = query(SHUT)
    assert trees.plan(exact).detail == "300 edges checked. OMPL: Nothing."
    ready = Ready(START, [GOAL], (exact.checker, Checker.of(slider(), SHUT)), ())
    in_hulls = Query(exact.problem, ready, exact.checker, 3, Deadline.after(20.0))
    assert trees.plan(in_hulls).detail == "200 edges checked."
    assert fallback.queries == 1


@pytest.mark.parametrize("name", ["auto", *sorted(OMPL_PLANNERS)])
def test_a_bound_ends_a_planner_where_there_is_no_path(name: str) -> None:
    """No clock does: a minute is left."""
    asked = replace(query(SHUT, seconds=60.0), bound=400)
    for planner in choose_planners(problem(SHUT), Options(planner=name)):
        assert planner.plan(asked).waypoints is None
    assert not asked.deadline.interruptions.occurred


def test_a_bound_ends_trees_along_constraints() -> None:
    asked = replace(query(SHUT, constrained=True, seconds=60.0), bound=400)
    attempt = ProjectedRrt("rrt_connect").plan(asked)
    assert attempt.waypoints is None
    assert attempt.detail == "20 extensions along the constraints."
    assert not asked.deadline.interruptions.occurred


def test_a_bounded_search_is_not_diagnosed() -> None:
    failure = planning_failure(problem(SHUT), Options(max_edges=400))
    assert failure.code == "PLANNING_FAILED"
    assert "diagnosis" not in [stage.name for stage in failure.stages]


def cartesian(goals: tuple[PoseGoal, ...], **options: Any) -> Cartesian:
    whole = Problem(builtin("panda"), Scene(), HOME, goals)
    return Cartesian.of(whole, Options(planner="cartesian", **options))


def test_requests_that_the_cartesian_planner_refuses() -> None:
    T = forward(builtin("panda").chain, HOME)
    assert cartesian((PoseGoal(T),)).name == "cartesian"
    with pytest.raises(InvalidGoal, match="one goal"):
        cartesian((PoseGoal(T), PoseGoal(T)))
    with pytest.raises(InvalidOption, match=r"timing\.times"):
        cartesian((PoseGoal(T),), timing=TimingOptions("spline", times=[0.0, 1.0]))
    with pytest.raises(InvalidOption, match="blend_tolerance"):
        cartesian((PoseGoal(T),), timing=TimingOptions(blend_tolerance=0.1))
    away = T.copy()
    away[2, 3] += 0.01
    motions = CartesianOptions(motions=(ToolMotionOptions("lin", away),))
    with pytest.raises(InvalidGoal, match=r"0\.01 m"):
        cartesian((PoseGoal(T),), cartesian=motions)
    assert cartesian((PoseGoal(away),), cartesian=motions).options is motions
    free = cartesian((PoseGoal(T),), cartesian=CartesianOptions(orientation="free"))
    assert free.tolerances.orientation is None


def test_a_fallback_begins_where_the_field_is_stuck_and_both_tell_of_their_failures() -> None:
    for scene, planner in ((WALL, "bfmt"), (SHUT, None)):
        options = Options(
            planner="potential_field", planner_options={"fallback": "bfmt"}, timeout=1.5
        )
        answer = plan(problem(scene), options)
        names = [stage.name for stage in answer.stages]
        assert names[1:3] == ["potential_field", "bfmt"]
        assert answer.stages[1].outcome == "failed"
        assert answer.stages[1].detail.startswith(("Blocked", "A kink", "A local minimum"))
        if planner is None:
            assert isinstance(answer, Failure)
            assert answer.stage == "bfmt"
            assert answer.details["ending"] in ("blocked", "kink", "local_minimum")
            assert answer.details["motions"] > 0
        else:
            assert isinstance(answer, Plan)
            assert answer.planner == planner


MIDDLE = np.array([0.0, 0.8])


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
