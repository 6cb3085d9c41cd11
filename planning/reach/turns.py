"""Outcome of a pose whose deviations turn the last joint alone: all of them at once."""

from enum import IntEnum

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from kinematics.ik.closed_form.branches import branches_kernel
from kinematics.ik.closed_form.refine import CODE, GROUP, INSIDE, MORE, near_kernel
from kinematics.ik.closed_form.structure import Arm
from obstacles.collision.edge_check import FREE
from obstacles.collision.model.kernel_work import workspace
from obstacles.collision.model.model_arrays import ModelArrays
from obstacles.collision.proximity import closest_of
from obstacles.collision.state_check import verdict_in
from planning.reach.assessment import (
    GAIN,
    IN_COLLISION,
    NO_BETTER,
    OUTSIDE_LIMITS,
    REACHED,
    Branch,
    Column,
    Measure,
    Parts,
    ReachSettings,
    ReachWork,
    assess,
    judge,
    keep,
    limit_distance_kernel,
    manipulability,
    ones,
)


class Tally(IntEnum):
    """Column of the tallies of deviations that turn the last joint."""

    FREE = 0
    SEEN = 1
    OPEN = 2
    CODES = 3


@kernel(allocates=False)
def assess_turns(  # noqa: C901, PLR0912, PLR0915
    arm: Arm, parts: Parts, work: ReachWork, table: Array, seed: Array, settings: ReachSettings,
    result: Array, joints: Array,
) -> None:  # fmt: skip
    """``assess`` for all deviations at once where they turn the last joint alone.

    What does not move with it is checked once a branch, and so is the manipulability. The first
    deviation is checked in all branches, since mostly no other one has more of them.

    Args:
        arm: The chain up to the link and its closed form.
        parts: The packed robot and scene.
        work: Memory.
        table: A row for each branch of the first deviation, shape (r, n + MORE).
        seed: Configuration that whole turns are to be near, shape (n,).
        settings: How to judge.
        result: Result of the pose, brought up to date, shape (COLUMNS,).
        joints: The best configuration, likewise, shape (n,).
    """
    last, best, q, tallies = seed.shape[0] - 1, -np.inf, work.q, work.tallies
    tallies[:], work.struck[0] = 0, 0
    for row in range(table.shape[0]):
        work.looked[row, :] = Branch.OUT
        if not _take_row(arm, table, row, q):
            continue
        bit = 1 << int(table[row, last + 1 + CODE])
        around, high, value, pair = -1, True, 0.0, -1
        for s in range(tallies.shape[0]):
            q[last], fits, _ = near_kernel(
                table[row, last] + parts.turns[s], arm.lower[last], arm.upper[last], seed[last]
            )
            if not fits:
                continue
            if around < 0:
                around = verdict_in(parts.before, work.collision, q, settings.margin, work.asked)
                result[Column.STATUS] = max(result[Column.STATUS], IN_COLLISION)
                if around == FREE:
                    high = _may_be_better(arm, parts, work, settings, best)
            if around != FREE:
                break
            again = settings.redundant and tallies[s, Tally.SEEN] & bit != 0
            counts = tallies[s, Tally.FREE] == 0 or (s == 0 and not again)
            wanted = high
            if settings.choice == Measure.LIMITS:
                value = limit_distance_kernel(arm, q)
                wanted = value > best
            verdict = NO_BETTER
            if wanted:
                # The places of all the others are those of the look before.
                verdict, value, pair = judge(
                    parts.behind, parts.whole, work, q, settings, value, best
                )
            if verdict == NO_BETTER and counts:
                wanted = False
                verdict = verdict_in(parts.behind, work.collision, q, settings.margin, work.asked)
            if verdict == NO_BETTER:
                work.looked[row, s] = Branch.LEFT
                tallies[s, Tally.OPEN] += 1
                tallies[s, Tally.CODES] |= bit
                continue
            if verdict != FREE:
                work.struck[0] |= bit
                continue
            _count(tallies[s], bit, again)
            if wanted:
                value, high = _value_and_rest(arm, parts, work, settings, value, pair)
                if value > best:
                    best = value
                    keep(arm, work, q, result, joints)
            if settings.choice == Measure.ORDER:
                break
        if settings.choice == Measure.ORDER and best > -np.inf:
            break
    if settings.choice != Measure.ORDER:
        _check_left_branches(arm, parts, work, table, seed, settings)
    for s in range(tallies.shape[0]):
        if tallies[s, Tally.FREE] > 0:
            result[Column.STATUS] = REACHED
            result[Column.SAMPLES] += 1
            result[Column.BRANCHES] = max(result[Column.BRANCHES], tallies[s, Tally.FREE])


@kernel(allocates=False)
def _value_and_rest(
    arm: Arm, parts: Parts, work: ReachWork, settings: ReachSettings, value: float, pair: int
) -> tuple[float, bool]:
    """The value of ``work.q``, which is free, and whether another turn of it may be better.

    Args:
        arm: The chain up to the link.
        parts: The packed robot and scene.
        work: Memory.
        settings: How to judge.
        value: Value of the configuration but for the manipulability.
        pair: Closest pair of the configuration.
    """
    if settings.choice == Measure.LIMITS:
        return value, True
    if settings.choice == Measure.CLEARANCE:
        return value, _moves_with(parts.whole, pair, work.q.shape[0] - 1)
    return manipulability(arm, work, work.q), False


@kernel(allocates=False)
def _check_left_branches(
    arm: Arm, parts: Parts, work: ReachWork, table: Array, seed: Array, settings: ReachSettings
) -> None:
    """Check what was left, at deviations that may have more free branches than any has yet."""
    last, q, tallies = seed.shape[0] - 1, work.q, work.tallies
    most = 0
    for s in range(tallies.shape[0]):
        most = max(most, tallies[s, Tally.FREE])
    # Those first that were not free at another deviation.
    for number in range(2 * table.shape[0]):
        row = number % table.shape[0]
        bit, placed = 1 << int(table[row, last + 1 + CODE]), False
        if number < table.shape[0] and work.struck[0] & bit == 0:
            continue
        for s in range(tallies.shape[0]):
            if work.looked[row, s] != Branch.LEFT:
                continue
            again = settings.redundant and tallies[s, Tally.SEEN] & bit != 0
            at_most = int(tallies[s, Tally.FREE] + tallies[s, Tally.OPEN])
            if settings.redundant:
                at_most = ones(tallies[s, Tally.SEEN] | tallies[s, Tally.CODES])
            if again or at_most <= most:
                continue
            if not placed:
                _take_row(arm, table, row, q)
            q[last], _, _ = near_kernel(
                table[row, last] + parts.turns[s], arm.lower[last], arm.upper[last], seed[last]
            )
            if not placed:
                verdict_in(parts.before, work.collision, q, settings.margin, work.asked)
                placed = True
            tallies[s, Tally.OPEN] -= 1
            work.looked[row, s] = Branch.OUT
            found = verdict_in(parts.behind, work.collision, q, settings.margin, work.asked)
            if found == FREE:
                _count(tallies[s], bit, again)
                most = max(most, tallies[s, Tally.FREE])


@kernel(allocates=False)
def _moves_with(model: ModelArrays, pair: int, joint: int) -> bool:
    """Whether the last joint moves one of a pair of the packed robot and scene."""
    scene = model.scene.shape[0]
    apart = pair - model.skipped.shape[0] * scene
    if pair < 0 or apart < 0:
        return bool(pair >= 0 and model.joints[pair // scene] == joint)
    i, j = model.self_pairs[apart, 0], model.self_pairs[apart, 1]
    return bool(model.joints[i] == joint or model.joints[j] == joint)


@kernel(allocates=False)
def _take_row(arm: Arm, table: Array, row: int, q: Array) -> bool:
    """Copy a row's joints to ``q`` (n,); whether all but the last are inside their limits."""
    inside = True
    for j in range(q.shape[0]):
        q[j] = table[row, j]
        if j < q.shape[0] - 1:
            inside = inside and arm.lower[j] <= q[j] <= arm.upper[j]
    return inside


@kernel(allocates=False)
def _count(tally: Indices, bit: int, again: bool) -> None:
    """Count a branch that is free at a deviation."""
    if not again:
        tally[Tally.FREE] += 1
        tally[Tally.SEEN] |= bit


@kernel(allocates=False)
def _may_be_better(
    arm: Arm, parts: Parts, work: ReachWork, settings: ReachSettings, best: float
) -> bool:
    """Whether a turn of the last joint from ``work.q``, otherwise free, may be better than all."""
    if settings.choice == Measure.CLEARANCE and best > settings.margin:
        found = verdict_in(parts.before, work.collision, work.q, best + GAIN, work.asked)
        return found == FREE
    if settings.choice == Measure.MANIPULABILITY and best > 0.0:
        # Share by which values of the manipulability differ by rounding at most.
        return manipulability(arm, work, work.q) > best * (1.0 - 1e-9)
    return True


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
    # Branches of a closed form for one value of its parameter at most.
    table = np.empty((16 * values.shape[0], n + MORE))
    work = _reach_memory(model, n, table.shape[0], parts.turns.shape[0])
    for k in range(targets.shape[0]):
        best = -np.inf
        for s in range(targets.shape[1]):
            # More branches than there are.
            count = branches_kernel(
                arm, targets[k, s], seed, values, settings.tolerance, 2**31, table
            )
            if count > 0:
                results[k, Column.STATUS] = max(results[k, Column.STATUS], OUTSIDE_LIMITS)
            rows = table[: max(count, 0)]
            if s == 0 and parts.turns.shape[0] > 0 and _all_alone(rows, n):
                assess_turns(arm, parts, work, rows, seed, settings, results[k], joints[k])
                break
            best = assess(arm, model, work, rows, settings, best, results[k], joints[k])
            if settings.choice == Measure.ORDER and results[k, Column.STATUS] == REACHED:
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
    work = _reach_memory(model, n, 1, 0)
    for k in range(rows.shape[0]):
        best = -np.inf
        for s in range(rows.shape[1]):
            if rows[k, s, n + INSIDE] == 1.0:
                best = assess(
                    arm, model, work, rows[k, s : s + 1], settings, best, results[k], joints[k]
                )
                if settings.choice == Measure.ORDER and results[k, Column.STATUS] == REACHED:
                    break
        _measure_clearance(model, work, settings, results[k], joints[k])


@kernel
def _reach_memory(model: ModelArrays, n: int, rows: int, turns: int) -> ReachWork:
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
    if settings.clearance and result[Column.STATUS] == REACHED:
        result[Column.CLEARANCE], _ = closest_of(model, work.collision, joints)
