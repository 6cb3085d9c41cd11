"""Nodes, record, candidates and steps of the search for a task."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from planning.result import Failure
from planning.sequence.node import Node, TargetFinder
from planning.sequence.record import Blame, Check, Record, hint_of
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
from planning.sequence.target import Candidates, Outcome, Target, Verdict
from planning.sequence.task import Task
from planning.sequence.world import Cells
from planning.timing.rest_to_rest import passing_time
from planning.values.deadline import Deadline
from tests.planning.sequence import crate

GRIPS = crate.grasps(2)
LATER = Deadline.after(1e6)


_NONE = np.zeros((0, 7))


def _candidates(**outcomes: Verdict) -> Candidates:
    found = {int(name.removeprefix("n")): outcome for name, outcome in outcomes.items()}
    return Candidates((), _NONE, found)


def _root() -> Node:
    return Node(None, 0, crate.world(), crate.HOME, {})


def _child(root: Node, number: int, stage: int) -> Node:
    target = Target(number, None, crate.HOME, None)
    grasp = Grasp("crate", crate.grasps(2))
    world = crate.world()
    step = Step(stage, grasp, "none", world, world, {}, crate.HOME, crate.HOME)
    return Node(root, 1, world, crate.HOME, {}, target, [step])


def test_what_cuts_off_the_rest_is_to_blame_and_not_the_deepest_stage_looked_at() -> None:
    record, root = Record(), _root()
    # Two grasps fail at late stages before any path, the third passes and finds no free motion.
    record.note_candidates((0,), 7, _candidates(n0=Verdict(Outcome.OUT_OF_REACH)), Check.PLACE)
    record.note_failure(_child(root, 1, 2), 9, "no retreat")
    assert record.blame() == Blame(9, "no retreat", 1, {})
    record.note_failure(_child(root, 2, 2), 4, "touches", Check.STILL_OR_STRAIGHT)
    assert record.blame() == Blame(4, "touches", 1, {})
    for _ in range(2):
        record.note_failure(_child(root, 3, 2), 0, "no path", Check.FREE)
    assert record.blame() == Blame(0, "no path", 2, {})


@pytest.mark.parametrize(
    "reason", ["'a' and 'b' touch at the start", "'a' and 'b' overlap by 0.1 m at the start"]
)
def test_what_touches_is_cured_by_naming_what_may_touch(reason: str) -> None:
    assert "allowed_collisions" in hint_of(Wait(0.4), reason)


def _finder(*stages: Grasp | Move) -> TargetFinder:
    return TargetFinder(Task(crate.world(), crate.HOME, stages), Cells())


def test_batches_are_spread_over_the_list_and_hold_it_all() -> None:
    far = np.tile(np.eye(4), (600, 1, 1))
    far[:, 2, 3] = 3.0 + 1e-3 * np.arange(600)
    finder = _finder(Grasp("crate", far))
    assert finder.batches(0) == 3
    seen = [set(finder.find(0, crate.world(), b, {}, LATER).outcomes) for b in range(3)]
    assert [min(numbers) for numbers in seen] == [0, 1, 2]
    assert all(max(numbers) > 590 for numbers in seen)
    assert sorted(number for numbers in seen for number in numbers) == list(range(600))
    assert _finder(Grasp("crate", far[:256])).batches(0) == 1


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
