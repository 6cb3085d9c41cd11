"""Nodes of the search: the choices made so far, with the steps they lead to."""

from dataclasses import dataclass, field
from heapq import heappop, heappush

import numpy as np

from kinematics.arrays import Array
from planning.deadline import Deadline
from planning.options import Options
from planning.sequence.estimate import travel_times
from planning.sequence.motion import LineStopped, lead_straight
from planning.sequence.stage import (
    Attach,
    Detach,
    Grasp,
    Gripper,
    Move,
    Pair,
    Place,
    Stage,
    Straight,
)
from planning.sequence.step import Step, least_passing, least_travel, still_time
from planning.sequence.target import Target
from planning.sequence.task import Segment, Task
from planning.sequence.world import Cells, World, sorted_pair

#: A configuration whose target failed once counts as this much longer [s].
_TARGET_PENALTY = 1.0
#: A node under which something failed counts as this much longer, each time [s].
_NODE_PENALTY = 1.0


@dataclass(slots=True, eq=False)
class Node:
    """Choices of the targets up to one segment.

    Args:
        parent: The choices before; None at the root.
        depth: How many segments are behind it.
        world: The world after its target.
        joints: Where the arm stands, shape (n,).
        history: Configurations at the ends of the stages so far, by number.
        target: What was chosen.
        steps: From the parent's last configuration to this one.
        onward: Steps of the next segment that follow without a choice.
        onward_world: The world after those.
        onward_joints: Where the arm stands then, shape (n,).
        children: Configurations of the next target with their estimates, a heap.
        penalties: Seconds by which a target of the next segment counts as longer.
        failures: How often something failed under it.
        attempts: How often its free motion was tried.
        batches: How many batches of the next targets were looked at.
        expanded: Whether its onward steps and children are known.
        dead: Whether nothing under it can be done.
    """

    parent: "Node | None"
    depth: int
    world: World
    joints: Array
    history: dict[int, Array]
    target: Target | None = None
    steps: list[Step] = field(default_factory=list)
    onward: list[Step] = field(default_factory=list)
    onward_world: World | None = None
    onward_joints: Array | None = None
    children: list[tuple[float, int, Target, Array]] = field(default_factory=list)
    penalties: dict[int, float] = field(default_factory=dict)
    failures: int = 0
    attempts: int = 0
    batches: int = 0
    expanded: bool = False
    dead: bool = False

    @property
    def path(self) -> "list[Node]":
        """The nodes from the root to this one."""
        nodes: list[Node] = []
        node: Node | None = self
        while node is not None:
            nodes.append(node)
            node = node.parent
        return nodes[::-1]

    @property
    def choices(self) -> tuple[int, ...]:
        """Numbers of the alternatives chosen so far."""
        return tuple(node.target.number for node in self.path if node.target is not None)

    @property
    def is_dead(self) -> bool:
        """Whether this node or one above it leads nowhere."""
        return any(node.dead for node in self.path)

    @property
    def all_steps(self) -> list[Step]:
        """Steps from the start on."""
        return [step for node in self.path for step in (*node.steps, *node.onward)]

    @property
    def bound(self) -> float:
        """Least time of the steps so far [s]."""
        return sum(step.least_time for step in self.all_steps)

    @property
    def penalty(self) -> float:
        """Seconds by which it counts as longer for what failed under it."""
        return _NODE_PENALTY * sum(node.failures for node in self.path)

    def add_children(
        self, targets: tuple[Target, ...], joints: Array, limit: int, options: Options
    ) -> None:
        """Add configurations of the next target, the quickest to reach first.

        Args:
            targets: Of each configuration; length k.
            joints: Shape (k, n).
            limit: Most configurations of one target that are kept.
            options: Of the free motion there.
        """
        if not len(joints):
            return
        assert self.onward_joints is not None
        times = travel_times(self.world.robot.chain, self.onward_joints, joints, options)
        counts: dict[int, int] = {}
        for k in np.argsort(times, kind="stable"):
            index = targets[k].number
            counts[index] = counts.get(index, 0) + 1
            if counts[index] <= limit:
                heappush(
                    self.children, (float(times[k]), len(self.children), targets[k], joints[k])
                )

    def next_child(self) -> tuple[float, Target, Array] | None:
        """Take the configuration of the next target that promises the most; None where all are."""
        while self.children:
            time, number, target, joints = heappop(self.children)
            late = self.penalties.get(target.number, 0.0)
            if not late or not self.children or time + late <= self.children[0][0]:
                return time, target, joints
            # Others are more promising by now; the penalty counts once.
            self.penalties[target.number] = 0.0
            heappush(self.children, (time + late, number, target, joints))
        return None

    def blame(self, target: Target | None) -> None:
        """Note a failure under a target of the next segment."""
        self.failures += 1
        if target is not None:
            late = self.penalties.get(target.number, 0.0)
            self.penalties[target.number] = late + _TARGET_PENALTY


def contact_pairs(stage: Stage) -> tuple[Pair, ...]:
    """Pairs that a target lets touch from its approach on."""
    if isinstance(stage, Grasp):
        return tuple(sorted_pair(link, stage.object) for link in stage.touches)
    if isinstance(stage, Place) and stage.support is not None:
        return (sorted_pair(str(stage.object), stage.support),)
    return ()


def changed(world: World, stage: Stage, q: Array) -> World:
    """The world after a stage in which the arm stands still."""
    if isinstance(stage, Attach):
        return world.after_attach(stage.object, stage.link, stage.touches, stage.load, q)
    if isinstance(stage, Detach):
        return world.after_detach(str(stage.object), stage.touches, q)
    if isinstance(stage, Gripper) and stage.robot is not None:
        return world.with_robot(stage.robot)
    return world


def onward_steps(
    task: Task, cells: Cells, node: Node, segment: Segment, deadline: Deadline
) -> tuple[int, LineStopped] | None:
    """Put the steps into a node that follow without a choice.

    Args:
        task: The task.
        cells: Cells that were put together.
        node: The choices so far; its onward steps are written.
        segment: The next segment.
        deadline: When to give up.

    Returns:
        The stage whose straight motion is too short, and why; None where all can be done.
    """
    world, q = node.world, node.joints
    for k in segment.forward:
        stage = task.stages[k]
        allowed = stage.settings.allowed
        if isinstance(stage, Straight):
            cell = cells.cell(world, allowed, stage.settings.margin)
            led = lead_straight(cell, stage, q, deadline)
            if isinstance(led, LineStopped):
                return k, led
            after = world.after_motion(free=False)
            bound = least_travel(world, stage, led.start, led.end)
            node.onward.append(
                Step(k, stage, "straight", world, after, allowed, q, led.end, led, bound=bound)
            )
            world, q = after, led.end
        else:
            world = changed(world, stage, q)
            node.onward.append(
                Step(k, stage, "none", world, world, allowed, q, q, bound=still_time(stage))
            )
        node.history[k] = q
    node.onward_world, node.onward_joints = world, q
    return None


def child_node(
    task: Task, cells: Cells, node: Node, segment: Segment, chosen: tuple[Target, Array],
    deadline: Deadline,
) -> Node | tuple[int, LineStopped]:  # fmt: skip
    """The node of one more choice, with its steps; or the approach that is too short.

    Args:
        task: The task.
        cells: Cells that were put together.
        node: The choices before.
        segment: The segment that the choice ends.
        chosen: The target and its configuration (n,).
        deadline: When to give up.
    """
    target, q = chosen
    assert segment.target is not None
    assert segment.free is not None
    assert node.onward_world is not None
    assert node.onward_joints is not None
    stage = task.stages[segment.target]
    world = node.onward_world.after_motion(free=True)
    pairs = contact_pairs(stage)
    reached = target_world(world, stage, target)
    steps: list[Step] = []
    q_free = q
    if segment.approach is not None:
        approach = task.stages[segment.approach]
        assert isinstance(approach, Straight)
        allowed = (*approach.settings.allowed, *pairs)
        cell = cells.cell(world, allowed, approach.settings.margin)
        led = lead_straight(cell, approach, q, deadline)
        if isinstance(led, LineStopped):
            return segment.approach, led
        q_free = led.start
        bound = least_travel(world, approach, led.start, led.end)
        steps = [
            Step(segment.approach, approach, "straight", world, world, allowed, q_free, q, led,
                 bound=bound),
            Step(segment.target, stage, "none", reached, reached, (*stage.settings.allowed, *pairs),
                 q, q, target=target.number, bound=still_time(stage)),
        ]  # fmt: skip
    free, is_last = task.stages[segment.free], segment.approach is None
    ends = (node.onward_joints, q_free)
    passing = least_passing(world, task.stages, segment.free, ends)
    bound = least_travel(world, free, *ends) if passing is None else passing
    allowed = (*free.settings.allowed, *(pairs if is_last else ()))
    steps.insert(
        0,
        Step(
            segment.free, free, "free", world, reached if is_last else world, allowed,
            *ends, target=target.number if is_last else None, bound=bound,
            passes=passing is not None,
        ),
    )  # fmt: skip
    history = {**node.history, **{step.index: step.end for step in steps}}
    return Node(node, node.depth + 1, reached, q, history, target, steps)


def target_world(world: World, stage: Stage, target: Target) -> World:
    """The world when the tool is at a target."""
    if target.contact is None:
        return world
    if isinstance(stage, Grasp):
        return world.after_grasp(target.contact, stage.touches)
    return world.after_place(target.contact)


def next_place(task: Task, first: int, world: World, q: Array) -> tuple[int, World] | None:
    """The place that a grasp leads to, with the world there, before any path.

    Between the two the objects move only with the tool, so the world there is known but for the
    configuration.

    Args:
        task: The task.
        first: Number of the stage after the grasp.
        world: The world at the grasp.
        q: The configuration there, shape (n,).
    """
    for k in range(first, len(task.stages)):
        stage = task.stages[k]
        if isinstance(stage, Grasp):
            return None
        if isinstance(stage, Place):
            return k, world.after_motion(free=True)
        if isinstance(stage, Move):
            world = world.after_motion(free=True)
        elif isinstance(stage, Straight):
            world = world if stage.kind == "approach" else world.after_motion(free=False)
        else:
            world = changed(world, stage, q)
    return None
