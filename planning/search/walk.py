"""Walks along the set of configurations that constraints allow, each step of them proved.

A step towards a target is projected onto the set (Newton's method on the residuals, inside the
joint limits) and taken where the straight motion to it holds the constraints for every instant and
is proved free; steps shrink where the set is curved.
"""

from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array
from obstacles.collision.edge_check import FREE, certify_curve
from obstacles.collision.model.model_arrays import ModelArrays
from planning.constraints.edge_bounds import EDGE_CELLS, EdgeVerdict, edge_kernel
from planning.constraints.solvers.active_set import FEASIBLE, make_feasible
from planning.constraints.solvers.active_set_program import Goal, make_work


class AllowedSet(NamedTuple):
    """The set of configurations that constraints allow.

    Args:
        goal: Goal of Newton's method, somewhat inside the set.
        rows: Packed rows that edges hold, shape (m, WIDTH).
    """

    goal: Goal
    rows: Array


@kernel
def walk_kernel(
    model: ModelArrays, slack: float, along: AllowedSet, start: Array, end: Array, steps: Array
) -> tuple[int, bool]:
    """Walk from ``start`` towards ``end``, both (n,), as far as is proved.

    Args:
        model: The packed robot and scene.
        slack: Distance to keep beyond the margins [m].
        along: The set.
        start: A configuration of the set, shape (n,).
        end: The target, shape (n,).
        steps: Filled with the configurations after each step, shape (k, n).

    Returns:
        How many rows of ``steps`` are steps, and whether the last one is the target.
    """
    n = start.shape[0]
    work = make_work(None, along.goal)
    trial, dq, scratch = np.empty(n), np.empty(n), np.empty(n)
    q, zero = start.copy(), np.zeros(n)
    line, found = np.empty((n, 2)), np.empty(4)
    away = np.sqrt(np.sum((end - q) ** 2))
    # Longest step of a tree, Euclidean in joint space [rad or m].
    longest = 0.5
    length, count = longest, 0
    while count < steps.shape[0]:
        arrives = away <= length
        share = 1.0 if arrives else length / away
        for j in range(n):
            trial[j] = q[j] + share * (end[j] - q[j])
        good = True
        if not arrives:
            # Twelve iterations of Newton's method project a step or never will.
            good = make_feasible(None, along.goal, trial, 12, work, scratch, dq) <= FEASIBLE
        left = np.sqrt(np.sum((end - trial) ** 2))
        moved = np.sqrt(np.sum((trial - q) ** 2))
        # A step comes nearer to the end by a tenth of its length, and is not twice as long as was
        # asked for: else the projection leads back or far aside.
        if good and not arrives:
            good = left < away - 0.1 * length and moved < 2.0 * length
        if good:
            for j in range(n):
                line[j, 0], line[j, 1] = q[j], trial[j] - q[j]
                dq[j] = trial[j] - q[j]
            verdict, _ = edge_kernel(model.chain, along.rows, line, EDGE_CELLS)
            good = verdict == EdgeVerdict.HOLDS
            if good and certify_curve(model, q, dq, zero, zero, slack, found) != FREE:
                # A shorter step would end at the obstacle all the same.
                return count, False
        if not good:
            length = 0.5 * min(length, away)
            # So short a step ends the extension [rad or m].
            if length < 0.01:
                return count, False
            continue
        steps[count] = trial
        count += 1
        if arrives:
            return count, True
        q[:] = trial
        away = left
        # A step that was taken may be longer next time.
        length = min(1.6 * length, longest)
    return count, False
