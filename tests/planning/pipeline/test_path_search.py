"""The search for a path, starts that move, and plans that are asked for stops."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import armwright as aw
from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.pose import transform
from kinematics.robots import builtin_urdf
from obstacles.collision.checker import Checker
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box
from planning.clearance import time_shortcut
from planning.options import Options
from planning.pipeline import path_search
from planning.pipeline.diagnosis import Diagnosis, diagnose
from planning.pipeline.moving_start import with_stops
from planning.pipeline.optimize_stage import first_touch
from planning.pipeline.pipeline import plan
from planning.planner import Ready
from planning.problem import JointGoal, Problem
from planning.result import Failure, Plan
from planning.stops.braking import BrakingLimits
from planning.stops.certificate import certify_stops
from planning.timing.options import Method, TimingOptions
from planning.values.deadline import Deadline
from planning.values.preferences import PreferredClearance
from tests.planning.scenes import HOME, box, builtin, planned_motion, planning_failure, shelf
from tests.planning.slider import slider
from tests.planning.stops.judge import Brakes, CoalArm

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
    options = [Options(clearance=PreferredClearance(0.04), seed=seed) for seed in range(4)]
    answers = [planned_motion(problem, one) for one in options]
    for answer in answers:
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
    joined = [planned_motion(problem, one) for one in options]
    durations = [sum(one.trajectory.duration for one in each) for each in (answers, joined)]
    assert durations[0] < durations[1]


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


#: Brakes that need half a radian from full speed.
WEAK = {"acceleration": np.full(7, 3.0), "jerk": np.full(7, 300.0)}


def around_a_slab(**changes: Any) -> Problem:
    """The arm lowers its hand behind a slab that it would hit if it braked later."""
    goal = np.array([0.9, 0.4, 0.0, -1.9, 0.0, 2.3, 0.785])
    slab = Obstacle("slab", Box((0.4, 0.04, 0.5)), transform(None, (0.5, 0.12, 0.25)))
    return Problem(builtin("panda"), Scene((slab,)), HOME, (JointGoal(goal),), **changes)


def test_nothing_is_proved_of_stops_unless_asked() -> None:
    found = planned_motion(around_a_slab(), Options(limits=WEAK))
    assert found.stops is None
    assert "stops" not in [stage.name for stage in found.stages]


def test_a_motion_that_can_be_stopped_is_not_slowed_down() -> None:
    free = replace(around_a_slab(), scene=Scene())
    plain = planned_motion(free, Options(limits=WEAK))
    for kind in ("path", "joints", "both"):
        found = planned_motion(free, Options(limits=WEAK, stops=kind))
        assert found.stops is not None
        assert found.stops.proved
        assert found.stops.slowed == 0.0
        assert found.trajectory == plain.trajectory


@pytest.fixture(scope="module")
def slowed() -> tuple[Plan, Plan]:
    """A plan whose joints can't brake in time, and what is made of it."""
    for seed in range(30):
        plain = plan(around_a_slab(), Options(limits=WEAK, seed=seed))
        assert isinstance(plain, Plan)
        assert plain.surroundings is not None
        stops = certify_stops(plain.trajectory, plain.certificate, plain.surroundings, "joints")
        if not stops.proved:
            return plain, planned_motion(
                around_a_slab(), Options(limits=WEAK, seed=seed, stops="both")
            )
    raise AssertionError("all seeds brake in time")


def test_a_motion_is_slowed_down_until_its_stops_are_proved(slowed: tuple[Plan, Plan]) -> None:
    plain, found = slowed
    assert found.certificate.verified
    assert found.stops is not None
    assert found.stops.proved
    assert found.stops.slowed == pytest.approx(
        found.trajectory.duration - plain.trajectory.duration, abs=1e-9
    )
    assert found.stops.slowed > 0.0
    np.testing.assert_allclose(found.trajectory.end, plain.trajectory.end, atol=1e-9)
    assert found.stages[-1].name == "stops"
    assert "slowed down" in found.stages[-1].detail


def test_the_slow_motion_stops_in_time_by_ruckig_and_coal(slowed: tuple[Plan, Plan]) -> None:
    coal = CoalArm(builtin_urdf("panda"), builtin("panda"), around_a_slab().scene)
    plain, found = slowed
    touches = []
    for one in (plain, found):
        assert one.surroundings is not None
        starts = np.linspace(0.0, one.trajectory.duration, 1000)
        states, _ = Brakes(one.surroundings.braking).stops(one.trajectory, starts, 8)
        touches.append(coal.overlaps(states.reshape(-1, 7)).any())
    assert touches == [True, False]


def test_a_stop_of_a_plan_is_a_proved_motion(slowed: tuple[Plan, Plan]) -> None:
    plain, found = slowed
    for kind in ("path", "joints"):
        for at in np.linspace(0.0, found.trajectory.duration, 12):
            stop = aw.stop(found, float(at), kind)
            assert stop.certificate.verified, stop.certificate.violation
            assert (stop.kind, stop.at) == (kind, at)
    stops = aw.certify_stops(plain, "joints")
    assert not stops.proved
    met = aw.stop(plain, stops.worst.time, "joints")
    assert met.certificate.violation is not None
    assert met.certificate.violation.kind == "collision"
    assert met.certificate.violation.time <= stops.worst.after + 1e-9


def test_a_motion_that_can_not_be_slowed_down_is_refused(slowed: tuple[Plan, Plan]) -> None:
    """As one whose start moves: slower it would be another start."""
    plain, _ = slowed
    assert plain.surroundings is not None
    answer = with_stops(
        (plain.trajectory, plain.certificate),
        plain.surroundings,
        Options(stops="joints"),
        Deadline.after(20.0),
        None,
    )
    assert isinstance(answer, Failure)
    assert (answer.code, answer.stage) == ("INVALID_MOTION_PLAN", "stops")
    stops = aw.certify_stops(plain, "joints")
    assert answer.details["time"] == stops.worst.time
    assert answer.details["pair"] == list(stops.worst.pair or ())
    assert stops.message in answer.message
    assert "velocity_scaling" in answer.hint


def test_wrong_questions_are_refused(slowed: tuple[Plan, Plan]) -> None:
    _, found = slowed
    for at in (-0.1, found.trajectory.duration + 0.1, float("nan")):
        with pytest.raises(aw.ArmwrightError, match="outside the motion"):
            aw.stop(found, at)
    with pytest.raises(aw.ArmwrightError, match="kind"):
        aw.stop(found, 0.1, "both")  # type: ignore[arg-type]
    with pytest.raises(aw.ArmwrightError, match="stops of kind 'brake'"):
        Options(stops="brake")  # type: ignore[arg-type]
    with pytest.raises(aw.ArmwrightError, match="does not know"):
        aw.stop(replace(found, surroundings=None), 0.1)


def test_a_timed_path_tells_of_its_longest_stop() -> None:
    limits = {"velocity": [1.0, 1.0], "acceleration": [4.0, 4.0]}
    how = TimingOptions("toppra")
    timed = aw.retime([[0.0, 0.0], [1.0, 1.0]], timing_options=how, limits=limits, stops="path")
    assert timed.stops is not None
    assert timed.stops.longest == pytest.approx(0.25, abs=0.02)
    with pytest.raises(aw.ArmwrightError, match="leave the path"):
        aw.retime([[0.0, 0.0], [1.0, 1.0]], limits=limits, stops="both")
