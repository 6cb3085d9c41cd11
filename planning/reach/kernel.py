"""Reach of one pose after another: every branch of the closed form, checked and measured."""

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array
from kinematics.ik.closed_form.branches import branches_kernel
from kinematics.ik.closed_form.refine import GROUP, INSIDE, MORE
from kinematics.ik.closed_form.structure import Arm
from obstacles.collision.model.kernel_work import workspace
from obstacles.collision.model.model_arrays import ModelArrays
from obstacles.collision.proximity import closest_of
from planning.reach.assessment import (
    BY_ORDER,
    CLEARANCE,
    OUTSIDE_LIMITS,
    REACHED,
    STATUS,
    Parts,
    ReachSettings,
    ReachWork,
    assess,
)
from planning.reach.turns import assess_turns

#: Branches of a closed form for one value of its parameter at most.
_ROWS = 16
#: More branches than there are.
_ALL = 2**31


@kernel
def closed_form_reach_kernel(
    arm: Arm, parts: Parts, targets: Array, seed: Array, values: Array,
    settings: ReachSettings, results: Array, joints: Array,
) -> None:  # fmt: skip
    """Status, branches and best configuration of each pose, by the closed form.

    Args:
        arm: The chain up to the link and its closed form.
        parts: The packed robot and scene.
        targets: T_base_link of each deviation of each pose, shape (m, s, 4, 4).
        seed: Configuration that whole turns are to be near, shape (n,).
        values: Values of a redundant arm's parameter, shape (v,).
        settings: How to judge.
        results: A row for each pose, written, shape (m, COLUMNS).
        joints: The best configuration of each pose, written where it is reached, shape (m, n).
    """
    n, model = seed.shape[0], parts.whole
    table = np.empty((_ROWS * values.shape[0], n + MORE))
    work = _room(model, n, table.shape[0], parts.turns.shape[0])
    for k in range(targets.shape[0]):
        best = -np.inf
        for s in range(targets.shape[1]):
            count = branches_kernel(
                arm, targets[k, s], seed, values, settings.tolerance, _ALL, table
            )
            if count > 0:
                results[k, STATUS] = max(results[k, STATUS], OUTSIDE_LIMITS)
            rows = table[: max(count, 0)]
            if s == 0 and parts.turns.shape[0] > 0 and _all_alone(rows, n):
                assess_turns(arm, parts, work, rows, seed, settings, results[k], joints[k])
                break
            best = assess(arm, model, work, rows, settings, best, results[k], joints[k])
            if settings.choice == BY_ORDER and results[k, STATUS] == REACHED:
                break
        _measure_clearance(model, work, settings, results[k], joints[k])


@kernel
def searched_reach_kernel(
    arm: Arm, model: ModelArrays, rows: Array, settings: ReachSettings, results: Array,
    joints: Array,
) -> None:  # fmt: skip
    """Status and best configuration of each pose of those that a search found.

    Args:
        arm: The chain up to the link; its closed form is not used.
        model: The packed robot and scene.
        rows: Configurations found for each pose as a table of branches has them, shape
            (m, s, n + MORE).
        settings: How to judge.
        results: A row for each pose, written, shape (m, COLUMNS).
        joints: The best configuration of each pose, written where it is reached, shape (m, n).
    """
    n = joints.shape[1]
    work = _room(model, n, 1, 0)
    for k in range(rows.shape[0]):
        best = -np.inf
        for s in range(rows.shape[1]):
            if rows[k, s, n + INSIDE] == 1.0:
                best = assess(
                    arm, model, work, rows[k, s : s + 1], settings, best, results[k], joints[k]
                )
                if settings.choice == BY_ORDER and results[k, STATUS] == REACHED:
                    break
        _measure_clearance(model, work, settings, results[k], joints[k])


@kernel
def _room(model: ModelArrays, n: int, rows: int, turns: int) -> ReachWork:
    """Memory for n joints, so many branches and deviations that turn the last joint."""
    collision = workspace(model)
    collision.joints[:] = 0.0
    return ReachWork(
        collision,
        np.empty(1, dtype=np.int64),
        np.empty((6, n)),
        np.empty(n),
        np.empty((turns, 4), dtype=np.int64),
        np.empty((rows, max(turns, 1)), dtype=np.int64),
        np.zeros(1, dtype=np.int64),
    )


@kernel
def _all_alone(table: Array, n: int) -> bool:
    """Whether no branch stands for a family, so that all of them are in the table."""
    return not np.any(table[:, n + GROUP] != 0.0)


@kernel
def _measure_clearance(
    model: ModelArrays, work: ReachWork, settings: ReachSettings, result: Array, joints: Array
) -> None:
    """Write the clearance of the best configuration of a pose that is reached."""
    if settings.clearance and result[STATUS] == REACHED:
        result[CLEARANCE], _ = closest_of(model, work.collision, joints)
