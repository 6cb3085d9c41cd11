"""Steps: how long they take at least, and their motions with the proof, or why there is none."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from kinematics.trajectory.trajectory import REST
from planning.options import Options
from planning.result import Failure
from planning.sequence.result import StagePlan
from planning.sequence.stage import Detach, Gripper, Move, StageSettings, Wait
from planning.sequence.step import (
    Step,
    least_passing,
    least_travel,
    plan_step,
    scaled_limits,
    still_time,
)
from planning.sequence.world import Cells
from planning.timing.rest_to_rest import motion_times, passing_time
from planning.values.deadline import Deadline
from tests.planning.sequence import crate

THERE = crate.HOME + np.array([0.5, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0])
LATER = Deadline.after(1e6)


def _free(**changes: Any) -> Step:
    world = crate.world()
    step = Step(
        4, Move(settings=StageSettings("over")), "free", world, world, {}, crate.HOME, THERE
    )
    return replace(step, **changes)


def test_standing_still_takes_what_the_stage_says() -> None:
    assert still_time(Wait(0.4)) == 0.4
    assert still_time(Wait(1e-6)) == REST
    assert still_time(Gripper("open", duration=0.7)) == 0.7
    assert still_time(Gripper("close")) == REST
    assert still_time(Detach()) == REST


def test_least_times_are_those_of_the_slowest_joint_with_the_limits_of_the_stage() -> None:
    slow = StageSettings(options=Options(limits={"velocity": np.full(7, 0.1)}))
    world, chain = crate.world(), crate.panda().chain
    for settings in (StageSettings(), slow):
        least = least_travel(world, Move(settings=settings), crate.HOME, THERE)
        limits = scaled_limits(chain, settings.options)
        (expected,) = motion_times(chain, crate.HOME, THERE[None], limits)
        assert least == expected
    assert least_travel(world, Move(settings=slow), crate.HOME, THERE) > 5.0


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


def test_a_free_motion_is_proved_from_end_to_end() -> None:
    planned = plan_step(Cells(), _free(allowed=(("table", "crate"),), target=3), 10_000, LATER, 0)
    assert isinstance(planned, StagePlan)
    assert (planned.index, planned.kind, planned.name, planned.target) == (4, "move", "over", 3)
    assert planned.certificate.verified
    assert planned.allowed == (("crate", "table"),)
    np.testing.assert_allclose(planned.trajectory.start, crate.HOME, atol=1e-12)
    np.testing.assert_allclose(planned.trajectory.end, THERE, atol=1e-12)
    assert planned.milliseconds > 0.0


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


def test_no_time_is_told() -> None:
    failure = plan_step(Cells(), _free(), 10_000, Deadline.after(-1.0), 0)
    assert isinstance(failure, Failure)
    assert failure.code == "TIMED_OUT"
