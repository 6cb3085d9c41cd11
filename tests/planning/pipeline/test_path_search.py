"""The search for a path with its clearances, diagnoses of failures, and a start that moves."""

import numpy as np
import pytest

from kinematics.arrays import Array
from obstacles.collision.checker import Checker
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.clearance import time_shortcut
from planning.options import Options
from planning.pipeline import path_search
from planning.pipeline.diagnosis import Diagnosis, diagnose
from planning.pipeline.optimize_stage import first_touch
from planning.planner import Ready
from planning.problem import JointGoal, Problem
from planning.stops.braking import BrakingLimits
from planning.values.deadline import Deadline
from planning.values.preferences import PreferredClearance
from tests.planning.scenes import HOME, box, builtin, planned_motion, planning_failure, shelf
from tests.planning.slider import slider

#: A wall across the table with a gap 20 mm wider than the ball, off the straight way.
LONG, SHORT = box("long", (0.1, 2.0, 0.3), (0, -0.76, 0)), box("short", (0.1, 1, 0.3), (0, 0.86, 0))
FROM, TO = np.array([-0.6, 0.0]), np.array([0.6, -0.2])


def stages(scene: Scene) -> list[str]:
    """Names of the stages that looked for a path with 40 mm to spare, and then without."""
    problem = Problem(slider(), scene, FROM, (JointGoal(TO),))
    answer = planned_motion(problem, Options(clearance=PreferredClearance(0.04)))
    assert answer.certificate.verified
    names = [stage.name for stage in answer.stages]
    return names[1 : names.index("shortcut")]


def test_where_there_is_no_room_both_planners_are_asked_again_with_less_clearance() -> None:
    # With the preferred clearance, and without.
    assert stages(Scene((LONG, SHORT))) == 2 * ["straight_line", "rrt_connect"]


def test_where_there_is_room_one_search_is_enough() -> None:
    assert stages(Scene((LONG,))) == ["straight_line", "rrt_connect"]


def test_where_what_was_looked_at_is_not_proved_all_is_done_again_with_proofs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(path_search, "path_is_free", lambda *_: False)
    problem = Problem(slider(), Scene((LONG,)), FROM, (JointGoal(TO),))
    answer = planned_motion(problem, Options(clearance=PreferredClearance(0.04)))
    assert answer.certificate.verified
    names = ["straight_line", "rrt_connect", "shortcut", "clearance"]
    told = [stage.name for stage in answer.stages][1:-2]
    assert told == [*names, "path_proof", *names]


def test_a_path_that_was_looked_at_is_proved_last() -> None:
    problem = Problem(slider(), Scene((LONG,)), FROM, (JointGoal(TO),))
    answer = planned_motion(problem, Options(clearance=PreferredClearance(0.04)))
    proof = answer.stages[-3]
    assert (proof.name, proof.outcome) == ("path_proof", "succeeded")
    assert proof.detail == f"{len(answer.path.waypoints) - 1} legs are proved free."
    assert Checker.of(slider(), Scene((LONG,))).polyline(answer.path.waypoints)[0].free


#: A block between a start that is 15 mm from it, and a goal.
BLOCK = Scene((box("block", (0.3, 0.3, 0.3), (0.0, 0.0, 0.0)),))
NEAR, BEHIND = np.array([-0.215, 0.02]), np.array([0.3, -0.2])


def test_a_path_that_is_joined_to_its_ends_is_made_quicker_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    problem = Problem(slider(), BLOCK, NEAR, (JointGoal(BEHIND),))
    options = Options(clearance=PreferredClearance(0.04))
    answer = planned_motion(problem, options)
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
    joined = planned_motion(problem, options)
    assert answer.trajectory.duration < joined.trajectory.duration


def walled() -> Scene:
    """A wall across the whole table, and a pebble beside it that is in nobody's way."""
    wall = box("wall", (0.1, 3.0, 0.4), (0.0, 0.0, 0.0))
    return Scene((wall, box("pebble", (0.04, 0.04, 0.4), (-0.5, 0.4, 0.0))))


@pytest.mark.parametrize("planner", ["auto", "straight_line", "rrt_connect"])
def test_a_search_that_fails_names_what_is_in_the_way(planner: str) -> None:
    goal = JointGoal(np.array([0.6, 0.1]))
    problem = Problem(slider(), walled(), np.array([-0.6, 0.0]), (goal,))
    answer = planning_failure(problem, Options(planner=planner, timeout=2.0))
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


def _diagnosis(
    robot: RobotGeometry, scene: Scene, start: Array, goal: Array, seconds: float, seed: int = 0
) -> Diagnosis:
    problem, checker = Problem(robot, scene, start, (JointGoal(goal),)), Checker.of(robot, scene)
    ready = Ready(start, [goal], (checker,), ())
    return diagnose(problem, checker, ready, Deadline.after(seconds), seed)


def test_a_start_that_is_shut_in_has_no_freedom() -> None:
    sides = [
        box("east", (0.02, 0.3, 0.4), (0.08, 0.0, 0.0)),
        box("west", (0.02, 0.3, 0.4), (-0.08, 0.0, 0.0)),
        box("north", (0.3, 0.02, 0.4), (0.0, 0.08, 0.0)),
        box("south", (0.3, 0.02, 0.4), (0.0, -0.08, 0.0)),
    ]
    start, goal = np.zeros(2), np.array([0.6, 0.6])
    found = _diagnosis(slider(), Scene(tuple(sides)), start, goal, 2.0, seed=1)
    assert found.start_freedom == 0.0
    assert found.goal_freedom == 1.0
    assert {name for pair, _ in found.blocked_by for name in pair} == {
        "ball", "east", "west", "north", "south"}  # fmt: skip
    assert set(found.would_unblock) == set(found.tried)
    none = _diagnosis(slider(), Scene(), start, goal, 1.0)
    assert none.blocked_by == ()
    assert none.sentence


def test_it_looks_no_longer_than_it_may() -> None:
    found = _diagnosis(builtin("panda"), shelf(), HOME, HOME + 0.1, 0.0)
    assert found.motions == 0
    assert found.tried == ()


def test_nothing_is_met_where_nothing_is() -> None:
    robot = builtin("planar_rr")
    problem = Problem(
        robot, Scene(), np.zeros(2), (JointGoal(np.ones(2)),), start_velocity=np.ones(2)
    )
    limits = BrakingLimits(np.ones(2), np.full(2, np.inf))
    assert first_touch(problem, np.zeros(2), limits) is None
