"""Branches of an arm that misses its closed form by little, as calibrated arms do.

Far from singularities each branch of the form has one of the true arm nearby, which damped steps
find. Near them branches part, meet or vanish elsewhere than the form's: a family of the form's
solutions leaves a few of the true arm's, a fold of one branch opens into two. Those lie along
curves (``continuation``) through what the form says, and through what it says for poses nearby.
"""

import math

import numpy as np

from compiled.kernel import kernel
from compiled.random import State, uniform_kernel
from kinematics.arrays import Array, Indices
from kinematics.ik.closed_form.continuation import (
    JOINTS,
    Curve,
    follow_kernel,
    is_visited_kernel,
    joint_direction_kernel,
    sharpen_kernel,
    weakest_kernel,
)
from kinematics.ik.closed_form.refine import (
    CODE,
    GROUP,
    ORIENTATION,
    POSITION,
    VALUE,
    admit_kernel,
    candidates_kernel,
    product_kernel,
    refine_kernel,
    tip_kernel,
)
from kinematics.ik.closed_form.structure import (
    BRANCH,
    CHAIN_JOINTS,
    COLUMNS,
    FAMILY,
    HEADER,
    HELD,
    INDEX,
    KIND,
    MISS,
    PARAMETER,
    REDUNDANT,
    REVERSED,
    SIGN,
    Arm,
    CandidateTable,
    Problem,
)
from kinematics.ik.numeric.dls_step import error_kernel
from kinematics.jacobian import frame_and_jacobian_kernel

#: Starts lie this far around a candidate [rad], but for every fourth.
_SPREAD = 0.4
#: Candidates at most that starts lie around.
_CENTRES = 16
#: Starts that damped steps bring so near [m], [rad] get as many steps again.
_SLOW = 1e-2


@kernel
def set_joints_kernel(plan: Array, candidate: Array, q: Array) -> None:
    """Put the angles and the parameter of a candidate into q (n,)."""
    for j in range(7 if plan[HEADER, KIND] == REDUNDANT else 6):
        angle = math.atan2(candidate[2 * j + 1], candidate[2 * j])
        q[int(plan[1 + j, INDEX])] = plan[1 + j, SIGN] * angle
    if plan[HEADER, HELD] >= 0.0:
        q[int(plan[HEADER, HELD])] = candidate[PARAMETER]


@kernel
def add_nearby_branches_kernel(
    problem: Problem, candidates: Array, trials: int, draw: int, q: Array, out: Array, count: int
) -> int:
    """Search around the candidates of a form that the arm misses, near a singularity of the form.

    There branches of the true arm part, meet or vanish elsewhere than the form's: polished starts
    around each candidate, first turned against each other in the joints that a straight wrist
    leaves free, find those that are left.

    Args:
        problem: The pose and the arm.
        candidates: Rows of candidates, shape (k, WIDTH).
        trials: Starts around each.
        draw: Number of the search: each number draws other starts.
        q: Workspace, shape (n,).
        out: Table of branches, shape (r, n + MORE).
        count: Rows that are taken.

    Returns:
        The new count.
    """
    plan, model, link, T = problem.arm.plan, problem.arm.model, problem.arm.link, problem.T
    n, held, number = q.shape[0], int(plan[HEADER, HELD]), candidates.shape[0]
    last = int(model[1 + n + link, 0])
    unlimited = np.full(n, np.inf)
    state = np.array([0x9E3779B97F4A7C15], dtype=np.uint64)
    state[0] += np.uint64(draw)
    centres = min(number, _CENTRES)
    for i in range(centres):
        # Members of families fill many rows in turn.
        k = i * number // centres
        for trial in range(trials):
            set_joints_kernel(plan, candidates[k], q)
            spread = math.pi if trial % 4 == 3 else _SPREAD
            for j in range(last + 1):
                if j != held:
                    q[j] += spread * (2.0 * uniform_kernel(state) - 1.0)
            turn = math.pi * (2.0 * uniform_kernel(state) - 1.0)
            ends = (0, 2) if plan[HEADER, REVERSED] != 0.0 else (3, 5)
            a, b = int(plan[1 + ends[0], INDEX]), int(plan[1 + ends[1], INDEX])
            if uniform_kernel(state) < 0.5:
                q[min(a, b)] += turn
                q[max(a, b)] += turn if uniform_kernel(state) < 0.5 else -turn
            error = refine_kernel(model, link, T, -unlimited, unlimited, held, q)
            if problem.tolerance < max(error[0], error[1]) < _SLOW:
                # Singular values that are small make steps so.
                error = refine_kernel(model, link, T, -unlimited, unlimited, held, q)
            about = (candidates[k, BRANCH], candidates[k, FAMILY], candidates[k, PARAMETER])
            count = admit_kernel(problem, error, about, q, out, count)
    return count


@kernel
def add_perturbed_branches_kernel(
    problem: Problem, table: CandidateTable, value: float, number: int, trials: int, q: Array,
    out: Array, count: int,
) -> tuple[int, int]:  # fmt: skip
    """Add the branches that damped steps reach from the candidates of poses near the target.

    For a target that has no candidate itself: the true arm has a singularity there that the form
    does not have, or the target is beyond the form's reach.

    Args:
        problem: The pose and the arm.
        table: The candidates.
        value: Parameter of a redundant arm.
        number: Candidates that are there.
        trials: Poses near the target to try.
        q: Workspace, shape (n,).
        out: Table of branches, shape (r, n + MORE).
        count: Rows that are taken.

    Returns:
        Candidates that are there now, and the new count.
    """
    plan, model, link, T = problem.arm.plan, problem.arm.model, problem.arm.link, problem.T
    n, held, candidates = q.shape[0], int(plan[HEADER, HELD]), table.rows
    state, pose = np.array([0xD1B54A32D192ED03], dtype=np.uint64), np.empty(COLUMNS)
    unlimited = np.full(n, np.inf)
    for trial in range(trials):
        size = max(1e-7, 30.0 * plan[HEADER, MISS]) * (1.0 + 0.1 * trial * trial)
        x, y, z = _jitter(state, size), _jitter(state, size), _jitter(state, size)
        a, b, c = _jitter(state, size), _jitter(state, size), _jitter(state, size)
        r = 1.0 / math.sqrt(1.0 + a * a + b * b + c * c)
        w, a, b, c = r, a * r, b * r, c * r
        near = product_kernel(
            (
                1.0 - 2.0 * (b * b + c * c), 2.0 * (a * b - c * w), 2.0 * (a * c + b * w), 0.0,
                2.0 * (a * b + c * w), 1.0 - 2.0 * (a * a + c * c), 2.0 * (b * c - a * w), 0.0,
                2.0 * (a * c - b * w), 2.0 * (b * c + a * w), 1.0 - 2.0 * (a * a + b * b), 0.0,
            ),
            (T[0], T[1], T[2], 0.0, T[4], T[5], T[6], 0.0, T[8], T[9], T[10], 0.0),
        )  # fmt: skip
        near = (
            near[0], near[1], near[2], T[3] + x, near[4], near[5], near[6], T[7] + y,
            near[8], near[9], near[10], T[11] + z,
        )  # fmt: skip
        first = number
        number = candidates_kernel(plan, pose, table, near, value, number)
        for k in range(first, min(number, first + 16)):
            q[:] = problem.seed
            set_joints_kernel(plan, candidates[k], q)
            error = refine_kernel(model, link, T, -unlimited, unlimited, held, q)
            about = (candidates[k, BRANCH], 0.0, candidates[k, PARAMETER])
            count = admit_kernel(problem, error, about, q, out, count)
    return number, count


@kernel
def _jitter(state: State, size: float) -> float:
    return size * (2.0 * uniform_kernel(state) - 1.0)


#: The sign of a determinant is not certain where the least singular value is below [m or rad].
_UNCERTAIN = 1e-8
#: Branches that some direction moves by less than this [m or rad a radian] may have others along
#: it.
_FOLD = 0.03
#: Two singular values below so many times the root of what the arm misses make a singularity of
#: both.
_FOLD_TWICE = 2.0
#: Directions in which curves through a solution in such a singularity are followed.
_TURNS = 4
#: Candidates in such a singularity that the curve through them is followed of.
_SPARSE = 16
#: A curve that was followed runs through a solution that is so near to it [rad].
_BESIDE = 1e-3
#: Candidates may be away from it by so many times what the arm misses more.
_ASIDE = 30.0
#: Points of curves that are remembered.
_VISITED = 4096
#: Solutions along one curve at most.
_ROOTS = 16


@kernel
def add_curve_branches_kernel(  # noqa: PLR0912, PLR0915
    problem: Problem, candidates: Array, before: int, phase: float, q: Array, out: Array, count: int
) -> int:
    """Add the branches along the curves through what is nearly singular; the new count.

    Args:
        problem: The pose and the arm.
        candidates: Candidates that curves begin at after the branches, shape (k, WIDTH).
        before: Row of ``out`` from which on curves begin at its branches, those added included.
        phase: Turns the directions of curves where two are lost, as a share of the angle between
            them, in [0, 1).
        q: Workspace, shape (n,).
        out: Table of branches, shape (r, n + MORE).
        count: Rows that are taken.
    """
    arm, T, tolerance = problem.arm, problem.T, problem.tolerance
    plan, model, link, n = arm.plan, arm.model, arm.link, q.shape[0]
    joints = _moving_joints(arm)
    count = _sharpen_branches(problem, joints, before, q, out, count)
    J, start, w = np.empty((6, n)), np.empty(n), np.empty(6)
    u, v, second, none = np.empty(6), np.empty(6), np.empty(6), np.zeros(6)
    visited, seen, roots = np.empty((_VISITED, 2 * JOINTS)), 0, np.empty((_ROOTS, n))
    moving = Curve(model, link, T, joints, True, tolerance)
    staying = Curve(model, link, T, joints, False, tolerance)
    k, number = before, candidates.shape[0]
    stride = 1 + number // _SPARSE
    # What is solved lies on its curve, a candidate beside it.
    tried, both = 0, _FOLD_TWICE * math.sqrt(plan[HEADER, MISS])
    while k < count or tried < number:
        solved = k < count
        if solved:
            start[:] = out[k, :n]
            about = (out[k, n + CODE], 0.0, out[k, n + VALUE])
            k += 1
        else:
            start[:] = problem.seed
            set_joints_kernel(plan, candidates[tried], start)
            about = (candidates[tried, BRANCH], 0.0, candidates[tried, PARAMETER])
            tried += 1
        frame_and_jacobian_kernel(model, start, link, J)
        if weakest_kernel(J, joints, u, v, none) >= _FOLD:
            continue
        turns = 1
        if weakest_kernel(J, joints, second, w, u) < both and (solved or tried % stride == 0):
            turns += _TURNS if solved else 1
        for turn in range(turns):
            if turn == 0:
                # Where two directions are lost, many curves run through the same places.
                beside = _BESIDE
                if not (solved or turns > 1):
                    beside += _ASIDE * plan[HEADER, MISS]
                if is_visited_kernel(visited, seen, joints, start, beside):
                    continue
                w[:] = u
            else:
                if solved:
                    angle = math.pi * (turn + phase) / _TURNS
                    w[:] = math.cos(angle) * u + math.sin(angle) * second
                else:
                    # Of all curves the one that runs through the candidate.
                    e = error_kernel(tip_kernel(model, start, link), T)
                    w[0], w[1], w[2], w[3], w[4], w[5] = e[0], e[1], e[2], e[3], e[4], e[5]
                    size = math.sqrt(np.sum(w * w))
                    if not size > tolerance:
                        continue
                    w /= size
                v[:] = joint_direction_kernel(J, joints, w)
            for side in range(2):
                zeros, seen, closed = follow_kernel(
                    moving if turn == 0 else staying, start, w, (1.0 - 2.0 * side) * v, visited,
                    seen, roots,
                )  # fmt: skip
                for r in range(zeros):
                    q[:] = roots[r]
                    error = sharpen_kernel(model, link, T, joints, q)
                    count = admit_kernel(problem, error, about, q, out, count)
                if closed:
                    break
    return count


@kernel
def _moving_joints(arm: Arm) -> Indices:
    """The six joints that carry the link and are not held."""
    joints, number = np.empty(JOINTS, dtype=np.int64), 0
    for j in range(int(arm.plan[HEADER, CHAIN_JOINTS])):
        if j != int(arm.plan[HEADER, HELD]):
            joints[number] = j
            number += 1
    return joints


@kernel
def is_balanced_kernel(arm: Arm, before: int, q: Array, out: Array, count: int) -> bool:
    """Whether as many branches have a positive determinant of the Jacobian as a negative one.

    All branches of an arm do, since they come and go in pairs of opposite signs and far poses have
    none: what is out of balance lacks one. True where a sign is not certain.
    """
    n = q.shape[0]
    joints, J, M, total = _moving_joints(arm), np.empty((6, n)), np.empty((6, 6)), 0
    u, v = np.zeros(6), np.empty(6)
    for k in range(before, count):
        q[:] = out[k, :n]
        frame_and_jacobian_kernel(arm.model, q, arm.link, J)
        for i in range(6):
            for a in range(JOINTS):
                M[i, a] = J[i, joints[a]]
        if weakest_kernel(J, joints, u, v, np.zeros(6)) < _UNCERTAIN:
            return True
        total += 1 if np.linalg.det(M) > 0.0 else -1
    return total == 0


@kernel
def _sharpen_branches(
    problem: Problem, joints: Indices, before: int, q: Array, out: Array, count: int
) -> int:
    """Enter the branches from row ``before`` on once more, to the last bits where nearly singular.

    Several that are one, but for the tolerance, are one then.
    """
    model, link, n = problem.arm.model, problem.arm.link, q.shape[0]
    J, u, v, none = np.empty((6, n)), np.empty(6), np.empty(6), np.zeros(6)
    rows, count = out[before:count].copy(), before
    for k in range(rows.shape[0]):
        q[:] = rows[k, :n]
        error = (rows[k, n + POSITION], rows[k, n + ORIENTATION])
        frame_and_jacobian_kernel(model, q, link, J)
        if weakest_kernel(J, joints, u, v, none) < _FOLD:
            error = sharpen_kernel(model, link, problem.T, joints, q)
        about = (rows[k, n + CODE], rows[k, n + GROUP], rows[k, n + VALUE])
        count = admit_kernel(problem, error, about, q, out, count)
    return count
