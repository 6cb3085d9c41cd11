"""Nodes and targets of stages, and stages that pass their ends without resting."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import armwright as aw
from benchmarks.judges.fcl import FclJudge
from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.forward import forward
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import concatenate
from obstacles.collision.checker import Checker
from planning.constraints.kinds.constraint import ToolSpeedConstraint
from planning.options import Options
from planning.problem import JointGoal
from planning.proof.certificate import Certificate, certify
from planning.result import Failure
from planning.sequence import via_blending
from planning.sequence.node import TargetFinder
from planning.sequence.record import hint_of
from planning.sequence.result import SequencePlan, StagePlan, TaskOptions
from planning.sequence.stage import (
    Grasp,
    Move,
    Place,
    Stage,
    StageSettings,
    Straight,
    Wait,
)
from planning.sequence.step import (
    Line,
    LineStopped,
    Step,
    lead_straight,
    least_passing,
    least_travel,
    plan_step,
)
from planning.sequence.target import (
    Candidates,
    Outcome,
    Target,
    find_candidates,
    grasp_region,
    place_region,
    stage_targets,
    target_count,
)
from planning.sequence.task import Task
from planning.sequence.world import Cells, Contact
from planning.timing.options import TimingOptions
from planning.timing.rest_to_rest import passing_time
from planning.values.deadline import Deadline
from tests.planning.scenes import builtin
from tests.planning.sequence import crate

GRIPS = crate.grasps(5)
LATER = Deadline.after(1e6)


def _find(targets: list[Target], *more: aw.Obstacle, deadline: Deadline = LATER) -> Candidates:
    robot = crate.panda()
    checker = Checker.of(robot, crate.scene(*more))
    return find_candidates(robot.chain, targets, checker, deadline, 0)


def _posed(number: int, *at: float) -> Target:
    return Target(number, aw.pose(at) @ crate.DOWN, None, None)


@pytest.mark.parametrize("reference", [None, "wall"])
def test_places_bring_the_held_object_to_their_poses(reference: str | None) -> None:
    touching = {("crate", "panda_hand"): aw.AllowedContact("touch_links", 0.001)}
    grasped = crate.world().after_grasp(Contact("crate", GRIPS[2]), touching)
    world = grasped.after_attach("crate", None, ((), 0.001), None, crate.HOME)
    stage = Place("crate", crate.places(3), reference, "table")
    targets = stage_targets(stage, world, {})
    assert len(targets) == target_count(stage) == 3
    base = np.eye(4) if reference is None else aw.pose([0.6, 0.0, 0.175])
    for target, pose in zip(targets, crate.places(3), strict=True):
        assert target.T is not None
        assert target.contact is not None
        # The crate is at T_tool @ T_tool_crate, and the grasp is T_crate_tool.
        np.testing.assert_allclose(target.T @ np.linalg.inv(GRIPS[2]), base @ pose, atol=1e-12)
        np.testing.assert_allclose(target.contact.T, base @ pose, atol=1e-12)


def test_candidates_have_the_tool_there_inside_the_limits_and_free_as_fcl_finds() -> None:
    targets = [_posed(4, 0.5, -0.25, 0.35), _posed(7, 0.5, 0.1, 0.3), _posed(9, 0.4, 0.3, 0.5)]
    found = _find(targets)
    assert found.complete
    assert {number: v.outcome for number, v in found.outcomes.items()} == dict.fromkeys(
        (4, 7, 9), Outcome.REACHED
    )
    chain, judge = crate.panda().chain, FclJudge(crate.panda(), crate.scene())
    assert len(found.targets) == len(found.joints) > 20
    assert {target.number for target in found.targets} == {4, 7, 9}
    for target, q in zip(found.targets, found.joints, strict=True):
        assert target.T is not None
        np.testing.assert_allclose(forward(chain, q), target.T, atol=1e-6)
        assert ((q >= chain.limits.lower) & (q <= chain.limits.upper)).all()
        assert not judge.collides(q)


def test_what_can_not_be_reached_is_told_with_the_reason() -> None:
    lid = aw.Obstacle("lid", aw.Box((0.3, 0.3, 0.02)), aw.pose([*crate.PICK, 0.3]))
    beyond = crate.panda().chain.limits.upper + 0.1
    targets = [
        _posed(0, 2.0, 0.0, 0.3),
        Target(1, None, beyond, None),
        _posed(2, *crate.PICK, 0.3),
        Target(3, None, crate.HOME, None),
    ]
    found = _find(targets, lid)
    outcomes = [found.outcomes[k].outcome for k in range(4)]
    assert outcomes == [
        Outcome.OUT_OF_REACH, Outcome.OUTSIDE_LIMITS, Outcome.IN_COLLISION, Outcome.REACHED
    ]  # fmt: skip
    np.testing.assert_array_equal(found.joints, [crate.HOME])
    hit = found.outcomes[2]
    assert hit.joints is not None
    assert hit.pair is not None
    assert "lid" in hit.pair
    assert FclJudge(crate.panda(), crate.scene(lid)).collides(hit.joints)


def test_a_configuration_that_barely_clears_is_left_out_where_others_have_room() -> None:
    target = _posed(0, 0.5, 0.1, 0.3)
    joints = _find([target]).joints
    at, small = aw.pose([0.1, -0.35, 0.6]), 0.01
    judge = FclJudge(crate.panda(), aw.Scene([aw.Obstacle("ball", aw.Sphere(small), at)]))
    distances = np.array([judge.obstacle_distance(q) for q in joints])
    # Branches that differ in the wrist alone are as near as each other.
    near = distances < distances.min() + 1e-4
    assert not near.all()
    ball = aw.Obstacle("ball", aw.Sphere(small + float(distances.min()) - 1e-4), at)
    np.testing.assert_array_equal(_find([target], ball).joints, joints[~near])
    # Alone it is what there is.
    nearest = joints[[distances.argmin()]]
    alone = _find([Target(0, None, nearest[0], None)], ball)
    np.testing.assert_array_equal(alone.joints, nearest)


def test_no_target_is_looked_at_after_the_deadline() -> None:
    found = _find([_posed(0, 0.5, 0.1, 0.3)], deadline=Deadline.after(-1.0))
    assert not found.complete
    assert not found.outcomes
    assert found.joints.shape == (0, 7)


def test_arms_without_a_closed_form_are_searched_and_answers_differ() -> None:
    robot = builtin("stanford")
    chain = robot.chain
    q = 0.5 * np.sum(chain.sampling_bounds(), axis=0) + 0.3
    T, far = forward(chain, q), forward(chain, q).copy()
    far[:3, 3] *= 20.0
    checker = Checker.of(robot, aw.Scene([]))
    targets = [Target(0, T, None, None), Target(1, far, None, None)]
    found = find_candidates(chain, targets, checker, LATER, 0)
    assert [found.outcomes[k].outcome for k in (0, 1)] == [Outcome.REACHED, Outcome.OUT_OF_REACH]
    assert _poses_error(chain, found.joints, T) < 1e-5
    gaps = [np.abs(a - b).max() for i, a in enumerate(found.joints) for b in found.joints[:i]]
    assert min(gaps, default=1.0) > 1e-3


def _poses_error(chain: Chain, joints: Array, T: Array) -> float:
    assert len(joints)
    return float(np.abs(forward(chain, joints) - T).max())


def test_grasps_turn_about_the_axis_and_move_along_it() -> None:
    base = aw.pose([0.03, 0.01, 0.02])
    axis = (1.0, 2.0, 2.0)
    grips = grasp_region(base, axis, (-0.5, 1.0), (0.0, 0.06), (4, 3))
    assert grips.shape == (12, 4, 4)
    unit = np.array(axis) / 3.0
    for k, T in enumerate(grips):
        angle = -0.5 + 0.5 * (k % 4)
        R = Rotation.from_rotvec(angle * unit).as_matrix()
        np.testing.assert_allclose(T[:3, :3], R, atol=1e-12)
        at = R @ base[:3, 3] + 0.03 * (k // 4) * unit
        np.testing.assert_allclose(T[:3, 3], at, atol=1e-12)


def test_a_whole_turn_has_no_angle_twice() -> None:
    grips = grasp_region(np.eye(4), (0, 0, 1), (0.0, 2.0 * np.pi), samples=(8, 1))
    angles = Rotation.from_matrix(grips[:, :3, :3]).as_euler("zyx")[:, 0] % (2.0 * np.pi)
    np.testing.assert_allclose(np.sort(angles), np.arange(8) * np.pi / 4.0, atol=1e-12)


def test_places_lie_on_the_rectangle_the_middle_first() -> None:
    base = aw.pose([0.5, 0.2, 0.3])
    poses = place_region(base, (0.2, 0.4), (0.0, 0.0), (3, 3, 1))
    offsets = poses[:, :3, 3] - base[:3, 3]
    assert np.array_equal(offsets[0], np.zeros(3))
    assert {tuple(np.round(row, 12)) for row in offsets} == {
        (x, y, 0.0) for x in (-0.1, 0.0, 0.1) for y in (-0.2, 0.0, 0.2)
    }


@pytest.mark.parametrize(
    ("axis", "angles", "samples"),
    [((0, 0, 0), (0, 1), (2, 1)), ((0, 0, 1), (1, 0), (2, 1)), ((0, 0, 1), (0, 1), (0, 1))],
)
def test_empty_regions_are_refused(
    axis: tuple[int, ...], angles: tuple[int, int], samples: tuple[int, int]
) -> None:
    with pytest.raises(InvalidOption):
        grasp_region(np.eye(4), axis, angles, samples=samples)


SOON = Deadline.after(1e6)


@pytest.mark.parametrize(("kind", "sign"), [("approach", -1.0), ("retreat", 1.0)])
def test_an_approach_ends_and_a_retreat_begins_at_the_configuration(kind: str, sign: float) -> None:
    cell = Cells().cell(crate.world())
    stage = Straight(kind, [0, 0, 1], "tool", 0.05, 0.1)  # type: ignore[arg-type]
    led = lead_straight(cell, crate.world(), stage, crate.HOME, SOON)
    assert isinstance(led, Line)
    fixed, other = (led.end, led.start) if kind == "approach" else (led.start, led.end)
    np.testing.assert_array_equal(fixed, crate.HOME)
    chain = crate.panda().chain
    T, T_other = forward(chain, fixed), forward(chain, other)
    np.testing.assert_allclose(T_other[:3, 3], T[:3, 3] + sign * 0.1 * T[:3, 2], atol=1e-5)
    np.testing.assert_allclose(T_other[:3, :3], T[:3, :3], atol=1e-4)
    points = led.path.segments[0].path
    assert points is not None
    np.testing.assert_allclose(points.sample([0.0])[0], led.start, atol=1e-12)
    np.testing.assert_allclose(points.sample([points.length])[0], led.end, atol=1e-12)


def test_a_motion_that_meets_something_is_as_long_as_it_can_be() -> None:
    tool = forward(crate.panda().chain, crate.HOME)[:3, 3]
    floor = aw.Obstacle("floor", aw.Box((0.2, 0.2, 0.02)), aw.pose([tool[0], 0.0, tool[2] - 0.12]))
    world = crate.world(floor)
    cell, down = Cells().cell(world), [0, 0, -1]
    led = lead_straight(cell, world, Straight("lift", down, "root", 0.02, 0.3), crate.HOME, SOON)
    assert isinstance(led, Line)
    assert 0.05 < led.distance < 0.12
    short = lead_straight(cell, world, Straight("lift", down, "root", 0.2, 0.3), crate.HOME, SOON)
    assert isinstance(short, LineStopped)
    assert short.stop.reason == "collision"
    assert short.distance < 0.12


@pytest.mark.parametrize(
    "reason", ["'a' and 'b' touch at the start", "'a' and 'b' overlap by 0.1 m at the start"]
)
def test_what_touches_is_cured_by_naming_what_may_touch(reason: str) -> None:
    assert "allowed_collisions" in hint_of(Wait(0.4), reason)


def _finder(*stages: Grasp | Move) -> TargetFinder:
    return TargetFinder(Task(crate.world(), crate.HOME, stages), Cells())


def test_links_that_may_touch_the_object_may_at_its_grasps() -> None:
    # So deep that the hand is in the crate.
    deep = crate.grasps(3).copy()
    deep[:, 2, 3] = -0.02
    world = crate.world()
    refused = _finder(Grasp("crate", deep)).find(0, world, 0, {}, LATER)
    assert {v.outcome for v in refused.outcomes.values()} == {Outcome.IN_COLLISION}
    assert all("crate" in (v.pair or ()) for v in refused.outcomes.values())
    taken = _finder(Grasp("crate", deep, ("panda_hand",))).find(0, world, 0, {}, LATER)
    assert {v.outcome for v in taken.outcomes.values()} == {Outcome.IN_COLLISION}
    assert all("touch_depth is 0.001 m" in (v.why or "") for v in taken.outcomes.values())
    any_depth = Grasp("crate", deep, ("panda_hand",), touch_depth=np.inf)
    taken = _finder(any_depth).find(0, world, 0, {}, LATER)
    assert {v.outcome for v in taken.outcomes.values()} == {Outcome.REACHED}


THERE = crate.HOME + np.array([0.5, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0])


def _free(**changes: Any) -> Step:
    world = crate.world()
    step = Step(
        4, Move(settings=StageSettings("over")), "free", world, world, {}, crate.HOME, THERE
    )
    return replace(step, **changes)


def test_a_stage_beside_a_passed_end_has_a_bound_without_rests() -> None:
    world, chain, ends = crate.world(), crate.panda().chain, (crate.HOME, THERE)
    plain, passed = Move(to_end_of=0), Move(to_end_of=0, blend=0.1)
    assert least_passing(world, (plain, plain), 0, ends) is None
    assert least_passing(world, (plain, plain), 1, ends) is None
    slacks = {(0, 0): 0.1, (0, 1): 0.1, (1, 1): 0.2, (1, 2): 0.1}
    for (kind, k), slack in slacks.items():
        stages = ((passed, plain), (passed, passed, plain))[kind]
        expected = passing_time(*ends, chain.limits.velocity, slack)
        assert least_passing(world, stages, k, ends) == pytest.approx(expected)
        assert expected < least_travel(world, plain, *ends)
    step = _free(passes=True, bound=0.1)
    planned = plan_step(Cells(), step, 10_000, LATER, 0)
    assert isinstance(planned, StagePlan)
    step.plan = planned
    # The plan rests at both ends; without rests it may be quicker.
    assert step.least_time == 0.1
    assert replace(step, passes=False).least_time == planned.trajectory.duration


def test_standing_in_a_collision_is_no_plan_and_says_what_to_name() -> None:
    deep = np.array([-0.46, 0.32, 0.0, -2.4, 0.0, 2.75, 0.3])
    world = crate.world()
    step = Step(2, Wait(0.3), "none", world, world, {}, deep, deep)
    failure = plan_step(Cells(), step, 10_000, LATER, 0)
    assert isinstance(failure, Failure)
    assert (failure.code, failure.stage) == ("INVALID_MOTION_PLAN", "certificate")
    assert "touch_links" in failure.hint
    assert failure.details["kind"] == "collision"
    free = plan_step(Cells(), replace(step, start=crate.HOME, end=crate.HOME), 10_000, LATER, 0)
    assert isinstance(free, StagePlan)
    assert free.plan is None
    assert free.trajectory.duration == 0.3


A = np.array([0.6, -0.5, 0.2, -2.2, 0.1, 1.8, 0.6])
B = np.array([-0.6, -0.4, 0.0, -2.0, 0.3, 1.7, 0.9])
C = np.array([0.7, -0.5, 0.2, -1.4, 0.1, 1.8, 0.6])
LAST = Move((JointGoal(crate.HOME),))


def _plan(*stages: Stage, more: tuple[aw.Obstacle, ...] = ()) -> SequencePlan:
    answer = crate.planned_task(Task(crate.world(*more), crate.HOME, stages), TaskOptions(30.0))
    assert all(stage.certificate.verified for stage in answer.stages)
    return answer


def _via(q: Array, blend: float | None, settings: StageSettings | None = None) -> Move:
    return Move((JointGoal(q),), settings=settings or StageSettings(), blend=blend)


def _assert_joined(plan: SequencePlan) -> None:
    """The stages join in position, speed and acceleration, and rest at both ends of all."""
    for one, other in pairwise(plan.stages):
        for order in range(3):
            ends = one.trajectory.sample([one.trajectory.duration], order)[0]
            np.testing.assert_allclose(ends, other.trajectory.sample([0.0], order)[0], atol=1e-9)
        speed = np.abs(other.trajectory.sample([0.0], 1)).max()
        assert (speed > 0.05) if one.passes else (speed < 1e-9)
    for motion, time in ((plan.stages[0].trajectory, 0.0), (plan.stages[-1].trajectory, None)):
        at = motion.duration if time is None else time
        np.testing.assert_allclose(motion.sample([at], 1), 0.0, atol=1e-9)
    assert plan.duration == pytest.approx(sum(s.trajectory.duration for s in plan.stages))


@pytest.mark.parametrize("method", ["jerk_limited", "toppra"])
def test_goals_are_passed_within_the_blend_and_sooner_than_with_rests(method: str) -> None:
    timing = TimingOptions("toppra") if method == "toppra" else TimingOptions()
    settings = StageSettings(options=Options(timing=timing))
    last = replace(LAST, settings=settings)
    resting = _plan(_via(A, None, settings), _via(B, None, settings), last)
    via_blending = _plan(_via(A, 0.2, settings), _via(B, 0.2, settings), last)
    assert [stage.passes for stage in via_blending.stages] == [True, True, False]
    assert not any(stage.passes for stage in resting.stages)
    assert via_blending.duration < 0.98 * resting.duration
    if method == "jerk_limited":
        _assert_joined(via_blending)
    for stage, goal in zip(via_blending.stages, (A, B), strict=False):
        away = np.linalg.norm(stage.trajectory.end - goal)
        assert 0.01 < away <= 0.2 + 1e-9
        # The end is where the motion is nearest to the goal.
        whole = concatenate([s.trajectory for s in via_blending.stages])
        near = np.linalg.norm(whole.sample(np.linspace(0, whole.duration, 4001)) - goal, axis=1)
        assert near.min() >= away - 1e-4
    limits = crate.panda().chain.limits
    for stage in via_blending.stages:
        times = np.linspace(0.0, stage.trajectory.duration, 2001)
        for order, bound in ((1, limits.velocity), (2, limits.acceleration)):
            assert (np.abs(stage.trajectory.sample(times, order)) <= bound * (1 + 1e-9)).all()


def test_a_narrow_blend_that_costs_more_than_a_stop_is_told() -> None:
    resting, narrow = _plan(_via(A, None), LAST), _plan(_via(A, 0.01), LAST)
    assert narrow.duration == pytest.approx(resting.duration, rel=1e-9)
    assert not narrow.stages[0].passes
    np.testing.assert_allclose(narrow.stages[0].trajectory.end, A, atol=1e-12)
    plan = narrow.stages[0].plan
    assert plan is not None
    assert any("rests at the end" in note for note in plan.notes)
    _assert_joined(narrow)


def test_an_obstacle_inside_the_corner_narrows_the_blend_and_fcl_finds_the_way_free() -> None:
    wide = _plan(_via(A, 1.0), _via(C, None))
    tips = forward(crate.panda().chain, np.array([A, wide.stages[0].trajectory.end]))[:, :3, 3]
    # Beside the blend, and no nearer to the goal that is passed than is preferred.
    post = aw.Obstacle("post", aw.Sphere(0.01), aw.pose(tips[0] + 4.5 * (tips[1] - tips[0])))
    narrow = _plan(_via(A, 1.0), _via(C, None), more=(post,))
    judge = FclJudge(crate.panda(), crate.scene(post))
    assert narrow.stages[0].passes
    away = [np.linalg.norm(plan.stages[0].trajectory.end - A) for plan in (wide, narrow)]
    assert away[1] < 0.5 * away[0]
    assert _collides(judge, wide)
    assert not _collides(judge, narrow)
    _assert_joined(narrow)


@pytest.mark.parametrize("place", [[0.3679, 0.3236, 0.5205], [0.3596, 0.2121, 0.5788]])
def test_a_goal_nearer_than_preferred_is_passed(place: list[float]) -> None:
    """Each stage keeps away from the post beside it and comes near by a short leg of its own."""
    post = aw.Obstacle("post", aw.Sphere(0.02), aw.pose(place))
    checker = Checker.of(crate.panda(), crate.scene(post))
    assert 0.005 < checker.clearance(A)[0] < 0.015
    resting = _plan(_via(A, None), _via(C, None), more=(post,))
    via_blending = _plan(_via(A, 0.6), _via(C, None), more=(post,))
    assert via_blending.stages[0].passes
    assert via_blending.duration < 0.98 * resting.duration
    assert np.linalg.norm(via_blending.stages[0].trajectory.end - A) <= 0.6
    assert not _collides(FclJudge(crate.panda(), crate.scene(post)), via_blending)
    _assert_joined(via_blending)
    for stage in via_blending.stages:
        assert stage.plan is not None
        legs = np.diff(stage.plan.path.waypoints, axis=0)
        assert np.linalg.norm(legs, axis=1).min() > 0.1


def test_a_motion_that_can_not_be_proved_is_not_answered(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*given: Any, **options: Any) -> Certificate:
        return replace(certify(*given, **options), verified=False)

    monkeypatch.setattr(via_blending, "certify", refuse)
    plan = _plan(_via(A, 1.0), _via(C, None))
    assert not plan.stages[0].passes
    assert plan.stages[0].plan is not None
    assert any("rests at the end" in note for note in plan.stages[0].plan.notes)
    _assert_joined(plan)


def _collides(judge: FclJudge, plan: SequencePlan) -> bool:
    motions = [stage.trajectory for stage in plan.stages]
    return any(
        judge.collides(q) for m in motions for q in m.sample(np.linspace(0.0, m.duration, 120))
    )


def test_goals_in_a_line_are_passed_exactly_and_as_fast_as_one_motion() -> None:
    end = crate.HOME + np.array([0.8, 0.2, 0.0, 0.4, 0.0, 0.0, 0.3])
    middle = crate.HOME + 0.4 * (end - crate.HOME)
    plan, direct = _plan(_via(middle, 0.1), _via(end, None)), _plan(_via(end, None))
    assert plan.stages[0].passes
    np.testing.assert_allclose(plan.stages[0].trajectory.end, middle, atol=1e-6)
    assert plan.duration == pytest.approx(direct.duration, rel=1e-6)
    _assert_joined(plan)


def test_the_way_to_an_approach_is_passed_into_and_its_end_rests() -> None:
    over = crate.HOME + np.array([-0.3, 0.1, 0.0, 0.2, 0.0, 0.1, 0.0])
    grasp = Grasp("crate", crate.grasps(6), ("panda_hand",), "table")
    plan = _plan(_via(over, 0.3), Move(), Straight("approach", [0, 0, 1], "tool", 0.05, 0.1), grasp)
    assert [stage.passes for stage in plan.stages] == [True, False, False, False]
    _assert_joined(plan)


def test_limits_of_the_tool_speed_hold_where_the_end_is_passed() -> None:
    limits = 0.3, 0.25
    slow, slower = (StageSettings(constraints=(ToolSpeedConstraint(v),)) for v in limits)
    plan, chain = _plan(_via(A, 0.2, slow), _via(B, None, slower)), crate.panda().chain
    assert plan.stages[0].passes
    for stage, limit in zip(plan.stages, limits, strict=True):
        assert "tool_speed" in stage.certificate.limits
        motion = stage.trajectory
        points = forward(chain, motion.sample(np.linspace(0.0, motion.duration, 3001)))[:, :3, 3]
        speeds = np.linalg.norm(np.diff(points, axis=0), axis=1) / (motion.duration / 3000)
        assert 0.1 < speeds.max() <= limit * (1 + 1e-6)
