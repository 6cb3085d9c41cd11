"""Steps down a potential, each of them proved free before it is taken, in one kernel."""

import math
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array, Indices
from kinematics.compiled.kernel import kernel
from obstacles.edge_check import FREE, certify_in
from obstacles.kernel_work import Workspace, workspace
from obstacles.model_arrays import ModelArrays
from planning.constraints.edge_bounds import EDGE_CELLS, HOLDS, TOLERANCE, hold_kernel
from planning.field.potential import FieldModel, value_kernel

ARRIVED, STUCK, GOING = 0, 1, 2
#: A step that needs more intervals for its proof grazes something all along: it is not taken.
_MOST_INTERVALS = 800
#: Share of the potential that has to be gained to count as progress.
PROGRESS = 0.01
#: A joint force below this part of the strongest so far is none.
NO_FORCE = 1e-9
#: An adaptive step that was taken whole may be longer next time by this factor.
GROWTH = 1.5

# Places in Track.gauges, and in Track.counts.
STEP, STRONGEST, LOWEST, BLOCKED = 0, 1, 2, 3
VISITED, ITERATIONS, STALE, FLAT = 0, 1, 2, 3


class Proof(NamedTuple):
    """What a step has to be proved against.

    Args:
        model: The packed robot and scene.
        slack: Distance to keep beyond the margins [m].
        rows: Of constraints that are to be held, shape (r, WIDTH); none where r = 0.
    """

    model: ModelArrays
    slack: float
    rows: Array


class Rules(NamedTuple):
    """How steps are taken; ``FieldOptions`` says what each of these means.

    Args:
        lower: Of the joints, shape (n,).
        upper: Likewise.
        sizes: alpha_k, the last one is kept; none where they are adaptive.
        longest: Step of a joint [rad or m].
        halvings: Of a step that can't be taken.
        tolerance: Distance from the goal that counts as arrived.
        connect: Whether a proved straight motion to the goal counts too.
        patience: Steps without progress that make a local minimum.
    """

    lower: Array
    upper: Array
    sizes: Array
    longest: float
    halvings: int
    tolerance: float
    connect: bool
    patience: int


class Track(NamedTuple):
    """Where a descent has been, with room for c configurations.

    Args:
        visited: Shape (c, n).
        potentials: U at each, shape (c,) [J].
        force: -grad U at the last one, shape (n,).
        gauges: The next adaptive step, the strongest force and the lowest potential so far, and
            what share of the straight way to the goal is left where it was last blocked, or -1.
        counts: Configurations visited, steps taken, steps without progress, and 1 where there is
            no force.
    """

    visited: Array
    potentials: Array
    force: Array
    gauges: Array
    counts: Indices


@kernel
def descend_kernel(
    proof: Proof, rules: Rules, field: FieldModel, track: Track, until: int, across: Array,
    walk: int,
) -> int:  # fmt: skip
    """Go on until ``until`` steps were taken: ARRIVED, STUCK or GOING.

    Args:
        proof: What every step is proved against.
        rules: How they are taken.
        field: What leads them.
        track: Where it has been; written to.
        until: Steps, those of earlier calls counted.
        across: Direction of a walk to begin with, shape (n,), its largest entry 1.
        walk: Longest steps of that walk, which ends before one that is not proved.
    """
    work, counts, gauges = workspace(proof.model), track.counts, track.gauges
    if walk > 0:
        gauges[STEP], gauges[LOWEST], counts[STALE] = rules.longest, np.inf, 0
    for _ in range(walk):
        if _move(proof, work, rules, field, track, across, rules.longest, np.inf) == 0.0:
            break
    while True:
        if _arrived(proof, work, rules, field, track):
            return ARRIVED
        if counts[ITERATIONS] >= until:
            return GOING
        potential = track.potentials[counts[VISITED] - 1]
        counts[STALE] = 0 if potential < (1.0 - PROGRESS) * gauges[LOWEST] else counts[STALE] + 1
        gauges[LOWEST] = min(gauges[LOWEST], potential)
        if counts[STALE] >= rules.patience or not _descend(proof, work, rules, field, track):
            return STUCK


@kernel
def keep_kernel(track: Track, q: Array, potential: float, force: Array) -> None:
    """Note that it is now at q (n,)."""
    at = track.counts[VISITED]
    track.visited[at] = q
    track.potentials[at] = potential
    track.force[:] = force
    track.counts[VISITED] = at + 1


@kernel
def is_free_kernel(proof: Proof, work: Workspace, a: Array, b: Array, found: Array) -> bool:
    """Whether the straight motion from a to b, both (n,), is proved; where not, in ``found[0]``."""
    n, r = a.shape[0], proof.rows.shape[0]
    zero = np.zeros(n)
    if r > 0:
        line, unit = np.empty((1, n, 2)), np.array([0.0, 1.0])
        for j in range(n):
            line[0, j, 0], line[0, j, 1] = a[j], b[j] - a[j]
        held = hold_kernel(
            proof.model.joint_types, proof.model.offsets, proof.rows, unit, line,
            np.full(r, np.inf), TOLERANCE, EDGE_CELLS, np.empty(r), np.empty(r), found,
        )  # fmt: skip
        if held != HOLDS:
            return False
    verdict = certify_in(
        proof.model, work, a, b - a, zero, zero, proof.slack, _MOST_INTERVALS, found
    )
    return bool(verdict == FREE)


@kernel
def _arrived(proof: Proof, work: Workspace, rules: Rules, field: FieldModel, track: Track) -> bool:
    q, goal = track.visited[track.counts[VISITED] - 1].copy(), field.goal.copy()
    away = 0.0
    for j in range(q.shape[0]):
        away += (goal[j] - q[j]) ** 2
    if not (rules.connect or math.sqrt(away) < rules.tolerance):
        return False
    share = track.gauges[BLOCKED]
    if share >= 0.0:
        # Where it was blocked from the step before it mostly still is: one state instead of a way.
        there, found = goal + share * (q - goal), np.empty(4)
        if not is_free_kernel(proof, work, there, there, found):
            return False
    found = np.array([1.0, 0.0, 0.0, 0.0])
    if not is_free_kernel(proof, work, q, goal, found):
        track.gauges[BLOCKED] = 1.0 - found[0]
        return False
    if track.counts[VISITED] == 1 or away > 0.0:
        force = np.empty(q.shape[0])
        keep_kernel(track, goal, value_kernel(field, goal, force), force)
    return True


@kernel
def _descend(proof: Proof, work: Workspace, rules: Rules, field: FieldModel, track: Track) -> bool:
    """Take one step along the force; False where there is none, or none that is proved."""
    force, gauges, counts = track.force, track.gauges, track.counts
    strength = 0.0
    for j in range(force.shape[0]):
        strength = max(strength, abs(force[j]))
    gauges[STRONGEST] = max(gauges[STRONGEST], strength)
    if strength <= NO_FORCE * gauges[STRONGEST]:
        counts[FLAT] = 1
        return False
    direction, adaptive = force / strength, rules.sizes.shape[0] == 0
    if not adaptive:
        size = rules.sizes[min(counts[ITERATIONS], rules.sizes.shape[0] - 1)]
        reach = min(size * strength, rules.longest)
        return _move(proof, work, rules, field, track, direction, reach, np.inf) > 0.0
    reach, highest = gauges[STEP], track.potentials[counts[VISITED] - 1]
    taken = _move(proof, work, rules, field, track, direction, reach, highest)
    gauges[STEP] = min(GROWTH * (taken if taken > 0.0 else reach), rules.longest)
    return taken > 0.0


@kernel
def _move(
    proof: Proof, work: Workspace, rules: Rules, field: FieldModel, track: Track,
    direction: Array, reach: float, highest: float,
) -> float:  # fmt: skip
    """Move by ``reach`` at most, halved until that is proved and lower than ``highest``.

    Returns:
        How far it moved, 0 for not at all.
    """
    q = track.visited[track.counts[VISITED] - 1].copy()
    moved, force, found = np.empty(q.shape[0]), np.empty(q.shape[0]), np.empty(4)
    for _ in range(rules.halvings + 1):
        away = 0.0
        for j in range(q.shape[0]):
            moved[j] = min(max(q[j] + reach * direction[j], rules.lower[j]), rules.upper[j])
            away = max(away, abs(moved[j] - q[j]))
        if away > 0.0 and is_free_kernel(proof, work, q, moved, found):
            potential = value_kernel(field, moved, force)
            if potential < highest:
                keep_kernel(track, moved, potential, force)
                track.counts[ITERATIONS] += 1
                return reach
        reach /= 2.0
    return 0.0
