"""Nodes of the search: the choices made so far, with the steps they lead to."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from heapq import heappop, heappush
from itertools import count
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array
from kinematics.ik.closed_form.structure import structure
from obstacles.robots.allowed_pairs import contacts_of
from obstacles.robots.robot_geometry import sorted_pair
from obstacles.scenes.scene import AllowedContact
from planning.goal_choice.goal_order import MAX_LONGER
from planning.options import Options
from planning.result import Failure
from planning.sequence.stage import (
    Attach,
    Detach,
    Follow,
    Grasp,
    Gripper,
    Move,
    Pair,
    Place,
    Stage,
    Straight,
)
from planning.sequence.step import (
    LineStopped,
    Step,
    lead_straight,
    least_passing,
    least_travel,
    plan_step,
    scaled_limits,
    still_time,
)
from planning.sequence.target import (
    Candidates,
    Target,
    find_candidates,
    stage_targets,
    target_count,
)
from planning.sequence.task import Segment, Task, with_motion
from planning.sequence.world import Cell, Cells, World, contact_positions
from planning.timing.rest_to_rest import motion_times
from planning.values.deadline import Deadline

#: Levels of a redundant arm's parameter that are tried one after the other: 64 values in all.
_LEVELS = 3
#: Seconds by which a configuration counts as longer of whose target many come before.
_MANY_LATE = 10.0


class Child(NamedTuple):
    """A configuration of a node's next target.

    Args:
        estimate: Least time of the motion there with what the configuration costs [s].
        number: Number of the child among all of its node.
        target: The alternative that it is of.
        joints: Shape (n,).
        cost: Cost of the configuration by itself, as seconds.
        appraised: Whether costs that need a check of the surroundings are among that.
        around: Whether its straight motions may go round something.
    """

    estimate: float
    number: int
    target: Target
    joints: Array
    cost: float = 0.0
    appraised: bool = False
    around: bool = False


class OwnCosts(NamedTuple):
    """Costs of configurations, whatever comes before and after.

    Args:
        seconds: Costs as seconds of motion, shape (k,).
        at_limit: Whether each of them, of a pose, is at a joint limit, shape (k,).
    """

    seconds: Array
    at_limit: NDArray[np.bool_]


@dataclass(slots=True, eq=False)
class Node:
    """Choices of the targets up to one segment.

    Args:
        parent: The choices before; None at the root.
        depth: How many segments are behind it.
        world: The world after its target.
        joints: Configuration of the arm, shape (n,).
        history: Configurations at the ends of the stages so far, by number.
        target: Target that was chosen.
        steps: Steps from the parent's last configuration to this one.
        onward: Steps of the next segment that follow without a choice.
        onward_world: The world after those.
        onward_joints: Configuration of the arm after those steps, shape (n,).
        children: Configurations of the next target with their estimates, a heap.
        numbers: Numbers of children to come.
        penalties: Seconds by which a target of the next segment counts as longer.
        failures: How often something failed under it.
        attempts: How often its free motion was tried.
        batches: How many batches of the next targets were checked.
        expanded: Whether its onward steps and children are known.
        dead: Whether nothing under it can be done.
        cost: Cost of the configuration that was chosen, as seconds.
        at_limit: Whether the arm rests at a joint limit where the choice has it rest: at the
            target, where its approach begins, or where straight motions after it end.
        around: Whether its straight motions may go round something.
    """

    parent: "Node | None"
    depth: int
    world: World
    joints: Array
    history: dict[int, Array]
    target: Target | None = None
    steps: list[Step] = field(default_factory=list)
    onward: list[Step] = field(default_factory=list)
    onward_world: World = field(init=False)
    onward_joints: Array = field(init=False)
    children: list[Child] = field(default_factory=list)
    numbers: Iterator[int] = field(default_factory=count)
    penalties: dict[int, float] = field(default_factory=dict)
    failures: int = 0
    attempts: int = 0
    batches: int = 0
    expanded: bool = False
    dead: bool = False
    cost: float = 0.0
    at_limit: bool = False
    around: bool = False

    def __post_init__(self) -> None:
        self.onward_world, self.onward_joints = self.world, self.joints

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
    def all_steps(self) -> list[Step]:
        """Steps from the start on."""
        return [step for node in self.path for step in (*node.steps, *node.onward)]

    @property
    def bound(self) -> float:
        """Least time of the steps so far [s]."""
        return sum(step.least_time for step in self.all_steps)

    @property
    def weight(self) -> float:
        """Times by which motions beside it count as longer: a limit is worth a fifth more time."""
        return MAX_LONGER if self.at_limit else 1.0

    @property
    def value(self) -> float:
        """Least time of the steps so far with what the configurations cost, as seconds."""
        total, before = 0.0, 1.0
        for node in self.path:
            total += before * node.weight * sum(step.least_time for step in node.steps)
            total += node.weight * sum(step.least_time for step in node.onward) + node.cost
            before = node.weight
        return total

    @property
    def penalty(self) -> float:
        """Seconds by which it counts as longer for what failed under it."""
        # Each failure under it counts as one second.
        return float(sum(node.failures for node in self.path))

    def add_children(
        self,
        targets: tuple[Target, ...],
        joints: Array,
        limit: int,
        options: Options,
        costs: OwnCosts | None = None,
    ) -> None:
        """Add configurations of the next target, those first that cost the least.

        Args:
            targets: Target of each configuration; length k.
            joints: Shape (k, n).
            limit: Most configurations of one target that are not put off.
            options: Options of the free motion there.
            costs: Costs of each configuration beside the time to it; none where None.
        """
        if not len(joints):
            return
        chain = self.world.robot.chain
        limits = scaled_limits(chain, options)
        times = motion_times(chain, self.onward_joints, joints, limits)
        own = np.zeros(len(joints))
        if costs is not None:
            own = costs.seconds
            times = self.weight * np.where(costs.at_limit, MAX_LONGER, 1.0) * times + own
        counts: dict[int, int] = {}
        for k in np.argsort(times, kind="stable"):
            index = targets[k].number
            counts[index] = counts.get(index, 0) + 1
            late = _MANY_LATE if counts[index] > limit else 0.0
            child = Child(
                float(times[k]) + late, next(self.numbers), targets[k], joints[k], float(own[k])
            )
            heappush(self.children, child)

    def next_child(self, appraise: Callable[[Child], float] | None = None) -> Child | None:
        """Take the configuration of the next target that promises the most; None where all are.

        Args:
            appraise: Function of the cost of a configuration where it is, as seconds; asked of the
                most promising ones alone.
        """
        while self.children:
            child = heappop(self.children)
            if appraise is not None and not child.appraised:
                more = appraise(child)
                child = child._replace(
                    estimate=child.estimate + more, cost=child.cost + more, appraised=True
                )
                if self.children and child.estimate > self.children[0].estimate:
                    heappush(self.children, child)
                    continue
            late = self.penalties.get(child.target.number, 0.0)
            if not late or not self.children:
                return child
            if child.estimate + late <= self.children[0].estimate:
                return child
            # Others are more promising by now; the penalty counts once.
            self.penalties[child.target.number] = 0.0
            heappush(self.children, child._replace(estimate=child.estimate + late))
        return None

    def blame(self, target: Target | None) -> None:
        """Note a failure under a target of the next segment."""
        self.failures += 1
        if target is not None:
            late = self.penalties.get(target.number, 0.0)
            # A configuration whose target failed once counts as this much longer [s].
            self.penalties[target.number] = late + 1.0


def contact_pairs(stage: Stage) -> dict[Pair, AllowedContact]:
    """Pairs that a target lets touch from its approach on."""
    if isinstance(stage, Grasp):
        contact = AllowedContact("touch_links", stage.touch_depth)
        return {sorted_pair(link, stage.object): contact for link in stage.touches}
    if isinstance(stage, Place):
        contact = AllowedContact("support", stage.touch_depth)
        return {sorted_pair(str(stage.object), name): contact for name in stage.supports}
    return {}


def changed(world: World, stage: Stage, q: Array) -> World:
    """The world after a stage in which the arm stands still."""
    if isinstance(stage, Attach):
        touching = stage.touches, stage.touch_depth
        return world.after_attach(stage.object, stage.link, touching, stage.load, q)
    if isinstance(stage, Detach):
        return world.after_detach(str(stage.object), (stage.touches, stage.touch_depth), q)
    if isinstance(stage, Gripper):
        moved = moved_gripper(world, stage)
        if isinstance(moved, Gripper) and moved.robot is not None:
            return world.with_robot(moved.robot).entered(stage.settings)
    return world


def moved_gripper(world: World, stage: Gripper) -> Gripper | str:
    """A stage of the gripper from where its fingers are; or why they do not hold the object.

    Args:
        world: The world before the stage.
        stage: The stage as if all fingers went all the way in all stages before.
    """
    if stage.motion is None or stage.robot is None:
        return stage
    last = stage.robot.fingers.positions
    if stage.until is not None:
        if world.grasped is None:
            return "nothing is between the fingers"
        stands = world.scene.obstacle(world.grasped.object)
        grasp = np.ascontiguousarray(world.grasped.T).tobytes()
        found = contact_positions(world.robot, stands, grasp, tuple(last.items()))
        if isinstance(found, str):
            return found
        return with_motion(world.robot, replace(stage, fingers=found, until=None))
    if world.robot.fingers.positions == stage.motion.first:
        return stage
    return with_motion(world.robot, stage)


def onward_steps(
    task: Task, cells: Cells, node: Node, segment: Segment, deadline: Deadline
) -> tuple[int, LineStopped | str] | None:
    """Put the steps into a node that follow without a choice.

    Args:
        task: The task.
        cells: Cells that were put together.
        node: The choices so far; its onward steps are written.
        segment: The next segment.
        deadline: Time at which to give up.

    Returns:
        The stage whose straight motion is too short, or whose fingers hold nothing, and why; None
        where all can be done.
    """
    world, q = node.world, node.joints
    for k in segment.forward:
        stage = task.stages[k]
        world = world.entered(stage.settings)
        allowed = contacts_of(stage.settings.allowed, "request")
        if isinstance(stage, Follow):
            world = world.after_motion(free=True) if stage.kind == "seam" else world
            step = Step(k, stage, "follow", world, world.after_motion(free=False), allowed, q, q)
            followed = plan_step(cells, step, 0, deadline, task.seed)
            if isinstance(followed, Failure):
                return k, followed.message
            step.plan, step.end = followed, followed.trajectory.end
            node.onward.append(step)
            world, q = step.after, step.end
        elif isinstance(stage, Straight):
            inside = world.after_insert(stage.into)
            cell = cells.cell(inside, allowed, stage.settings.margin)
            led = lead_straight(cell, world, stage, q, deadline, around=node.around)
            if isinstance(led, LineStopped):
                return k, led
            after = world.after_motion(free=False).after_insert(stage.into)
            world = inside
            bound = least_travel(world, stage, led.start, led.end)
            node.onward.append(
                Step(k, stage, "straight", world, after, allowed, q, led.end, led, bound=bound)
            )
            world, q = after, led.end
        else:
            if isinstance(stage, Gripper):
                moved = moved_gripper(world, stage)
                if isinstance(moved, str):
                    return k, moved
                stage = moved
            world = changed(world, stage, q)
            node.onward.append(
                Step(k, stage, "none", world, world, allowed, q, q, bound=still_time(stage))
            )
        node.history[k] = q
    node.onward_world, node.onward_joints = world, q
    return None


def before_target(task: Task, segment: Segment, node: Node) -> World:
    """The world of the free motion of a segment, after the choices of a node."""
    world = node.onward_world.after_motion(free=True)
    return world.entered(task.stages[segment.free].settings)


def child_node(
    task: Task, cells: Cells, node: Node, segment: Segment, chosen: tuple[Target, Array],
    deadline: Deadline, *, around: bool = False,
) -> Node | tuple[int, LineStopped]:  # fmt: skip
    """The node of one more choice, with its steps; or the approach that is too short.

    Args:
        task: The task.
        cells: Cells that were put together.
        node: The choices before.
        segment: The segment that the choice ends.
        chosen: The target and its configuration (n,).
        deadline: Time at which to give up.
        around: Whether straight motions may go round something.
    """
    target, q = chosen
    stage = task.stages[segment.target]
    world = before_target(task, segment, node)
    pairs = contact_pairs(stage)
    reached = target_world(world, stage, target)
    steps: list[Step] = []
    q_free = q
    if segment.approach is not None:
        approach = task.stages[segment.approach]
        assert isinstance(approach, Straight)
        allowed = pairs | contacts_of(approach.settings.allowed, "request")
        cell = cells.cell(world, allowed, approach.settings.margin)
        led = lead_straight(cell, world, approach, q, deadline, around=around)
        if isinstance(led, LineStopped):
            return segment.approach, led
        q_free = led.start
        bound = least_travel(world, approach, led.start, led.end)
        steps = [
            Step(segment.approach, approach, "straight", world, world, allowed, q_free, q, led,
                 bound=bound),
            Step(segment.target, stage, "none", reached, reached,
                 pairs | contacts_of(stage.settings.allowed, "request"), q, q,
                 target=target.number, bound=still_time(stage)),
        ]  # fmt: skip
    free, is_last = task.stages[segment.free], segment.approach is None
    ends = (node.onward_joints, q_free)
    passing = least_passing(world, task.stages, segment.free, ends)
    bound = least_travel(world, free, *ends) if passing is None else passing
    allowed = (pairs if is_last else {}) | contacts_of(free.settings.allowed, "request")
    steps.insert(
        0,
        Step(
            segment.free, free, "free", world, reached if is_last else world, allowed,
            *ends, target=target.number if is_last else None, bound=bound,
            passes=passing is not None,
        ),
    )  # fmt: skip
    history = {**node.history, **{step.index: step.end for step in steps}}
    return Node(node, node.depth + 1, reached, q, history, target, steps, around=around)


def target_world(world: World, stage: Stage, target: Target) -> World:
    """The world when the tool is at a target."""
    if target.contact is None:
        return world
    if isinstance(stage, Grasp):
        return world.after_grasp(target.contact, contact_pairs(stage))
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
        world = world.entered(stage.settings)
        if isinstance(stage, Grasp):
            return None
        if isinstance(stage, Place):
            return k, world.after_motion(free=True)
        if isinstance(stage, Move | Follow):
            world = world.after_motion(free=True)
        elif isinstance(stage, Straight):
            world = world if stage.kind == "approach" else world.after_motion(free=False)
        else:
            world = changed(world, stage, q)
    return None


class TargetFinder:
    """Finds valid configurations of targets, and keeps them.

    Args:
        task: The stages.
        cells: Cells that were put together.
    """

    def __init__(self, task: Task, cells: Cells) -> None:
        self._task, self._cells = task, cells
        self._candidates: dict[object, Candidates] = {}
        form = structure(task.world.robot.chain)
        self._levels = _LEVELS if form is not None and form.redundant else 1

    def coarse_batches(self, k: int) -> int:
        """Number of batches of a stage's targets, of redundant arms those tried first."""
        # 256 targets are checked together; each batch is spread over the whole list.
        return -(-target_count(self._task.stages[k]) // 256)

    def batches(self, k: int) -> int:
        """Number of batches of a stage's targets; of redundant arms the same ones more finely."""
        return self._levels * self.coarse_batches(k)

    def find(
        self, k: int, world: World, batch: int, history: dict[int, Array], deadline: Deadline
    ) -> Candidates:
        """Valid configurations of a batch of a stage's targets.

        Args:
            k: Number of the stage.
            world: The world before its motion.
            batch: Number of the batch.
            history: Configurations at the ends of earlier stages, by number.
            deadline: Time at which to check no more targets.
        """
        stage = self._task.stages[k]
        back = stage.to_end_of if isinstance(stage, Move) else None
        key = (k, batch, world.key, None if back is None else history[back].tobytes())
        if key not in self._candidates:
            count = self.coarse_batches(k)
            level, part = divmod(batch, count)
            targets = stage_targets(stage, world, history)[part::count]
            cell = self.cell(k, world)
            self._candidates[key] = find_candidates(
                cell.robot.chain, targets, cell.checker, deadline, self._task.seed, level
            )
        return self._candidates[key]

    def cell(self, k: int, world: World) -> Cell:
        """The cell that configurations of a stage's targets are valid in.

        Args:
            k: Number of the stage.
            world: The world before its motion.
        """
        stage = self._task.stages[k]
        allowed = contact_pairs(stage) | contacts_of(stage.settings.allowed, "request")
        return self._cells.cell(world, allowed, stage.settings.margin)
