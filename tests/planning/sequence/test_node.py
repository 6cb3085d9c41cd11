"""Candidates, hints and steps of the search for a task."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from planning.result import Failure
from planning.sequence.node import TargetFinder
from planning.sequence.record import hint_of
from planning.sequence.result import StagePlan
from planning.sequence.stage import (
    Grasp,
    Move,
    StageSettings,
    Wait,
)
from planning.sequence.step import (
    Step,
    least_passing,
    least_travel,
    plan_step,
)
from planning.sequence.target import Outcome
from planning.sequence.task import Task
from planning.sequence.world import Cells
from planning.timing.rest_to_rest import passing_time
from planning.values.deadline import Deadline
from tests.planning.sequence import crate

LATER = Deadline.after(1e6)


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
