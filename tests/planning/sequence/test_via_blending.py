"""Stages that pass their ends without resting: joined in speed, within their blend, each proved."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import armwright as aw
from benchmarks.judges.fcl import FclJudge
from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.trajectory.trajectory import concatenate
from obstacles.collision.checker import Checker
from planning.constraints.kinds.constraint import ToolSpeedConstraint
from planning.options import Options
from planning.problem import JointGoal
from planning.proof.certificate import Certificate, certify
from planning.sequence import via_blending
from planning.sequence.result import SequencePlan, TaskOptions
from planning.sequence.stage import Grasp, Move, Stage, StageSettings, Straight
from planning.sequence.task import Task
from planning.timing.options import TimingOptions
from tests.planning.sequence import crate

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
    post = aw.Obstacle("post", aw.Sphere(0.01), aw.pose(tips[0] + 6.0 * (tips[1] - tips[0])))
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
