"""Branches of an arm that misses its closed form by little, by damped steps from nearby starts."""

import math

import numpy as np

from compiled.kernel import kernel
from compiled.random import State, uniform_kernel
from kinematics.arrays import Array
from kinematics.ik.closed_form.plan import (
    BRANCH,
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
    CandidateTable,
    Problem,
)
from kinematics.ik.closed_form.refine import (
    admit_kernel,
    candidates_kernel,
    product_kernel,
    refine_kernel,
)

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
