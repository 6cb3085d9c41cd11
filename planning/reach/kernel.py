"""Reach of one pose after another: every branch of the closed form, checked and measured."""

import math
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array, Indices
from kinematics.compiled.kernel import kernel
from kinematics.ik.branches import branches_kernel
from kinematics.ik.plan import Arm
from kinematics.ik.refine import CODE, GROUP, INSIDE, MORE
from kinematics.ik.verification import near_kernel
from kinematics.jacobian import frame_and_jacobian_kernel
from obstacles.edge_check import FREE
from obstacles.kernel_work import Workspace, workspace
from obstacles.model_arrays import ModelArrays
from obstacles.proximity import closest_pair
from obstacles.state_check import verdict_in

# Columns of a row of results.
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
COLUMNS = 6

# What became of a pose; the later ones came nearer.
OUT_OF_REACH = 0
OUTSIDE_LIMITS = 1
IN_COLLISION = 2
REACHED = 3

# What makes the best configuration of a pose.
BY_MANIPULABILITY = 0
BY_CLEARANCE = 1
BY_LIMITS = 2
#: The first one that is found free: no other is looked for.
BY_ORDER = 3

#: Branches of a closed form for one value of its parameter at most.
_ROWS = 16
#: More branches than there are.
_ALL = 2**31


class ReachSettings(NamedTuple):
    """Settings of the reach kernels.

    Args:
        tolerance: Largest error of a solution [m], [rad].
        margin: Distance to be kept from everything beyond the pairs' own margins [m].
        choice: What makes the best configuration.
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
        collision: Of the collision checks.
        asked: Likewise, shape (1,).
        J: Room for a Jacobian, shape (6, n).
        q: Room for a configuration, shape (n,).
        tallies: Of each deviation that turns the last joint: how many branches are free, and which
            as bits; shape (s, 2).
    """

    collision: Workspace
    asked: Indices
    J: Array
    q: Array
    tallies: Indices


class Parts(NamedTuple):
    """The robot in the scene, whole and in two parts, for deviations that turn the last joint.

    Args:
        whole: The packed robot and scene.
        before: The same with all that does not move with the last joint alone.
        behind: The same with what moves with the last joint alone.
        turns: By how much each deviation turns the last joint from where the first one has it,
            shape (s,) [rad]; (0,) where deviations do more than that.
    """

    whole: ModelArrays
    before: ModelArrays
    behind: ModelArrays
    turns: Array


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
    work = _room(model, n, parts.turns.shape[0])
    table = np.empty((_ROWS * values.shape[0], n + MORE))
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
                _assess_turns(arm, parts, work, rows, seed, settings, results[k], joints[k])
                break
            best = _assess(arm, model, work, rows, settings, best, results[k], joints[k])
            if settings.choice == BY_ORDER and results[k, STATUS] == REACHED:
                break
        _measure_clearance(model, settings, results[k], joints[k])


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
    work = _room(model, n, 0)
    for k in range(rows.shape[0]):
        best = -np.inf
        for s in range(rows.shape[1]):
            if rows[k, s, n + INSIDE] == 1.0:
                best = _assess(
                    arm, model, work, rows[k, s : s + 1], settings, best, results[k], joints[k]
                )
                if settings.choice == BY_ORDER and results[k, STATUS] == REACHED:
                    break
        _measure_clearance(model, settings, results[k], joints[k])


@kernel
def _room(model: ModelArrays, n: int, turns: int) -> ReachWork:
    """Memory for n joints and so many deviations that turn the last one."""
    return ReachWork(
        workspace(model),
        np.empty(1, dtype=np.int64),
        np.empty((6, n)),
        np.empty(n),
        np.empty((turns, 2), dtype=np.int64),
    )


@kernel
def _all_alone(table: Array, n: int) -> bool:
    """Whether no branch stands for a family, so that all of them are in the table."""
    return not np.any(table[:, n + GROUP] != 0.0)


@kernel
def _assess_turns(  # noqa: C901, PLR0912
    arm: Arm, parts: Parts, work: ReachWork, table: Array, seed: Array, settings: ReachSettings,
    result: Array, joints: Array,
) -> None:  # fmt: skip
    """Check and measure the configurations of all deviations, which turn the last joint alone.

    What does not move with it is looked at once a branch, and so is the manipulability.

    Args:
        arm: The chain up to the link and its closed form.
        parts: The packed robot and scene.
        work: Memory.
        table: A row for each branch of the first deviation, shape (r, n + MORE).
        seed: Configuration that whole turns are to be near, shape (n,).
        settings: How to judge.
        result: Of the pose, brought up to date, shape (COLUMNS,).
        joints: The best configuration, likewise, shape (n,).
    """
    last, best, q, tallies = seed.shape[0] - 1, -np.inf, work.q, work.tallies
    tallies[:] = 0
    for row in range(table.shape[0]):
        inside = True
        for j in range(last):
            q[j] = table[row, j]
            inside = inside and arm.lower[j] <= q[j] <= arm.upper[j]
        if not inside:
            continue
        bit = 1 << int(table[row, last + 1 + CODE])
        around, manipulability = -1, -1.0
        for s in range(tallies.shape[0]):
            q[last], fits, _ = near_kernel(
                table[row, last] + parts.turns[s], arm.lower[last], arm.upper[last], seed[last]
            )
            if not fits:
                continue
            if around < 0:
                around = verdict_in(parts.before, work.collision, q, settings.margin, work.asked)
                result[STATUS] = max(result[STATUS], IN_COLLISION)
            if around != FREE:
                break
            # The places of all the others are those of the look before.
            if verdict_in(parts.behind, work.collision, q, settings.margin, work.asked) != FREE:
                continue
            if manipulability < 0.0:
                frame_and_jacobian_kernel(arm.model, q, arm.link, work.J)
                manipulability = volume_kernel(work.J)
            tallies[s, 0] += 0 if settings.redundant and tallies[s, 1] & bit != 0 else 1
            tallies[s, 1] |= bit
            limits = limit_distance_kernel(arm, q)
            value = manipulability
            if settings.choice == BY_LIMITS:
                value = limits
            elif settings.choice == BY_CLEARANCE:
                value, _ = closest_pair(parts.whole, q)
            if value > best:
                best = value
                joints[:] = q
                result[MANIPULABILITY], result[LIMIT_DISTANCE] = manipulability, limits
            if settings.choice == BY_ORDER:
                break
        if settings.choice == BY_ORDER and best > -np.inf:
            break
    for s in range(tallies.shape[0]):
        if tallies[s, 0] > 0:
            result[STATUS] = REACHED
            result[SAMPLES] += 1
            result[BRANCHES] = max(result[BRANCHES], tallies[s, 0])


@kernel
def _assess(
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
        result: Of the pose, brought up to date, shape (COLUMNS,).
        joints: The best configuration, likewise, shape (n,).
    """
    n = joints.shape[0]
    free, seen = 0, 0
    for row in range(table.shape[0]):
        if table[row, n + INSIDE] == 0.0:
            continue
        q = table[row, :n]
        if verdict_in(model, work.collision, q, settings.margin, work.asked) != FREE:
            result[STATUS] = max(result[STATUS], IN_COLLISION)
            continue
        # The same branch at another value of the parameter is no other branch.
        bit = 1 << int(table[row, n + CODE])
        free += 0 if settings.redundant and seen & bit != 0 else 1
        seen |= bit
        frame_and_jacobian_kernel(arm.model, q, arm.link, work.J)
        manipulability, limits = volume_kernel(work.J), limit_distance_kernel(arm, q)
        value = manipulability
        if settings.choice == BY_ORDER:
            best = np.inf
            joints[:] = q
            result[MANIPULABILITY], result[LIMIT_DISTANCE] = manipulability, limits
            break
        if settings.choice == BY_LIMITS:
            value = limits
        elif settings.choice == BY_CLEARANCE:
            value, _ = closest_pair(model, q)
        if value > best:
            best = value
            joints[:] = q
            result[MANIPULABILITY], result[LIMIT_DISTANCE] = manipulability, limits
    if free > 0:
        result[STATUS] = REACHED
        result[SAMPLES] += 1
        result[BRANCHES] = max(result[BRANCHES], free)
    return best


@kernel
def _measure_clearance(
    model: ModelArrays, settings: ReachSettings, result: Array, joints: Array
) -> None:
    """Write the clearance of the best configuration of a pose that is reached."""
    if settings.clearance and result[STATUS] == REACHED:
        result[CLEARANCE], _ = closest_pair(model, joints)


@kernel
def volume_kernel(J: Array) -> float:
    """Product of the singular values of J (6, n), the root of its smaller Gram determinant."""
    n = J.shape[1]
    size = min(6, n)
    A = np.empty((size, size))
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
