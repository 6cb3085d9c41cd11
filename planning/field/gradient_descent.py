"""Steps down a potential, each of them proved free before it is taken, in one kernel."""

import math
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from obstacles.collision.edge_check import FREE, Cubic, certify_in
from obstacles.collision.model.kernel_work import Workspace, workspace
from obstacles.collision.model.model_arrays import ModelArrays
from obstacles.collision.state_check import blocked_at, verdict_in
from planning.constraints.edge_bounds import EDGE_CELLS, EdgeVerdict, edge_kernel
from planning.field.field_kernels import (
    FieldModel,
    evaluate_kernel,
    value_kernel,
    vanishing_force_kernel,
)


class Outcome(IntEnum):
    """Outcome of a descent."""

    #: It is at the goal.
    ARRIVED = 0
    #: No step along the force is proved.
    BLOCKED = 1
    #: Its steps were used up.
    GOING = 2
    #: The force vanishes, but for joints at their limits: a local minimum, or a saddle.
    MINIMUM = 3
    #: As many steps as it has patience for did not lower the potential.
    STALLED = 4
    #: Every proved step along the force leads higher: a kink of the potential.
    KINK = 5


#: An adaptive step that was taken whole may be longer next time by this factor.
GROWTH = 1.5
#: An adaptive step is not halved below this: it could not lower the potential by its rounding
#: [rad or m].
SHORTEST = 1e-12
#: Length of a move that ``_move`` did not find, because every proved one leads higher.
UPHILL = -1.0


class Gauge(IntEnum):
    """Entry of ``Track.gauges``."""

    #: The next adaptive step [rad or m].
    STEP = 0
    #: The lowest potential so far [J].
    LOWEST = 1
    #: Share of the straight line to the goal that is left where it was last blocked, or -1.
    LINE_BLOCKED = 2
    #: The joint force that counts as none at the last configuration, -1 where it is to be computed
    #: [N m or N].
    NO_FORCE = 3


class Count(IntEnum):
    """Entry of ``Track.counts``."""

    #: Configurations that were visited.
    VISITED = 0
    #: Steps that were taken.
    ITERATIONS = 1
    #: Steps in a row without progress.
    STALE = 2


class Proof(NamedTuple):
    """The conditions that every step is proved to hold.

    Args:
        model: The packed robot and scene.
        slack: Distance to keep beyond the margins [m].
        rows: Rows of the constraints, shape (r, WIDTH); r = 0 where there are none.
    """

    model: ModelArrays
    slack: float
    rows: Array


class Rules(NamedTuple):
    """Parameters of the descent; ``FieldOptions`` says what each of these means.

    Args:
        lower: Lower joint limits, shape (n,) [rad or m].
        upper: Upper joint limits, shape (n,) [rad or m].
        sizes: alpha_k, shape (k,); the last one is kept; k = 0 where they are adaptive.
        longest: Longest step of a joint [rad or m].
        halvings: Halvings of a step that can't be taken.
        tolerance: Distance from the goal that counts as arrived [rad or m].
        connect: Whether a proved straight motion to the goal counts too.
        patience: Steps in a row without progress after which it gives up.
        progress: Share of the lowest potential by which a step has to lower it to be progress.
        force_tolerance: Share of its terms below which the joint force vanishes.
    """

    lower: Array
    upper: Array
    sizes: Array
    longest: float
    halvings: int
    tolerance: float
    connect: bool
    patience: int
    progress: float
    force_tolerance: float


class Track(NamedTuple):
    """The configurations of a descent, with a capacity of c.

    Args:
        visited: Configurations, shape (c, n) [rad or m].
        potentials: U at each, shape (c,) [J].
        force: -grad U at the last one, shape (n,) [N m or N].
        gauges: STEP, LOWEST, LINE_BLOCKED and NO_FORCE, shape (4,).
        counts: VISITED, ITERATIONS and STALE, shape (3,).
    """

    visited: Array
    potentials: Array
    force: Array
    gauges: Array
    counts: Indices


@kernel
def descend_kernel(
    proof: Proof,
    rules: Rules,
    field: FieldModel,
    track: Track,
    until: int,
    across: Array,
    walk: int,
) -> int:
    """Descend until ``until`` steps were taken; the outcome.

    Args:
        proof: Conditions of every step.
        rules: Parameters of the descent.
        field: The potential.
        track: The configurations so far; new ones are appended.
        until: Steps, those of earlier calls counted.
        across: Direction of a random walk to begin with, shape (n,), its largest entry 1.
        walk: Longest steps of that walk, which ends before one that is not proved.
    """
    work, counts, gauges = workspace(proof.model), track.counts, track.gauges
    if walk > 0:
        gauges[Gauge.STEP], gauges[Gauge.LOWEST], counts[Count.STALE] = rules.longest, np.inf, 0
    for _ in range(walk):
        if _move(proof, work, rules, field, track, across, rules.longest, np.inf) == 0.0:
            break
    while True:
        if _reaches_goal(proof, work, rules, field, track):
            return Outcome.ARRIVED
        if counts[Count.ITERATIONS] >= until:
            return Outcome.GOING
        potential = track.potentials[counts[Count.VISITED] - 1]
        is_progress = potential < (1.0 - rules.progress) * gauges[Gauge.LOWEST]
        counts[Count.STALE] = 0 if is_progress else counts[Count.STALE] + 1
        gauges[Gauge.LOWEST] = min(gauges[Gauge.LOWEST], potential)
        outcome = _descend(proof, work, rules, field, track)
        if outcome != Outcome.GOING:
            return outcome


@kernel
def keep_kernel(track: Track, q: Array, potential: float, force: Array) -> None:
    """Append a configuration q (n,) with its potential and its force (n,)."""
    at = track.counts[Count.VISITED]
    track.visited[at] = q
    track.potentials[at] = potential
    track.force[:] = force
    track.gauges[Gauge.NO_FORCE] = -1.0
    track.counts[Count.VISITED] = at + 1


@kernel
def is_free_kernel(proof: Proof, work: Workspace, a: Array, b: Array, outcome: Array) -> bool:
    """Whether the straight motion from a to b, both (n,), is proved.

    Where it is not, ``outcome[0]`` is the place that could not be proved, from 0 to 1.
    """
    n, r = a.shape[0], proof.rows.shape[0]
    zero = np.zeros(n)
    if r > 0:
        ends = np.empty((n, 2))
        for j in range(n):
            ends[j, 0], ends[j, 1] = a[j], b[j] - a[j]
        holds, outcome[0] = edge_kernel(proof.model.chain, proof.rows, ends, EDGE_CELLS)
        if holds != EdgeVerdict.HOLDS:
            return False
    line = Cubic(a, b - a, zero, zero)
    # A step whose proof needs more than 800 intervals grazes something all along.
    verdict = certify_in(proof.model, work, line, proof.slack, 800, outcome)
    return bool(verdict == FREE)


@kernel
def _is_free_state(proof: Proof, work: Workspace, q: Array) -> bool:
    """``is_free_kernel`` of the motion that stays in q (n,)."""
    if proof.rows.shape[0] > 0:
        return is_free_kernel(proof, work, q, q, np.empty(4))
    asked = np.empty(1, dtype=np.int64)
    return bool(verdict_in(proof.model, work, q, proof.slack, asked) == FREE)


@kernel
def _reaches_goal(
    proof: Proof, work: Workspace, rules: Rules, field: FieldModel, track: Track
) -> bool:
    q, goal = track.visited[track.counts[Count.VISITED] - 1].copy(), field.goal.copy()
    away = 0.0
    for j in range(q.shape[0]):
        away += (goal[j] - q[j]) ** 2
    if not (rules.connect or math.sqrt(away) < rules.tolerance):
        return False
    share = track.gauges[Gauge.LINE_BLOCKED]
    if share >= 0.0:
        # Where the line was blocked a step before, it mostly still is: one state tells it.
        blocked = goal + share * (q - goal)
        if not _is_free_state(proof, work, blocked):
            return False
    asked = np.empty(1, dtype=np.int64)
    # The straight line to the goal is checked at the ends of its eighths before it is proved.
    blocked_share = blocked_at(proof.model, work, q, goal, proof.slack, 2, 8, asked)
    if blocked_share >= 0.0:
        track.gauges[Gauge.LINE_BLOCKED] = 1.0 - blocked_share
        return False
    outcome = np.array([1.0, 0.0, 0.0, 0.0])
    if not is_free_kernel(proof, work, q, goal, outcome):
        track.gauges[Gauge.LINE_BLOCKED] = 1.0 - outcome[0]
        return False
    if track.counts[Count.VISITED] == 1 or away > 0.0:
        force = np.empty(q.shape[0])
        keep_kernel(track, goal, value_kernel(field, goal, force), force)
    return True


@kernel
def free_force_kernel(force: Array, q: Array, rules: Rules) -> Array:
    """The joint force (n,) without what pushes joints of q (n,) beyond limits they stand at."""
    free = force.copy()
    for j in range(q.shape[0]):
        held = (q[j] <= rules.lower[j] and force[j] < 0.0) or (
            q[j] >= rules.upper[j] and force[j] > 0.0
        )
        if held:
            free[j] = 0.0
    return free


@kernel
def _descend(proof: Proof, work: Workspace, rules: Rules, field: FieldModel, track: Track) -> int:
    """Take one step along the force: GOING, or why there is none."""
    gauges, counts = track.gauges, track.counts
    q = track.visited[counts[Count.VISITED] - 1]
    force = free_force_kernel(track.force, q, rules)
    strength = 0.0
    for j in range(force.shape[0]):
        strength = max(strength, abs(force[j]))
    if gauges[Gauge.NO_FORCE] < 0.0:
        gauges[Gauge.NO_FORCE] = vanishing_force_kernel(field, q, rules.force_tolerance)
    if strength <= gauges[Gauge.NO_FORCE]:
        return Outcome.MINIMUM
    if counts[Count.STALE] >= rules.patience:
        return Outcome.STALLED
    direction, adaptive = force / strength, rules.sizes.shape[0] == 0
    if not adaptive:
        size = rules.sizes[min(counts[Count.ITERATIONS], rules.sizes.shape[0] - 1)]
        reach = min(size * strength, rules.longest)
        taken = _move(proof, work, rules, field, track, direction, reach, np.inf)
        return Outcome.GOING if taken > 0.0 else Outcome.BLOCKED
    reach, highest = gauges[Gauge.STEP], track.potentials[counts[Count.VISITED] - 1]
    taken = _move(proof, work, rules, field, track, direction, reach, highest)
    gauges[Gauge.STEP] = min(GROWTH * (taken if taken > 0.0 else reach), rules.longest)
    if taken == UPHILL:
        return Outcome.KINK
    return Outcome.GOING if taken > 0.0 else Outcome.BLOCKED


@kernel
def _move(
    proof: Proof,
    work: Workspace,
    rules: Rules,
    field: FieldModel,
    track: Track,
    direction: Array,
    reach: float,
    highest: float,
) -> float:
    """Move by ``reach`` at most, halved until that is proved and lower than ``highest``.

    Returns:
        Length of the move of the joint that moves most [rad or m]; 0 where none is proved after all
        halvings, UPHILL where all that are proved lead higher.
    """
    q = track.visited[track.counts[Count.VISITED] - 1].copy()
    moved, force, outcome = np.empty(q.shape[0]), np.empty(q.shape[0]), np.empty(4)
    unproved, missed = 0, 0.0
    while unproved <= rules.halvings:
        away = 0.0
        for j in range(q.shape[0]):
            moved[j] = min(max(q[j] + reach * direction[j], rules.lower[j]), rules.upper[j])
            away = max(away, abs(moved[j] - q[j]))
        if away > 0.0 and is_free_kernel(proof, work, q, moved, outcome):
            potential, no_force = evaluate_kernel(field, moved, rules.force_tolerance, force)
            if potential < highest:
                keep_kernel(track, moved, potential, force)
                track.gauges[Gauge.NO_FORCE] = no_force
                track.counts[Count.ITERATIONS] += 1
                return reach
            if reach < SHORTEST:
                return UPHILL
            missed = UPHILL
        else:
            unproved += 1
        reach /= 2.0
    return missed
