"""Candidates of stages: found once for a world, in batches that are spread over the whole list."""

import numpy as np

from planning.problem import JointGoal
from planning.sequence.node import TargetFinder
from planning.sequence.stage import Grasp, Move
from planning.sequence.target import Outcome
from planning.sequence.task import Task
from planning.sequence.world import Cells
from planning.values.deadline import Deadline
from tests.planning.sequence import crate

LATER = Deadline.after(1e6)


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


def test_a_way_back_is_looked_at_for_each_end_of_the_stage_it_names() -> None:
    finder = _finder(Move((JointGoal(crate.HOME),)), Move(to_end_of=0))
    one = finder.find(1, crate.world(), 0, {0: crate.HOME}, LATER)
    other = finder.find(1, crate.world(), 0, {0: crate.HOME + 0.05}, LATER)
    np.testing.assert_array_equal(one.joints, [crate.HOME])
    np.testing.assert_array_equal(other.joints, [crate.HOME + 0.05])
    assert finder.find(1, crate.world(), 0, {0: crate.HOME.copy()}, LATER) is one


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
