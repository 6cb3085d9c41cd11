"""Nodes, record, candidates and steps of the search for a task."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from planning.options import Options
from planning.result import Failure
from planning.sequence.node import Node, TargetFinder, contact_pairs, next_place, onward_steps
from planning.sequence.record import Blame, Check, Record, hint_of
from planning.sequence.result import StagePlan
from planning.sequence.stage import (
    Attach,
    Detach,
    Grasp,
    Move,
    Place,
    StageSettings,
    Straight,
    Wait,
)
from planning.sequence.step import (
    LineStopped,
    Step,
    least_passing,
    least_travel,
    plan_step,
)
from planning.sequence.target import Candidates, Outcome, Target, Verdict
from planning.sequence.task import Task
from planning.sequence.world import Cells, Contact
from planning.timing.rest_to_rest import motion_times, passing_time
from planning.values.deadline import Deadline
from tests.planning.sequence import crate

GRIPS = crate.grasps(2)
LATER = Deadline.after(1e6)


def _target(number: int) -> Target:
    return Target(number, None, crate.HOME, None)


def _node(parent: Node | None = None, number: int | None = None, *bounds: float) -> Node:
    world = crate.world()
    steps = [
        Step(k, Wait(1.0), "none", world, world, {}, crate.HOME, crate.HOME, bound=bound)
        for k, bound in enumerate(bounds)
    ]
    target = None if number is None else _target(number)
    depth = 0 if parent is None else parent.depth + 1
    node = Node(parent, depth, world, crate.HOME, {}, target, steps)
    node.onward_joints = crate.HOME
    return node


def _with_children(*turns: tuple[int, float]) -> Node:
    """A node whose next targets are turns of the first joint, given by number and angle."""
    node = _node()
    joints = np.array([crate.HOME + np.array([angle, 0, 0, 0, 0, 0, 0]) for _, angle in turns])
    targets = tuple(_target(number) for number, _ in turns)
    node.add_children(targets, joints, 2, Options())
    return node


def _taken(node: Node) -> list[int]:
    numbers = []
    while (child := node.next_child()) is not None:
        numbers.append(child.target.number)
    return numbers


def test_what_is_quickest_to_reach_is_tried_first_and_few_of_each_target() -> None:
    turns = [(0, 0.9), (1, 0.3), (0, -0.1), (0, 0.5), (1, 0.6)]
    node = _with_children(*turns)
    times, numbers, angles = [], [], []
    while (child := node.next_child()) is not None:
        times.append(child.estimate)
        numbers.append(child.target.number)
        angles.append(child.joints[0] - crate.HOME[0])
    # The slowest of three configurations of target 0 is left out.
    assert numbers == [0, 1, 0, 1]
    np.testing.assert_allclose(angles, [-0.1, 0.3, 0.5, 0.6])
    ends = np.array([crate.HOME + np.array([a, 0, 0, 0, 0, 0, 0]) for a in angles])
    np.testing.assert_allclose(times, motion_times(crate.panda().chain, crate.HOME, ends))


def test_a_target_that_failed_comes_after_others_once() -> None:
    assert _taken(_with_children((0, 0.1), (1, 0.3), (0, 0.2))) == [0, 0, 1]
    node = _with_children((0, 0.1), (1, 0.3), (0, 0.2))
    node.blame(_target(0))
    assert node.failures == 1
    # Its first configuration waits behind target 1; the penalty is used up by then.
    assert _taken(node) == [0, 1, 0]
    alone = _with_children((0, 0.1), (0, 0.2))
    alone.blame(_target(0))
    assert _taken(alone) == [0, 0]


def test_the_place_that_a_grasp_leads_to_is_told_with_the_world_there() -> None:
    task = Task(crate.world(), crate.HOME, crate.stages(GRIPS))
    touching = contact_pairs(Grasp("crate", GRIPS, ("panda_hand",)))
    at = crate.world().after_grasp(Contact("crate", GRIPS[0], ("table",)), touching)
    found = next_place(task, 3, at, crate.HOME)
    assert found is not None
    k, world = found
    assert k == 8
    assert [item.name for item in world.held] == ["crate"]
    assert "crate" not in world.scene.ids
    assert world.supported == {}
    np.testing.assert_allclose(world.T_tool_object("crate"), np.linalg.inv(GRIPS[0]), atol=1e-12)
    # After the place nothing more is put anywhere; another grasp ends the look.
    assert next_place(task, 9, world, crate.HOME) is None
    grasp = Grasp("crate", GRIPS, ("panda_hand",))
    place = Place(None, crate.places(1))
    again = (*crate.stages(GRIPS)[:6], Detach(), grasp, Attach("crate"), place)
    regrasped = Task(crate.world(), crate.HOME, again)
    assert next_place(regrasped, 3, at, crate.HOME) is None


def test_stages_without_a_choice_follow_one_another_up_to_one_that_is_too_short() -> None:
    stages = (
        Wait(0.2), Attach("crate", touches=("table",)),
        Straight("lift", [0, 0, 1], "root", 0.02, 0.05),
        Straight("retreat", [0, 0, 1], "root", 5.0, 6.0),
    )  # fmt: skip
    node = _node()
    q = np.array([-0.4, 0.2, 0.1, -2.1, 0.1, 2.3, 0.5])
    node.joints = q
    task = Task(crate.world(), q, stages)
    stopped = onward_steps(task, Cells(), node, task.segments[0], LATER)
    assert stopped is not None
    k, led = stopped
    assert k == 3
    assert isinstance(led, LineStopped)
    assert led.distance < 5.0
    assert [step.motion for step in node.onward] == ["none", "none", "straight"]
    assert [step.index for step in node.onward] == [0, 1, 2]
    assert [len(step.after.held) for step in node.onward] == [0, 1, 1]
    np.testing.assert_array_equal(node.onward[2].start, q)
    assert set(node.history) == {0, 1, 2}
    np.testing.assert_array_equal(node.history[2], node.onward[2].end)


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


def test_the_last_check_that_was_reached_is_to_blame_with_its_most_frequent_reason() -> None:
    record, root = Record(), _root()
    assert record.blame() is None
    record.note_failure(root, 0, "starts badly")
    for reason in ("too short", "collides", "collides"):
        record.note_child(root, 1, (2, 1), reason, np.full(7, float(len(reason))))
    assert record.blame() == Blame(1, "collides", 2, {})
    (trial,) = record.trials
    assert (trial.choices, trial.stage, trial.outcome) == ((1,), 2, "failed")
    assert trial.reasons == {"too short": 1, "collides": 2}
    np.testing.assert_array_equal(trial.joints, np.full(7, 9.0))  # that of the first reason


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


def test_a_world_is_looked_at_once_and_another_one_anew() -> None:
    finder = _finder(Grasp("crate", crate.grasps(3), ("panda_hand",)))
    world = crate.world()
    first = finder.find(0, world, 0, {}, LATER)
    assert finder.find(0, crate.world(), 0, {}, LATER) is first
    held = world.after_attach("wall", None, (("panda_hand",), np.inf), None, crate.HOME)
    assert finder.find(0, held, 0, {}, LATER) is not first


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
