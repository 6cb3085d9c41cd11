"""Planning where constraints leave little room: a tree that grows along the set they allow.

A step towards a target is projected onto the allowed set (Newton's method on the residuals, inside
the joint limits) and taken where the straight motion to it holds the constraints for every instant
and is proved free; steps shrink where the set is curved. Two trees grow towards each other until
they meet. Source: "Manipulation planning on constraint manifolds", IEEE International Conference on
Robotics and Automation, 2009.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from kinematics.arrays import Array
from kinematics.compiled.kernel import kernel
from obstacles.collision_model import ModelArrays
from obstacles.edge_check import FREE, certify_curve
from planning.constrained.checker import ConstrainedChecker, narrowed
from planning.constraints.active_set import HELD, Goal, make_feasible, make_goal, make_work
from planning.constraints.edge_bounds import EDGE_CELLS, HOLDS, TOLERANCE, hold_kernel
from planning.deadline import Deadline
from planning.search_box import search_box

#: Longest and shortest step of a tree, Euclidean in joint space.
_LONGEST, _SHORTEST = 0.5, 0.01
#: Steps of one extension at most.
_MAX_STEPS = 400
#: Of half a row's width, what projected configurations keep back: edges between them bulge.
_KEPT_BACK = 0.25
_PROJECTIONS = 12
_SAMPLE_PROJECTIONS = 40
#: Walks after which a pair of trees is given up for fresh ones; the next may take somewhat more.
_FIRST_BUDGET, _BUDGET_GROWTH = 400, 1.6
_SEED_STRIDE = 7_919
#: Attempts at a shorter way, and in a row without any gain.
_CUTS, _PATIENCE, _LEAST_GAIN = 160, 50, 1e-3
#: A goal more is sought after so many extensions, and there are so many at most.
_GOAL_STRIDE, _MOST_GOALS = 8, 400
_UNIT = np.array([0.0, 1.0])

#: From a configuration to a goal near it, for the k-th time asked; None where none was found.
MoreGoals = Callable[[Array, int], Array | None]


@dataclass(frozen=True, slots=True, eq=False)
class Manifold:
    """The set that a checker's constraints allow, and how to extend a tree along it.

    Args:
        checker: The robot in its scene with its constraints.
    """

    checker: ConstrainedChecker
    goal: Goal = field(init=False)
    rows: Array = field(init=False)

    def __post_init__(self) -> None:
        chain, constraints = self.checker.model.chain, self.checker.constraints
        zero, inner = np.zeros(chain.n), narrowed(constraints, _KEPT_BACK)
        goal = make_goal(constraints, zero, zero, rows=inner)
        object.__setattr__(self, "goal", goal)
        object.__setattr__(self, "rows", self.checker.rows)

    def projected(self, q: Array) -> Array | None:
        """The configuration of the set that Newton's method finds from q, if it finds one."""
        made = np.array(q)
        if project_kernel(self.goal, made, _SAMPLE_PROJECTIONS) > HELD:
            return None
        return made

    def extend(self, start: Array, end: Array) -> tuple[Array, bool]:
        """From ``start`` towards ``end`` along the set; the steps taken (k, n), and if it arrived.

        The start is left out; every step is proved to hold the constraints and to be free.
        """
        steps = np.empty((_MAX_STEPS, len(start)))
        count, arrived = extend_kernel(
            self.checker.model.arrays, self.checker.slack, self.goal, self.rows,
            np.array(start), np.array(end), steps,
        )  # fmt: skip
        return steps[:count], bool(arrived)


class _Tree:
    """Configurations and the ones they were reached from."""

    def __init__(self, roots: list[Array]) -> None:
        self._nodes = np.array(roots)
        self._size = len(roots)
        self._parents = [-1] * len(roots)

    def nearest(self, q: Array) -> int:
        """Number of the nearest node."""
        away = self._nodes[: self._size] - q
        return int(np.argmin(np.einsum("ij,ij->i", away, away)))

    def node(self, number: int) -> Array:
        """A configuration."""
        return np.asarray(self._nodes[number])

    def add(self, parent: int, steps: Array) -> int:
        """Append a chain of configurations; the number of the last one."""
        needed = self._size + len(steps)
        if needed > len(self._nodes):
            more = np.empty((max(needed, 2 * len(self._nodes)), self._nodes.shape[1]))
            more[: self._size] = self._nodes[: self._size]
            self._nodes = more
        for step in steps:
            self._nodes[self._size] = step
            self._parents.append(parent)
            parent = self._size
            self._size += 1
        return parent

    @property
    def size(self) -> int:
        """How many nodes there are."""
        return self._size

    def add_root(self, q: Array) -> int:
        """Append a configuration that was reached from none; its number."""
        return self.add(-1, q[None])

    def branch(self, number: int) -> list[Array]:
        """The way from a node down to its root."""
        way = []
        while number >= 0:
            way.append(self.node(number))
            number = self._parents[number]
        return way


def projected_rrt(
    manifold: Manifold,
    start: Array,
    goals: list[Array],
    seed: int,
    deadline: Deadline,
    more: MoreGoals | None = None,
) -> tuple[Array | None, int]:
    """Grow trees from start and goals until they meet.

    Args:
        manifold: What is allowed.
        start: Shape (n,), valid.
        goals: Valid configurations (n,).
        seed: The same seed gives the same path.
        deadline: When to stop.
        more: Where goals are regions: finds goals near configurations that were reached.

    Returns:
        Waypoints (k, n) whose legs hold and are free, None where it found none in time; and how
        many extensions were tried.
    """
    spent, budget, attempt = 0, _FIRST_BUDGET, 0
    goals = list(goals)
    while not deadline.passed:
        random = np.random.default_rng((seed, attempt * _SEED_STRIDE))
        path, extensions = _attempt(manifold, start, goals, random, budget, deadline, more)
        spent += extensions
        if path is not None:
            return path, spent
        attempt, budget = attempt + 1, int(_BUDGET_GROWTH * budget)
    return None, spent


def _attempt(
    manifold: Manifold,
    start: Array,
    goals: list[Array],
    random: np.random.Generator,
    budget: int,
    deadline: Deadline,
    more: MoreGoals | None,
) -> tuple[Array | None, int]:
    low, high = search_box(manifold.checker.model.chain, [start, *goals])
    here, there = _Tree([start]), _Tree(list(goals))
    forwards, extensions = True, 0
    target: Array | None = goals[0]
    while extensions < budget and not deadline.passed:
        if target is None:
            drawn = random.uniform(low, high)
            target = manifold.projected(drawn)
            target = drawn if target is None else target
        near = here.nearest(target)
        steps, _ = manifold.extend(here.node(near), target)
        extensions += 1
        target = None
        if more is not None and forwards and extensions // 2 % _GOAL_STRIDE == 1:
            target = _new_goal(here, there, goals, more, random)
        if len(steps):
            reached = here.add(near, steps)
            close = there.nearest(here.node(reached))
            steps, met = manifold.extend(there.node(close), here.node(reached))
            extensions += 1
            last = there.add(close, steps) if len(steps) else close
            if met:
                way = here.branch(reached)[::-1] + there.branch(last)[1:]
                return np.array(way if forwards else way[::-1]), extensions
        here, there, forwards = there, here, not forwards
    return None, extensions


def _new_goal(
    reached: _Tree,
    there: _Tree,
    goals: list[Array],
    more: MoreGoals,
    random: np.random.Generator,
) -> Array | None:
    """A goal near what the start's tree has reached, which the other tree grows from too."""
    if len(goals) >= _MOST_GOALS:
        return None
    found = more(reached.node(int(random.integers(reached.size))), len(goals))
    if found is not None:
        goals.append(found)
        there.add_root(found)
    return found


def shortcut_along(manifold: Manifold, waypoints: Array, seed: int, deadline: Deadline) -> Array:
    """Shorten a path (k, n) of proved legs by straight cuts and by extensions.

    The legs of what comes back are proved too.
    """
    points = list(waypoints)
    random = np.random.default_rng(seed)
    idle = 0
    for _ in range(_CUTS):
        if len(points) < 3 or idle >= _PATIENCE or deadline.passed:
            break
        cut = _cut(manifold, points, random)
        idle = idle + 1 if cut is None else 0
        points = points if cut is None else cut
    return np.array(points)


def _cut(
    manifold: Manifold, points: list[Array], random: np.random.Generator
) -> list[Array] | None:
    lengths = np.array([np.linalg.norm(b - a) for a, b in pairwise(points)])
    ends = np.cumsum(lengths)
    first, last = np.sort(random.uniform(0.0, ends[-1], 2))
    i, j = int(np.searchsorted(ends, first)), int(np.searchsorted(ends, last))
    if i == j:
        return None
    a, b = (
        points[leg] + (1.0 - (ends[leg] - at) / lengths[leg]) * (points[leg + 1] - points[leg])
        for leg, at in ((i, first), (j, last))
    )
    most = last - first - _LEAST_GAIN * ends[-1]
    if np.linalg.norm(b - a) > most:
        return None
    between: list[Array] = []
    if not manifold.checker.free(a, b):
        steps, arrived = manifold.extend(a, b)
        way = np.vstack([a, steps])
        if not arrived or np.linalg.norm(np.diff(way, axis=0), axis=1).sum() > most:
            return None
        between = list(steps[:-1])
    return [*points[: i + 1], a, *between, b, *points[j + 1 :]]


@kernel
def project_kernel(goal: Goal, q: Array, steps: int) -> float:
    """Bring q (n,) into the set in place; the worst residual that is left."""
    work = make_work(None, goal)
    return make_feasible(None, goal, q, steps, work, np.empty_like(q), np.empty_like(q))


@kernel
def extend_kernel(
    model: ModelArrays, slack: float, goal: Goal, rows: Array, start: Array,
    end: Array, steps: Array,
) -> tuple[int, bool]:  # fmt: skip
    """Kernel of ``Manifold.extend``: how many rows of ``steps`` were written, and if it arrived."""
    n = start.shape[0]
    work = make_work(None, goal)
    trial, dq, scratch = np.empty(n), np.empty(n), np.empty(n)
    q, zero = start.copy(), np.zeros(n)
    m = rows.shape[0]
    gaps, worst, times, found = np.full(m, np.inf), np.empty(m), np.empty(m), np.empty(4)
    line, unit = np.empty((1, n, 2)), np.array([0.0, 1.0])
    away = np.sqrt(np.sum((end - q) ** 2))
    length, count = _LONGEST, 0
    while count < steps.shape[0]:
        arrives = away <= length
        share = 1.0 if arrives else length / away
        for j in range(n):
            trial[j] = q[j] + share * (end[j] - q[j])
        good = True
        if not arrives:
            good = make_feasible(None, goal, trial, _PROJECTIONS, work, scratch, dq) <= HELD
        left = np.sqrt(np.sum((end - trial) ** 2))
        moved = np.sqrt(np.sum((trial - q) ** 2))
        # A projection that leads back or far aside is no step towards the end.
        if good and not arrives:
            good = left < away - 0.1 * length and moved < 2.0 * length
        if good:
            for j in range(n):
                line[0, j, 0], line[0, j, 1] = q[j], trial[j] - q[j]
                dq[j] = trial[j] - q[j]
            verdict = hold_kernel(
                model.joint_types, model.offsets, rows, unit, line, gaps, TOLERANCE, EDGE_CELLS,
                worst, times, found,
            )  # fmt: skip
            good = verdict == HOLDS
            if good and certify_curve(model, q, dq, zero, zero, slack, found) != FREE:
                # A shorter step would end at the obstacle all the same.
                return count, False
        if not good:
            length = 0.5 * min(length, away)
            if length < _SHORTEST:
                return count, False
            continue
        steps[count] = trial
        count += 1
        if arrives:
            return count, True
        q[:] = trial
        away = left
        length = min(1.6 * length, _LONGEST)
    return count, False
