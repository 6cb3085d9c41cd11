"""All branches of a closed form for a pose, verified on the true chain."""

import math

import numpy as np

from compiled.kernel import kernel
from compiled.simd import LANES, on_stack
from kinematics.arrays import Array, Indices
from kinematics.forward import finite_kernel
from kinematics.frame import frame_kernel
from kinematics.ik.closed_form.calibrated import (
    add_curve_branches_kernel,
    add_nearby_branches_kernel,
    add_perturbed_branches_kernel,
    is_balanced_kernel,
)
from kinematics.ik.closed_form.refine import (
    CLOSE,
    CODE,
    GROUP,
    INSIDE,
    VERIFIED,
    add_refined_kernel,
    candidates_kernel,
    enter_kernel,
    free_kernel,
    parameter_kernel,
    verify_kernel,
)
from kinematics.ik.closed_form.structure import (
    BRANCH,
    COLUMNS,
    FAMILY,
    HEADER,
    KIND,
    MISS,
    PARAMETER,
    REDUNDANT,
    WIDTH,
    Arm,
    CandidateTable,
    Problem,
)
from kinematics.ik.closed_form.subproblem import EXACT
from kinematics.model.chain import MAX_JOINTS

#: Candidates of one pose at most, since families stand for themselves with several members.
_CANDIDATES = 400
#: Members of a family that are tried.
_MEMBERS = 11
#: Numbers of all candidates.
_CANDIDATES_SIZE = _CANDIDATES * WIDTH
#: Numbers of the members' angles.
_FREE_SIZE = _MEMBERS * 7
#: Starts around a hard candidate.
_AROUND = 20
#: Poses around a target that has no candidate itself.
_NUDGES = 16
#: How often a branch is looked for that must be there.
_TRIALS = 6


@kernel(allocates=False)
def branches_kernel(  # noqa: C901, PLR0912
    arm: Arm, target: Array, seed: Array, values: Array, tolerance: float, enough: int, out: Array
) -> int:
    """All branches for a pose, verified, into ``out``; how many there are.

    -1 where the seed is not one finite number a joint, -2 where the target is not finite.

    Args:
        arm: The chain up to the link and its closed form.
        target: T_base_link, shape (4, 4).
        seed: Configuration to be near, shape (n,).
        values: Values of the parameter to try in this order, NaN for that of the seed; one where
            there is none.
        tolerance: Largest error of a solution [m], [rad].
        enough: Stop between parameters with so many solutions inside the limits.
        out: Table of branches: joints, then the columns of ``refine``, shape (r, n + MORE).
    """
    n, plan = seed.shape[0], arm.plan
    if n != int(arm.model[0, 0]) or not finite_kernel(seed):
        return -1
    for row in range(3):
        for column in range(4):
            if not math.isfinite(target[row, column]):
                return -2
    candidates = on_stack(_CANDIDATES_SIZE).reshape((_CANDIDATES, WIDTH))
    joints = 7 if plan[HEADER, KIND] == REDUNDANT else 6
    free = on_stack(_FREE_SIZE)[: _MEMBERS * joints].reshape((_MEMBERS, joints))
    pose, lanes, q = on_stack(COLUMNS), on_stack(VERIFIED), on_stack(MAX_JOINTS)[:n]
    problem = Problem(arm, frame_kernel(target), seed, tolerance)
    miss = plan[HEADER, MISS]
    slack = max(2.0 * tolerance, 10.0 * miss)
    # Many values of a parameter are tried for one that will do, one value for all its branches.
    exact, alone = miss <= EXACT, values.shape[0] == 1
    # Of families the seed's own member first: mostly it is inside the limits, and will do.
    members = 1 if exact else free.shape[0]
    table = CandidateTable(free[:members], slack, candidates)
    free_kernel(arm, seed, table.free)
    count, inside = 0, 0
    for v in range(values.shape[0]):
        value = values[v]
        if math.isnan(value):
            value = parameter_kernel(plan, seed, pose[:7])
        repeated = False
        for k in range(v):
            repeated = repeated or values[k] == value
        if repeated:
            continue
        before = count
        for trial in range(2):
            number = candidates_kernel(plan, pose, table, problem.T, value, 0)
            count, hard = _add_verified(problem, candidates, number, lanes, q, out, count)
            if trial == 1 or members > 1 or _families_settled(
                candidates, number, out, before, count, n
            ):  # fmt: skip
                break
            members, count = free.shape[0], before
            table = CandidateTable(free, slack, candidates)
            free_kernel(arm, seed, free)
        if members > 1 and exact:
            members = 1
            table = CandidateTable(free[:1], slack, candidates)
        if not exact:
            if hard and not alone:
                count = add_nearby_branches_kernel(
                    problem, candidates[:number], _AROUND // 4, 0, q, out, count
                )
            nudges = _NUDGES if count == before else (_NUDGES // 4 if alone and hard else 0)
            number, count = add_perturbed_branches_kernel(
                problem, table, value, number, nudges, q, out, count
            )
            if alone:
                near = number if nudges > 0 else 0
                count = add_curve_branches_kernel(
                    problem, candidates[:near], before, 0.0, q, out, count
                )
                for trial in range(1, _TRIALS):
                    full = count == out.shape[0]
                    if full or is_balanced_kernel(arm, before, q, out, count):
                        break
                    count = add_nearby_branches_kernel(
                        problem, candidates[:number], _AROUND, trial, q, out, count
                    )
                    count = add_curve_branches_kernel(
                        problem, candidates[:0], before, trial / _TRIALS, q, out, count
                    )
        for k in range(before, count):
            inside += int(out[k, n + INSIDE])
        if inside >= enough:
            break
    return count


@kernel(allocates=False)
def _add_verified(
    problem: Problem, candidates: Array, number: int, lanes: Array, q: Array, out: Array, count: int
) -> tuple[int, bool]:
    """Add the candidates that forward kinematics confirms, with damped steps if need be.

    Args:
        problem: The pose and the arm.
        candidates: Rows of candidates, shape (r, WIDTH).
        number: Number of candidates.
        lanes: Workspace, shape (VERIFIED,).
        q: Workspace, shape (n,).
        out: Table of branches, shape (r, n + MORE).
        count: Rows that are taken.

    Returns:
        The new count, and whether some candidate is of a family or far from its branch.
    """
    tolerance, n, hard = problem.tolerance, q.shape[0], False
    errors = 2 * n * LANES
    for first in range(0, number, LANES):
        together = min(number - first, LANES)
        snapped = verify_kernel(problem, candidates, first, together, lanes)
        for lane in range(together):
            candidate = candidates[first + lane]
            position, orientation = lanes[errors + lane], lanes[errors + LANES + lane]
            hard = hard or candidate[FAMILY] != 0.0
            if max(position, orientation) > CLOSE or (snapped >> lane) & 1 != 0:
                count, moved = add_refined_kernel(problem, candidate, lane, lanes, q, out, count)
                hard = hard or moved
            elif max(position, orientation) <= tolerance:
                for j in range(n):
                    q[j] = lanes[(n + j) * LANES + lane]
                about = (
                    position, orientation, lanes[errors + 2 * LANES + lane], candidate[BRANCH],
                    candidate[FAMILY], candidate[PARAMETER],
                )  # fmt: skip
                count = enter_kernel(about, q, out, count)
    return count, hard


@kernel(allocates=False)
def _families_settled(
    candidates: Array, number: int, out: Array, before: int, count: int, n: int
) -> bool:
    """Whether every family's first member is inside the limits and speaks for all of them."""
    for k in range(number):
        family = candidates[k, FAMILY]
        if family == 0.0:
            continue
        inside = False
        for i in range(before, count):
            if out[i, n + GROUP] == family and out[i, n + CODE] == candidates[k, BRANCH]:
                inside = out[i, n + INSIDE] == 1.0
                break
        if family < 0.0 or not inside:
            return False
    return True


@kernel(allocates=False)
def branches_batch_kernel(
    arm: Arm, targets: Array, seeds: Array, values: Array, tolerance: float, enough: int,
    out: Array, counts: Indices,
) -> None:  # fmt: skip
    """``branches_kernel`` for a batch: targets (m, 4, 4), seeds (m, n), values (m, v)."""
    for k in range(targets.shape[0]):
        counts[k] = branches_kernel(arm, targets[k], seeds[k], values[k], tolerance, enough, out[k])


@kernel(allocates=False, unlocks=False)
def nearest_kernel(table: Array, seed: Array) -> tuple[int, int]:
    """Row of the branch inside the limits that is nearest to the seed, and how many are inside.

    Args:
        table: Branches of one pose as ``branches_kernel`` writes them, shape (k, n + MORE).
        seed: Configuration to be near, shape (n,).

    Returns:
        The first of the nearest rows, -1 where none is inside, and the number of those inside.
    """
    n = seed.shape[0]
    best, least, inside = -1, math.inf, 0
    for k in range(table.shape[0]):
        if table[k, n + INSIDE] != 0.0:
            inside += 1
            square = 0.0
            for j in range(n):
                square += (table[k, j] - seed[j]) ** 2
            # Distances that differ by rounding alone keep the order of the branches.
            away = np.rint(1e12 * math.sqrt(square))
            if away < least:
                best, least = k, away
    return best, inside
