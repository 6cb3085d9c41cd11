"""Configurations at a joint limit, replaced where another one takes little longer.

The search goes by least times. Where the proved answer rests at a joint limit all the same, the
other configurations of that target are planned to: all other choices stay as they are, and the
first that makes the motions beside it at most a fifth longer takes its place.
"""

from dataclasses import dataclass, field, replace
from itertools import count
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array
from kinematics.model.chain import Chain
from obstacles.collision.checker import Checker
from planning.goal_choice.goal_order import (
    FAR_FROM_OBSTACLES,
    MAX_EDGES,
    MAX_LONGER,
    MAX_PLANNED,
    chosen_configuration,
    clearance_lacks,
    configuration_costs,
    is_at_limit,
    turn_counts,
)
from planning.preflight.goals import configurations_off_limits
from planning.result import ChosenConfiguration, Failure
from planning.sequence.node import (
    Child,
    Node,
    OwnCosts,
    TargetFinder,
    before_target,
    child_node,
    onward_steps,
)
from planning.sequence.result import StagePlan, total_duration
from planning.sequence.stage import Move
from planning.sequence.step import LineStopped, Step, plan_step, scaled_limits
from planning.sequence.target import Candidates, Target
from planning.sequence.task import Segment, Task
from planning.sequence.via_blending import pass_ends
from planning.sequence.world import Cell, Cells
from planning.timing.rest_to_rest import motion_times
from planning.values.deadline import Deadline
from planning.values.preferences import GoalCosts, time_weight


class ConfigurationCosts:
    """Costs of the configurations of a search.

    Args:
        weights: Weights of the costs.
    """

    def __init__(self, weights: GoalCosts) -> None:
        self.weights = weights
        self._scale = 1.0 / time_weight(weights)
        self._known: dict[int, tuple[Candidates, OwnCosts]] = {}
        self._clearances: dict[tuple[int, bytes], float] = {}

    def of(self, chain: Chain, candidates: Candidates, start: Array) -> OwnCosts | None:
        """Costs that need no check of the surroundings; None where no target is a pose.

        Args:
            chain: The robot with what it holds.
            candidates: Valid configurations of a stage's targets.
            start: Beginning of the motion to them, shape (n,).
        """
        if all(target.T is None for target in candidates.targets):
            return None
        known = self._known.get(id(candidates))
        if known is None:
            known = self._known[id(candidates)] = candidates, self._own(chain, candidates)
        own, weights = known[1], self.weights
        turns = weights.turns * turn_counts(chain, start, candidates.joints)
        return OwnCosts(own.seconds + self._scale * turns, own.at_limit)

    def _own(self, chain: Chain, candidates: Candidates) -> OwnCosts:
        joints = candidates.joints
        seconds = self._scale * configuration_costs(chain, joints, self.weights)
        posed = np.array([target.T is not None for target in candidates.targets])
        return OwnCosts(seconds, posed & is_at_limit(chain, joints))

    def of_clearance(self, cell: Cell, child: Child) -> float:
        """Cost of the clearance of a configuration in its surroundings."""
        if child.target.T is None or not self.weights.clearance:
            return 0.0
        clearance = self.clearance(cell.checker, child.joints)
        lack = clearance_lacks(np.array([clearance]))[0]
        return float(self._scale * self.weights.clearance * lack)

    def clearance(self, checker: Checker, q: Array) -> float:
        """Clearance of a configuration (n,), 5 cm where it is that or more [m]."""
        key = id(checker), q.tobytes()
        if key not in self._clearances:
            spacious = Checker(checker.model, FAR_FROM_OBSTACLES).valid(q)
            least = FAR_FROM_OBSTACLES if spacious else checker.clearance(q)[0]
            self._clearances[key] = float(least)
        return self._clearances[key]


def rests_at_limit(chain: Chain, node: Node) -> bool:
    """Whether the arm rests at a joint limit where the choice of a node has it rest.

    What is asked for as joints is no choice.
    """
    if node.target is None or node.target.T is None:
        return False
    moves = [step.end for step in (*node.steps, *node.onward) if step.motion != "none"]
    return bool(is_at_limit(chain, np.array([node.joints, *moves])).any())


class Replacement(NamedTuple):
    """A configuration that took the place of one at a joint limit.

    Args:
        before: Time of the motions beside the one at the limit [s].
        after: Time of those that take their place [s].
    """

    before: float
    after: float


@dataclass(slots=True, eq=False)
class LimitAvoidance:
    """A proved combination, led away from joint limits.

    Args:
        task: The stages.
        cells: Cells that were put together.
        finder: Knows the configurations of all targets.
        costs: Costs of the configurations.
        leaf: The last node of the combination.
        stages: Plans of the stages, in order.
        deadline: The end of everything.
        replaced: Replacement of a configuration at a limit, by the number of its stage.
    """

    task: Task
    cells: Cells
    finder: TargetFinder
    costs: ConfigurationCosts
    leaf: Node
    stages: tuple[StagePlan, ...]
    deadline: Deadline
    replaced: dict[int, Replacement] = field(default_factory=dict)

    def run(self) -> None:
        """Replace what can be replaced, from the first target to the last, until nothing can."""
        changed = True
        while changed and not self.deadline.passed:
            depths = [k for k, node in enumerate(self.leaf.path) if _is_at_limit(node)]
            # Each replacement leaves one fewer at a limit: this ends.
            changed = sum(self._replace(depth) for depth in depths) > 0

    def _replace(self, depth: int) -> bool:
        planned = count()
        if not _is_at_limit(self.leaf.path[depth]):
            return False
        for target, q in self._others(depth):
            if self.deadline.passed:
                return False
            leaf = self._with(depth, target, q)
            if leaf is None or _count_at_limit(leaf) >= _count_at_limit(self.leaf):
                continue
            steps = leaf.all_steps
            changed = [k for k, step in enumerate(steps) if step.plan is None]
            before = sum(self.stages[k].trajectory.duration for k in changed)
            if sum(steps[k].least_time for k in changed) > MAX_LONGER * before:
                continue
            if next(planned) == MAX_PLANNED:
                return False
            if not self._plan([steps[k] for k in changed]):
                continue
            stages = pass_ends(self.cells, steps, self.deadline)
            longer = total_duration(stages) - total_duration(self.stages)
            if longer <= (MAX_LONGER - 1.0) * before:
                number = self.task.segments[depth - 1].target
                self.replaced[number] = Replacement(before, before + longer)
                self.leaf, self.stages = leaf, stages
                return True
        return False

    def _plan(self, steps: list[Step]) -> bool:
        """Plan steps, those that have no choice of a way first; whether all can be done."""
        for step in sorted(steps, key=lambda step: step.motion == "free"):
            plan = plan_step(self.cells, step, MAX_EDGES, self.deadline, self.task.seed)
            if isinstance(plan, Failure):
                return False
            step.plan = plan
        return True

    # ------------------------------------------------------------------ the other configurations

    def _others(self, depth: int) -> list[tuple[Target, Array]]:
        """Other configurations of a node's target away from limits, the soonest first.

        Of a motion's goals any one will do; another grasp or place would change what follows.
        """
        path = self.leaf.path
        node, parent = path[depth], path[depth - 1]
        segment = self.task.segments[depth - 1]
        k, begin = segment.target, parent.onward_joints
        world = before_target(self.task, segment, parent)
        assert node.target is not None
        any_target = isinstance(self.task.stages[k], Move)
        chain, options = world.robot.chain, self.task.stages[k].settings.options
        found: list[tuple[Target, Array]] = []
        for batch in range(self.finder.coarse_batches(k)):
            candidates = self.finder.find(k, world, batch, parent.history, self.deadline)
            if not len(candidates.joints):
                continue
            inside = ~is_at_limit(chain, candidates.joints)
            found += [
                (candidates.targets[i], candidates.joints[i])
                for i in np.flatnonzero(inside)
                if any_target or candidates.targets[i].number == node.target.number
            ]
        if node.target.T is not None:
            checker = self.finder.cell(k, world).checker
            found += [
                (node.target, q)
                for q in configurations_off_limits(
                    chain, checker, node.target.T, begin, self.task.seed, self.costs.weights
                )
            ]
        if not found:
            return []
        joints = np.array([q for _, q in found])
        limits = scaled_limits(chain, options)
        times = motion_times(chain, begin, joints, limits)
        if depth + 1 < len(path) and path[depth + 1].steps:
            times = times + motion_times(chain, path[depth + 1].steps[0].end, joints, limits)
        return [found[i] for i in np.argsort(times, kind="stable")]

    def _with(self, depth: int, target: Target, q: Array) -> Node | None:
        """The combination with another configuration at one target; None where it can't be done.

        Plans of steps that stay as they are stay with them.
        """
        path, known = self.leaf.path, {step.index: step for step in self.leaf.all_steps}
        task, node = self.task, path[depth - 1]
        for k in range(depth, len(path)):
            chosen = (target, q) if k == depth else self._choice(path[k], k, node)
            segment, around = task.segments[k - 1], path[k].around
            child = child_node(
                task, self.cells, node, segment, chosen, self.deadline, around=around
            )
            if not isinstance(child, Node):
                return None
            child.cost, child.expanded = path[k].cost, path[k].expanded
            if path[k].expanded:
                stopped = onward_steps(task, self.cells, child, task.segments[k], self.deadline)
                if isinstance(stopped, tuple) and isinstance(stopped[1], LineStopped):
                    return None
            child.at_limit = rests_at_limit(task.world.robot.chain, child)
            for step in (*child.steps, *child.onward):
                if _is_same(step, known[step.index]):
                    step.plan = known[step.index].plan
            node = child
        return node

    def _choice(self, node: Node, depth: int, parent: Node) -> tuple[Target, Array]:
        """Target and configuration of a node, under a parent whose rests may be others."""
        number = self.task.segments[depth - 1].target
        assert node.target is not None
        stage = self.task.stages[number]
        if isinstance(stage, Move) and stage.to_end_of is not None:
            q = parent.history[stage.to_end_of]
            return node.target._replace(joints=q), q
        return node.target, node.joints

    # ---------------------------------------------------------------------------- the answer

    def with_configurations(self) -> tuple[StagePlan, ...]:
        """The plans of the stages, those of poses with the configuration that was chosen."""
        chosen: dict[int, ChosenConfiguration] = {}
        for node, segment in zip(self.leaf.path[1:], self.task.segments, strict=False):
            if node.target is not None and node.target.T is not None:
                chosen[segment.target] = self._chosen(node, segment, segment.target)
        return tuple(
            replace(stage, configuration=chosen[stage.index]) if stage.index in chosen else stage
            for stage in self.stages
        )

    def _chosen(self, node: Node, segment: Segment, k: int) -> ChosenConfiguration:
        parent, finder = node.parent, self.finder
        assert parent is not None
        world = before_target(self.task, segment, parent)
        rows = [
            finder.find(k, world, batch, parent.history, self.deadline).joints
            for batch in range(parent.batches or 1)
        ]
        found = np.concatenate(rows)
        if not (found == node.joints).all(axis=1).any():
            found = np.concatenate(
                [found, node.joints[None]]
            )  # It took the place of one at a limit.
        chain, options = world.robot.chain, self.task.stages[segment.free].settings.options
        begin = parent.onward_joints
        return chosen_configuration(
            chain, found, node.joints, begin,
            motion_times(chain, begin, found, scaled_limits(chain, options)),
            self.costs.clearance(finder.cell(k, world).checker, node.joints),
            self.costs.weights, self.replaced.get(k),
        )  # fmt: skip


def _is_at_limit(node: Node) -> bool:
    """Whether a node is one whose choice has the arm rest at a joint limit."""
    return node.parent is not None and node.at_limit


def _count_at_limit(leaf: Node) -> int:
    return sum(_is_at_limit(node) for node in leaf.path)


def _is_same(step: Step, known: Step) -> bool:
    """Whether a step is one that was planned before."""
    same = np.array_equal(step.start, known.start) and np.array_equal(step.end, known.end)
    worlds = step.world.key == known.world.key and step.after.key == known.after.key
    return same and worlds and step.allowed == known.allowed
