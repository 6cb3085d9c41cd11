"""Nodes of the search: what is tried first, what failures cost, and what follows from choices."""

import numpy as np
import pytest

from obstacles.scenes.scene import AllowedContact
from planning.options import Options
from planning.sequence.node import Node, contact_pairs, next_place, onward_steps
from planning.sequence.stage import Attach, Detach, Grasp, Move, Place, Straight, Wait
from planning.sequence.step import LineStopped, Step
from planning.sequence.target import Target
from planning.sequence.task import Task
from planning.sequence.world import Cells, Contact
from planning.timing.rest_to_rest import motion_times
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


def test_choices_bounds_and_penalties_add_up_along_the_path() -> None:
    root = _node(None, None, 0.5)
    child = _node(root, 3, 1.0, 2.0)
    leaf = _node(child, 1, 4.0)
    assert leaf.path == [root, child, leaf]
    assert leaf.choices == (3, 1)
    assert leaf.bound == pytest.approx(7.5)
    assert [step.bound for step in leaf.all_steps] == [0.5, 1.0, 2.0, 4.0]
    root.blame(None)
    child.blame(_target(0))
    child.blame(_target(0))
    assert (root.penalty, child.penalty, leaf.penalty) == (1.0, 3.0, 3.0)
    assert not leaf.is_dead
    child.dead = True
    assert leaf.is_dead
    assert not root.is_dead


def test_what_may_touch_at_a_target_is_what_it_names() -> None:
    grasp = Grasp("crate", GRIPS, ("panda_hand", "a"), "table")
    touching = AllowedContact("touch_links", 1e-3)
    assert contact_pairs(grasp) == {("crate", "panda_hand"): touching, ("a", "crate"): touching}
    place = Place("crate", crate.places(1), support=("table", "wall"), touch_depth=0.002)
    on = AllowedContact("support", 0.002)
    assert contact_pairs(place) == {("crate", "table"): on, ("crate", "wall"): on}
    assert contact_pairs(Place("crate", crate.places(1))) == {}
    assert contact_pairs(Move()) == {}


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
