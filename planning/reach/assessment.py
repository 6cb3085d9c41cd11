"""Outcome of a pose: its configurations checked as far as they can change the answer.

Asked are how many branches are free at the deviation that has most of them, at how many deviations
one is, and the best configuration. Beyond the first free branch of a deviation a check of a
configuration is of use only where the deviation may still have more of them than all before, or
where the configuration would be the best one: manipulability and distance from the limits are
cheaper to tell than a collision, and whether a clearance is larger than the best so far is a look
at collisions with that margin. One that is less than a micrometre larger is as good as the best.
"""

import math
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from compiled.simd import on_stack
from kinematics.arrays import Array, Indices
from kinematics.ik.closed_form.refine import CODE, INSIDE, MORE
from kinematics.ik.closed_form.structure import Arm
from kinematics.jacobian import frame_and_jacobian_kernel
from obstacles.collision.edge_check import FREE
from obstacles.collision.model.kernel_work import Workspace
from obstacles.collision.model.model_arrays import ModelArrays
from obstacles.collision.proximity import closest_of
from obstacles.collision.state_check import verdict_in


class Column(IntEnum):
    """Column of a row of results."""

    #: What became of the pose, see `Status`.
    STATUS = 0
    #: Branches that are free of collision at the deviation that has most of them.
    BRANCHES = 1
    #: Deviations at which the pose is reached.
    SAMPLES = 2
    #: Of the best configuration: product of the Jacobian's singular values.
    MANIPULABILITY = 3
    #: Distance of its closest pair, margins taken off [m].
    CLEARANCE = 4
    #: Of its joint that is nearest to a limit: the share of half its range that is left.
    LIMIT_DISTANCE = 5


#: Number of these columns.
COLUMNS = len(Column)

# What became of a pose; the later ones came nearer.
OUT_OF_REACH = 0
OUTSIDE_LIMITS = 1
IN_COLLISION = 2
REACHED = 3


class Measure(IntEnum):
    """Measure of the best configuration of a pose."""

    MANIPULABILITY = 0
    CLEARANCE = 1
    LIMITS = 2
    #: The first one that is found free: no other is searched for.
    ORDER = 3


#: A clearance that is larger by less than this is as good as the best [m].
GAIN = 1e-6
#: Beside verdicts: not checked, since it is no better than the best.
NO_BETTER = -1


class Branch(IntEnum):
    """Knowledge of a branch at a deviation: none, not checked yet, not free, free."""

    OUT = 0
    LEFT = 1
    STRUCK = 2
    TAKEN = 3


class ReachSettings(NamedTuple):
    """Settings of the reach kernels.

    Args:
        tolerance: Largest error of a solution [m], [rad].
        margin: Distance to be kept from everything beyond the pairs' own margins [m].
        choice: Measure of the best configuration.
        clearance: Whether the clearance of the best configuration is measured.
        redundant: Whether the closed form has a parameter, so that branches come in families.
    """

    tolerance: float
    margin: float
    choice: int
    clearance: bool
    redundant: bool


class ReachWork(NamedTuple):
    """Memory for the kernels.

    Args:
        collision: Settings of the collision checks.
        asked: Settings that were asked for, shape (1,).
        J: Room for a Jacobian, shape (6, n).
        q: Room for a configuration, shape (n,).
        tallies: Counts of each deviation that turns the last joint: how many branches are free,
            which as bits, how many more may be, and which of both as bits; shape (s, 4).
        looked: Record of each branch at each of them, shape (r, s).
        struck: Branches that were not free when checked last, as bits, shape (1,).
    """

    collision: Workspace
    asked: Indices
    J: Array
    q: Array
    tallies: Indices
    looked: Indices
    struck: Indices


class Parts(NamedTuple):
    """The robot in the scene, whole and in two parts, for deviations that turn the last joint.

    Args:
        whole: The packed robot and scene.
        before: Record of the same with all that does not move with the last joint alone.
        behind: Record of the same with what moves with the last joint alone.
        turns: Angles by which each deviation turns the last joint from where the first one has it,
            shape (s,) [rad]; (0,) where deviations do more than that.
    """

    whole: ModelArrays
    before: ModelArrays
    behind: ModelArrays
    turns: Array


@kernel(allocates=False)
def assess(
    arm: Arm, model: ModelArrays, work: ReachWork, table: Array, settings: ReachSettings,
    best: float, result: Array, joints: Array,
) -> float:  # fmt: skip
    """Check and measure the configurations of one deviation; the best value so far.

    Args:
        arm: The chain up to the link and its closed form.
        model: The packed robot and scene.
        work: Memory.
        table: A row for each branch, shape (r, n + MORE).
        settings: How to judge.
        best: The best value of the deviations before.
        result: Result of the pose, brought up to date, shape (COLUMNS,).
        joints: The best configuration, likewise, shape (n,).
    """
    n, looked = joints.shape[0], work.looked[:, 0]
    for row in range(table.shape[0]):
        looked[row] = Branch.LEFT if table[row, n + INSIDE] != 0.0 else Branch.OUT
        if looked[row] == Branch.OUT:
            continue
        q, value = table[row, :n], _cheap_value(arm, work, table[row, :n], settings)
        if value <= best:
            continue
        verdict, value, _ = judge(model, model, work, q, settings, value, best)
        if verdict == NO_BETTER:
            continue
        looked[row] = Branch.TAKEN if verdict == FREE else Branch.STRUCK
        if verdict == FREE and value > best:
            best = value
            keep(arm, work, q, result, joints)
            if settings.choice == Measure.ORDER:
                break
    free = 1
    if settings.choice != Measure.ORDER or best == -np.inf:
        free = _count_free(model, work, table, settings, result)
    if free > 0:
        result[Column.STATUS] = REACHED
        result[Column.SAMPLES] += 1
        result[Column.BRANCHES] = max(result[Column.BRANCHES], free)
    return best


@kernel(allocates=False)
def _count_free(
    model: ModelArrays, work: ReachWork, table: Array, settings: ReachSettings, result: Array
) -> int:
    """Number of free branches of a deviation, or less where it is no more than at another.

    Those that were struck at the deviation before are checked first.

    Args:
        model: The packed robot and scene.
        work: Memory, with what is known of each branch.
        table: A row for each branch, shape (r, n + MORE).
        settings: How to judge.
        result: Result of the pose, brought up to date, shape (COLUMNS,).
    """
    n, looked = table.shape[1] - MORE, work.looked[:, 0]
    free, left, seen, codes, struck = 0, 0, 0, 0, work.struck[0]
    work.struck[0] = 0
    for stage in range(3):
        for row in range(table.shape[0]):
            bit = 1 << int(table[row, n + CODE])
            if stage == 0:
                # What is known already.
                if looked[row] == Branch.LEFT:
                    left += 1
                    codes |= bit
                elif looked[row] == Branch.STRUCK:
                    work.struck[0] |= bit
                    result[Column.STATUS] = max(result[Column.STATUS], IN_COLLISION)
                elif looked[row] == Branch.TAKEN:
                    # The same branch at another value of the parameter is no other branch.
                    free += 0 if settings.redundant and seen & bit != 0 else 1
                    seen |= bit
                continue
            if looked[row] != Branch.LEFT or (stage == 1 and struck & bit == 0):
                continue
            most = ones(seen | codes) if settings.redundant else free + left
            if free > 0 and most <= result[Column.BRANCHES]:
                return free
            if settings.redundant and seen & bit != 0:
                continue
            left -= 1
            q = table[row, :n]
            if verdict_in(model, work.collision, q, settings.margin, work.asked) == FREE:
                looked[row] = Branch.TAKEN
                free += 1
                seen |= bit
            else:
                looked[row] = Branch.STRUCK
                work.struck[0] |= bit
                result[Column.STATUS] = max(result[Column.STATUS], IN_COLLISION)
    return free


@kernel(allocates=False)
def ones(bits: int) -> int:
    """Number of bits that are set."""
    count = 0
    while bits != 0:
        bits &= bits - 1
        count += 1
    return count


@kernel(allocates=False)
def judge(
    model: ModelArrays, whole: ModelArrays, work: ReachWork, q: Array, settings: ReachSettings,
    value: float, best: float,
) -> tuple[int, float, int]:  # fmt: skip
    """The verdict on a configuration, its value and closest pair, or ``NO_BETTER``.

    Args:
        model: Robot in its scene.
        whole: The packed robot and scene.
        work: Memory.
        q: Shape (n,).
        settings: How to judge.
        value: Value of the configuration, handed on where that is not the clearance.
        best: The best value so far.
    """
    if settings.choice == Measure.CLEARANCE and best > settings.margin:
        found = verdict_in(model, work.collision, q, best + GAIN, work.asked)
        if found != FREE:
            return NO_BETTER, value, -1
    found = verdict_in(model, work.collision, q, settings.margin, work.asked)
    pair = -1
    if settings.choice == Measure.CLEARANCE and found == FREE:
        value, pair = closest_of(whole, work.collision, q)
    return found, value, pair


@kernel(allocates=False)
def _cheap_value(arm: Arm, work: ReachWork, q: Array, settings: ReachSettings) -> float:
    """The value of a configuration, infinite where that is its clearance."""
    if settings.choice == Measure.CLEARANCE:
        return np.inf
    if settings.choice == Measure.LIMITS:
        return limit_distance_kernel(arm, q)
    return manipulability(arm, work, q)


@kernel(allocates=False)
def keep(arm: Arm, work: ReachWork, q: Array, result: Array, joints: Array) -> None:
    """Write the best configuration."""
    for j in range(q.shape[0]):
        joints[j] = q[j]
    result[Column.MANIPULABILITY] = manipulability(arm, work, q)
    result[Column.LIMIT_DISTANCE] = limit_distance_kernel(arm, q)


@kernel(allocates=False)
def manipulability(arm: Arm, work: ReachWork, q: Array) -> float:
    """Product of the singular values of the Jacobian at q (n,)."""
    frame_and_jacobian_kernel(arm.model, q, arm.link, work.J)
    return volume_kernel(work.J)


@kernel(allocates=False)
def volume_kernel(J: Array) -> float:
    """Product of the singular values of J (6, n), the root of its smaller Gram determinant."""
    n = J.shape[1]
    size = min(6, n)
    A = on_stack(36).reshape((6, 6))
    for i in range(size):
        for j in range(i + 1):
            total = 0.0
            if n < 6:
                for k in range(6):
                    total += J[k, i] * J[k, j]
            else:
                for k in range(n):
                    total += J[i, k] * J[j, k]
            A[i, j] = total
    product = 1.0
    for i in range(size):
        for j in range(i):
            total = A[i, j]
            for k in range(j):
                total -= A[i, k] * A[j, k]
            A[i, j] = total / A[j, j]
        total = A[i, i]
        for k in range(i):
            total -= A[i, k] * A[i, k]
        if total <= 0.0:
            return 0.0
        A[i, i] = math.sqrt(total)
        product *= A[i, i]
    return product


@kernel(allocates=False)
def limit_distance_kernel(arm: Arm, q: Array) -> float:
    """Share of half its range that is left to the joint nearest to a limit: 1 at the middle."""
    least = 1.0
    for j in range(q.shape[0]):
        half = 0.5 * (arm.upper[j] - arm.lower[j])
        if math.isfinite(half) and half > 0.0:
            share = min(q[j] - arm.lower[j], arm.upper[j] - q[j]) / half
            least = min(least, share)
    return least
