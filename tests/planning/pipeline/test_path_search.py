"""The search for a path with the preferred clearance first, and then with less."""

from collections.abc import Callable

import numpy as np
import pytest

from kinematics.arrays import Array
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.clearance import time_shortcut
from planning.options import Options
from planning.pipeline import path_search
from planning.pipeline.pipeline import plan
from planning.problem import JointGoal, Problem
from planning.result import Plan
from planning.search.shortcut import shortcut
from planning.values.preferred_clearance import PreferredClearance
from tests.planning.scenes import box
from tests.planning.slider import slider

#: A wall across the table with a gap 20 mm wider than the ball, off the straight way.
LONG, SHORT = box("long", (0.1, 2.0, 0.3), (0, -0.76, 0)), box("short", (0.1, 1, 0.3), (0, 0.86, 0))
START, GOAL = np.array([-0.6, 0.0]), np.array([0.6, -0.2])


def stages(scene: Scene) -> list[str]:
    """Names of the stages that looked for a path with 40 mm to spare, and then without."""
    problem = Problem(slider(), scene, START, (JointGoal(GOAL),))
    answer = plan(problem, Options(clearance=PreferredClearance(0.04)))
    assert isinstance(answer, Plan)
    assert answer.certificate.verified
    names = [stage.name for stage in answer.stages]
    return names[1 : names.index("shortcut")]


def test_where_there_is_no_room_both_planners_are_asked_again_with_less_clearance() -> None:
    # With all of the preferred clearance, with half of it, and with none.
    assert stages(Scene((LONG, SHORT))) == 3 * ["straight_line", "rrt_connect"]


def test_where_there_is_room_one_search_is_enough() -> None:
    assert stages(Scene((LONG,))) == ["straight_line", "rrt_connect"]


def test_where_what_was_looked_at_is_not_proved_all_is_done_again_with_proofs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(path_search, "path_is_free", lambda *_: False)
    problem = Problem(slider(), Scene((LONG,)), START, (JointGoal(GOAL),))
    answer = plan(problem, Options(clearance=PreferredClearance(0.04)))
    assert isinstance(answer, Plan)
    assert answer.certificate.verified
    names = ["straight_line", "rrt_connect", "shortcut", "clearance"]
    told = [stage.name for stage in answer.stages][1:-2]
    assert told == [*names, "path_proof", *names]


def test_a_path_that_was_looked_at_is_proved_last() -> None:
    problem = Problem(slider(), Scene((LONG,)), START, (JointGoal(GOAL),))
    answer = plan(problem, Options(clearance=PreferredClearance(0.04)))
    assert isinstance(answer, Plan)
    proof = answer.stages[-3]
    assert (proof.name, proof.outcome) == ("path_proof", "succeeded")
    assert proof.detail == f"{len(answer.path.waypoints) - 1} legs are proved free."
    assert Checker.of(slider(), Scene((LONG,))).polyline(answer.path.waypoints)[0].free


def test_corners_are_cut_only_where_the_path_is_not_made_quicker_next(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    told = list[bool]()

    def note(cut: Callable[..., Array]) -> Callable[..., Array]:
        def cut_and_note(*args: object, cuts: bool, proves: bool) -> Array:
            told.append(cuts)
            return cut(*args, cuts=cuts, proves=proves)

        return cut_and_note

    monkeypatch.setattr(path_search, "shortcut", note(shortcut))
    problem = Problem(slider(), Scene((LONG,)), START, (JointGoal(GOAL),))
    for preferred, planner in ((0.04, "auto"), (0.04, "rrt_connect"), (0.0, "auto")):
        options = Options(planner=planner, clearance=PreferredClearance(preferred))
        assert isinstance(plan(problem, options), Plan)
    assert told == [False, False, True]


def test_a_path_of_too_many_waypoints_to_be_made_quicker_has_its_corners_cut(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(path_search, "MAX_WAYPOINTS", 2)
    problem = Problem(slider(), Scene((LONG,)), START, (JointGoal(GOAL),))
    cut = shortcuts(problem)
    monkeypatch.undo()
    assert cut != shortcuts(problem)


def shortcuts(problem: Problem) -> str:
    """Result of the shortcut on the way to a plan with 40 mm to spare."""
    answer = plan(problem, Options(clearance=PreferredClearance(0.04)))
    assert isinstance(answer, Plan)
    return next(stage.detail for stage in answer.stages if stage.name == "shortcut")


#: A block between a start that is 15 mm from it, and a goal.
BLOCK = Scene((box("block", (0.3, 0.3, 0.3), (0.0, 0.0, 0.0)),))
NEAR, BEHIND = np.array([-0.215, 0.02]), np.array([0.3, -0.2])


def test_a_path_that_is_joined_to_its_ends_is_made_quicker_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    problem = Problem(slider(), BLOCK, NEAR, (JointGoal(BEHIND),))
    options = Options(clearance=PreferredClearance(0.04))
    answer = plan(problem, options)
    assert isinstance(answer, Plan)
    assert answer.certificate.verified
    assert answer.clearance is not None
    # It is still too near next to its start alone.
    (span,) = answer.clearance.spans
    assert span.begins == 0.0
    assert span.ends < 0.5 * answer.trajectory.duration

    quicken = time_shortcut.quicken

    def only_between(levels: object, path: Array, *rest: object, **how: bool) -> Array:
        return path if np.array_equal(path[0], NEAR) else quicken(levels, path, *rest, **how)  # type: ignore[arg-type]

    monkeypatch.setattr(path_search, "quicken", only_between)
    joined = plan(problem, options)
    assert isinstance(joined, Plan)
    assert answer.trajectory.duration < joined.trajectory.duration
