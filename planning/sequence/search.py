"""The search for the stages of a task: grasps, configurations and places, then their motions.

A tree of choices, one level for each stage with alternatives. What is cheap comes first: inverse
kinematics, collisions of configurations, and for a grasp the collisions of the held object at every
place; then straight motions; free motions are planned last, for combinations of which all the rest
is known. Combinations that promise the least time are tried first; one that failed makes its
relatives wait. After the first proved answer the search goes on for a shorter one and leaves out
what can't be shorter by the least times of its motions.
"""

import time
from functools import partial
from heapq import heapify, heappop, heappush
from itertools import count
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array, typed
from planning.result import Failure
from planning.sequence.configuration_choice import (
    ConfigurationCosts,
    LimitAvoidance,
    rests_at_limit,
)
from planning.sequence.first_checks import check_first
from planning.sequence.node import (
    Child,
    Node,
    TargetFinder,
    before_target,
    child_node,
    next_place,
    onward_steps,
    target_world,
)
from planning.sequence.record import Check, Record, describe_stop, search_failure
from planning.sequence.result import (
    Improvement,
    SequenceFailure,
    SequencePlan,
    StagePlan,
    TaskOptions,
    total_duration,
)
from planning.sequence.stage import Grasp, describe_stage
from planning.sequence.step import LineStopped, Step, plan_step
from planning.sequence.target import Target
from planning.sequence.task import Segment, Task
from planning.sequence.via_blending import pass_ends
from planning.sequence.world import Cells, World
from planning.values.deadline import Deadline

#: Edges that a planner of a free motion may check, by how often it was tried: some tenths of a
#: second at first, some seconds at last. Nine of ten motions in shelves take 400, all 3,000. They
#: are edges, not seconds: what is tried next depends on the seed alone.
_FREE_EDGES = (10_000, 50_000, 200_000)
#: Codes of free motions that may be found by a longer search.
_MAY_SUCCEED = ("PLANNING_FAILED", "TIMED_OUT")


class _Best(NamedTuple):
    """The proved answer that costs the least so far: its time and its configurations."""

    node: Node
    stages: tuple[StagePlan, ...]
    duration: float
    value: float


@typed
def plan_task(task: Task, options: TaskOptions) -> SequencePlan | SequenceFailure:
    """Find, time and prove the motions of all stages, before one deadline.

    Args:
        task: The robot, the scene, the start and the stages.
        options: Timeout and time to improve.

    Returns:
        The stages whose trajectories join at rest, each proved; or where the search got stuck.

    Raises:
        InvalidOption: An unknown planner or option of a stage.
        InvalidObjectName: A stage lets an unknown name touch something.
        MissingLimit: A velocity or acceleration limit is not known.
    """
    return _Search(task, options).run()


class _Search:
    """One search."""

    def __init__(self, task: Task, options: TaskOptions) -> None:
        self._task, self._options = task, options
        self._deadline = Deadline.after(options.timeout)
        self._began = time.perf_counter()
        self._cells, self._record = Cells(), Record()
        self._numbers = count()
        self._open: list[tuple[float, int, Node]] = []
        self._finder = TargetFinder(task, self._cells)
        self._costs = ConfigurationCosts(options.goal_costs)
        #: Whether a straight way of a target was found that goes round something.
        self._rounds: dict[object, bool] = {}
        self._best: _Best | None = None
        self._prefix: tuple[StagePlan, ...] = ()
        self._improvements: list[Improvement] = []
        self._farthest: Node | None = None
        self._until = self._deadline
        if options.allow_partial:
            # Share of the time for the search where the first stages are an answer too: these need
            # a proof.
            self._until = self._deadline.within(0.8 * options.timeout)

    def run(self) -> SequencePlan | SequenceFailure:
        """Search until nothing is left or time is up."""
        goals = not self._options.allow_partial
        wrong = check_first(self._task, self._cells, self._deadline, goals=goals)
        if wrong is not None:
            return wrong
        root = Node(None, 0, self._task.world, self._task.start, {})
        self._push(root, 0.0)
        while self._open and not self._is_over():
            _, _, node = heappop(self._open)
            if any(one.dead for one in node.path) or self._is_longer(node):
                continue
            if self._is_complete(node):
                self._realise(node)
            else:
                self._advance(node)
        return self._answer()

    def _is_over(self) -> bool:
        """Whether nothing more is tried; no clock decides where nothing is to be improved."""
        return (self._best is not None and self._options.improve <= 0.0) or self._until.passed

    # --------------------------------------------------------------------- the tree of choices

    def _advance(self, node: Node) -> None:
        """Take the most promising next choice of a node."""
        if not node.expanded:
            node.expanded = True
            if not self._expand(node):
                self._kill(node)
                return
            if node.depth + 1 == len(self._task.segments) and self._is_trailing(node.depth):
                self._push(node, 0.0)
                return
        taken = node.next_child(partial(self._clearance_cost, node))
        if taken is not None:
            self._add_child(node, taken)
            if node.children:
                self._push(node, max(taken.estimate, node.children[0].estimate))
                return
        if self._load(node):
            self._push(node, node.children[0].estimate)

    def _expand(self, node: Node) -> bool:
        """Find out what follows from a node's choices: steps without a choice, next targets."""
        segment = self._task.segments[node.depth]
        stopped = onward_steps(self._task, self._cells, node, segment, self._until)
        if stopped is not None:
            k, led = stopped
            self._record.note_failure(node, k, describe_stop(led))
            at_target = isinstance(led, LineStopped) and np.array_equal(led.start, node.joints)
            if node.parent is not None and node.target is not None and at_target:
                assert isinstance(led, LineStopped)
                self._look_round(node.parent, node.target, k, led)
            return False
        node.at_limit = rests_at_limit(self._task.world.robot.chain, node)
        return segment.trails or self._load(node)

    def _load(self, node: Node) -> bool:
        """Put the next batch of targets that has any valid configuration among the children."""
        segment = self._task.segments[node.depth]
        if segment.trails:
            return False
        k, options = segment.target, self._task.stages[segment.free].settings.options
        world = self._before(node)
        for batch in range(node.batches, self._finder.batches(k)):
            node.batches = batch + 1
            candidates = self._finder.find(k, world, batch, node.history, self._until)
            self._record.note_candidates(node.choices, k, candidates)
            costs = self._costs.of(world.robot.chain, candidates, node.onward_joints)
            # Configurations of one target that are tried.
            node.add_children(candidates.targets, candidates.joints, 24, options, costs)
            if node.children or self._until.passed:
                break
        return bool(node.children)

    def _before(self, node: Node) -> World:
        """The world of the free motion that follows the choices of a node."""
        return before_target(self._task, self._task.segments[node.depth], node)

    def _clearance_cost(self, node: Node, child: Child) -> float:
        segment = self._task.segments[node.depth]
        cell = self._finder.cell(segment.target, self._before(node))
        return self._costs.of_clearance(cell, child)

    def _add_child(self, node: Node, taken: Child) -> None:
        segment, target, joints = self._task.segments[node.depth], taken.target, taken.joints
        refuted = not self._rounds.get(self._key(node, target), True)
        if refuted or not self._leads_to_place(node, segment, target, joints):
            node.children = _without(node, target)
            return
        child = child_node(
            self._task, self._cells, node, segment, (target, joints), self._until,
            around=taken.around,
        )  # fmt: skip
        if isinstance(child, Node):
            child.cost = taken.cost
            child.at_limit = rests_at_limit(self._task.world.robot.chain, child)
            self._push(child, 0.0)
            return
        k, led = child
        stages = segment.target, k
        self._record.note_child(node, target.number, stages, describe_stop(led), joints)
        node.blame(target)
        self._look_round(node, target, k, led)

    def _look_round(self, node: Node, target: Target, k: int, led: LineStopped) -> None:
        """Put the configuration next whose straight way goes round what others meet on theirs.

        Where no configuration of the target has such a way, all of them are left out.

        Args:
            node: The choices before.
            target: A target of the next segment.
            k: Number of the stage of the straight way.
            led: The way of one of the target's configurations.
        """
        key, world = self._key(node, target), self._before(node)
        if (*key, k) in self._rounds:
            return
        number = self._task.segments[node.depth].target
        every = [
            self._finder.find(number, world, batch, node.history, self._until)
            for batch in range(self._finder.batches(number))
        ]
        found = led.found_round(
            [led.start, *(q for one in every for q in one.joints_of(target))],
            self._until,
            any_start=True,
        )
        self._rounds[(*key, k)] = found is not None
        if found is not None:
            if not node.children:
                self._push(node, 0.0)
            q = found.segments[0].start
            heappush(node.children, Child(0.0, next(node.numbers), target, q, around=True))
        elif not self._until.passed:
            self._rounds[key] = False
            node.children = _without(node, target)

    def _key(self, node: Node, target: Target) -> tuple[object, ...]:
        """All that a target hangs on after the choices of a node, but for free motions to it."""
        joints = None if target.joints is None else target.joints.tobytes()
        return node.depth, self._before(node).key, target.number, joints

    def _leads_to_place(self, node: Node, segment: Segment, target: Target, q: Array) -> bool:
        """Whether with a grasp some place of the object has a valid configuration."""
        stage = self._task.stages[segment.target]
        if not isinstance(stage, Grasp):
            return True
        world = target_world(self._before(node), stage, target)
        place = next_place(self._task, segment.target + 1, world, q)
        choices = (*node.choices, target.number)
        if place is None or self._has_place(choices, *place):
            return True
        reason = "no place can be reached with this grasp"
        self._record.note_child(node, target.number, (segment.target, None), reason, q)
        return False

    def _has_place(self, choices: tuple[int, ...], k: int, world: World) -> bool:
        """Whether some place of the held object has a valid configuration, before any path."""
        for batch in range(self._finder.batches(k)):
            candidates = self._finder.find(k, world, batch, {}, self._until)
            if len(candidates.joints) or self._until.passed:
                return True
            self._record.note_candidates(choices, k, candidates, Check.PLACE)
        return False

    def _push(self, node: Node, estimate: float) -> None:
        """Put a node among the open ones; ``estimate`` is the least time of its next motion."""
        steps = len(node.all_steps)
        if self._farthest is None or steps > len(self._farthest.all_steps):
            self._farthest = node
        # Seconds by which each segment that is done makes a node more promising, before the first
        # answer.
        rest = -5.0 * node.depth
        if self._best is not None:
            # Share of the time of the best answer's later segments that others will take likewise.
            rest = 0.7 * total_duration(self._best.stages[steps:])
        # Seconds by which a node whose free motion took too long counts as longer.
        late = 2.0 * node.attempts
        priority = node.value + estimate + rest + node.penalty + late
        heappush(self._open, (priority, next(self._numbers), node))

    def _is_trailing(self, depth: int) -> bool:
        return self._task.segments[depth].trails

    def _is_complete(self, node: Node) -> bool:
        segments = self._task.segments
        if node.depth == len(segments):
            return True
        last = node.depth + 1 == len(segments) and self._is_trailing(node.depth)
        return last and node.expanded

    def _is_longer(self, node: Node) -> bool:
        return self._best is not None and node.value >= self._best.value

    def _kill(self, node: Node) -> None:
        node.dead = True
        if node.parent is not None:
            node.parent.blame(node.target)

    # ---------------------------------------------------------------------------- the motions

    def _realise(self, leaf: Node) -> None:
        """Plan and prove the motions of a combination, those that have no choice first."""
        for free in (False, True):
            for node in leaf.path:
                for step in (*node.steps, *node.onward):
                    if step.plan is None and (step.motion == "free") is free:
                        failure = self._plan(node, step)
                        if failure is not None:
                            self._note_failure(leaf, node, step, failure)
                            return
                        if self._is_longer(leaf):
                            return
        stages = pass_ends(self._cells, leaf.all_steps, self._until)
        duration = total_duration(stages)
        value = leaf.value + duration - leaf.bound
        if self._best is None or value < self._best.value:
            self._improve(_Best(leaf, stages, duration, value))

    def _plan(self, node: Node, step: Step) -> Failure | None:
        max_edges = _FREE_EDGES[min(node.attempts, len(_FREE_EDGES) - 1)]
        self._report(step)
        planned = plan_step(self._cells, step, max_edges, self._until, self._task.seed)
        if isinstance(planned, Failure):
            return planned
        step.plan = planned
        return None

    def _note_failure(self, leaf: Node, node: Node, step: Step, failure: Failure) -> None:
        self._store_prefix(leaf)
        if self._until.passed and self._until is self._deadline:
            return
        check = Check.FREE if step.motion == "free" else Check.STILL_OR_STRAIGHT
        self._record.note_failure(node, step.index, failure.message, check)
        node.attempts += 1
        again = failure.code in _MAY_SUCCEED and node.attempts < len(_FREE_EDGES)
        if node.parent is not None:
            node.parent.blame(node.target)
        if again and step.motion == "free":
            self._push(leaf, 0.0)
        else:
            node.dead = True

    def _store_prefix(self, leaf: Node) -> None:
        """Keep the proved stages up to the first that is not, if they are more than before."""
        stages: list[StagePlan] = []
        for step in leaf.all_steps:
            if step.plan is None:
                break
            stages.append(step.plan)
        if len(stages) > len(self._prefix):
            self._prefix = tuple(stages)

    def _improve(self, best: _Best) -> None:
        if self._best is None:
            self._until = self._deadline.at_most(self._options.improve)
        self._best = best
        milliseconds = 1e3 * (time.perf_counter() - self._began)
        self._improvements.append(Improvement(milliseconds, best.duration))
        self._record.note_solution(best.node)
        if self._options.offer is not None:
            self._options.offer(self._plan_of(best.stages, exhausted=False))

    def _plan_of(
        self,
        stages: tuple[StagePlan, ...],
        *,
        exhausted: bool,
        failure: SequenceFailure | None = None,
    ) -> SequencePlan:
        """The answer that some stages are: all, or those before a failure."""
        return SequencePlan(
            stages,
            total_duration(stages),
            self._record.trials,
            tuple(self._improvements),
            exhausted=exhausted,
            complete=failure is None,
            failure=failure,
            deterministic=not self._deadline.interruptions.occurred,
        )

    def _report(self, step: Step) -> None:
        observer = self._options.observer
        if observer is None:
            return
        share = 0.9 * step.index / len(self._task.stages)
        if self._best is not None:
            share = 0.95
        observer(share, describe_stage(self._task.stages, step.index))

    # ------------------------------------------------------------------------------ the answer

    def _answer(self) -> SequencePlan | SequenceFailure:
        if self._best is not None:
            stages = self._away_from_limits(self._best)
            return self._plan_of(stages, exhausted=not self._open)
        failure = search_failure(
            self._task, self._record, self._options.timeout, self._deadline,
            late=self._until.passed, prefix=self._prefix,
        )  # fmt: skip
        if self._options.allow_partial and len(self._prefix) < len(self._task.stages):
            self._prove_farthest()
        if self._options.allow_partial and self._prefix:
            return self._plan_of(self._prefix, exhausted=False, failure=failure)
        return failure

    def _away_from_limits(self, best: _Best) -> tuple[StagePlan, ...]:
        """The stages of the best answer, led away from joint limits where that takes little."""
        away = LimitAvoidance(
            self._task, self._cells, self._finder, self._costs, best.node, best.stages,
            self._deadline,
        )  # fmt: skip
        away.run()
        if away.replaced:
            milliseconds = 1e3 * (time.perf_counter() - self._began)
            self._improvements.append(Improvement(milliseconds, total_duration(away.stages)))
            self._record.note_solution(away.leaf)
        return away.with_configurations()

    def _prove_farthest(self) -> None:
        """Plan the stages of the combination that came farthest, as many as can be done."""
        self._until = self._deadline
        if self._farthest is None:
            return
        for node in self._farthest.path:
            for step in (*node.steps, *node.onward):
                if step.plan is None and self._plan(node, step) is not None:
                    self._store_prefix(self._farthest)
                    return
        self._store_prefix(self._farthest)


def _without(node: Node, target: Target) -> list[Child]:
    """The children of a node but those of one target, a heap."""
    children = [child for child in node.children if child.target.number != target.number]
    heapify(children)
    return children
