"""Branches of an arm that misses its closed form by little, as calibrated arms do.

Far from singularities each branch of the form has one of the true arm nearby, which damped steps
find. Near them branches part, meet or vanish elsewhere than the form's: a family of the form's
solutions leaves a few of the true arm's, a fold of one branch opens into two. Those lie along
curves (``continuation``) through what the form says, and through what it says for poses nearby.
"""

import math

import numpy as np

from kinematics.arrays import Array, Indices
from kinematics.compiled.kernel import kernel
from kinematics.frame import Frame
from kinematics.ik.continuation import (
    JOINTS,
    follow_kernel,
    is_visited_kernel,
    joint_direction_kernel,
    sharpen_kernel,
    weakest_kernel,
)
from kinematics.ik.dls_step import error_kernel
from kinematics.ik.refine import (
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
from kinematics.ik.spherical import BRANCH, FAMILY, PARAMETER
from kinematics.jacobian import frame_and_jacobian_kernel
from kinematics.linear_solve import cholesky_solve_kernel
from kinematics.random import State, uniform_kernel

#: Starts around a candidate: so far around [rad] but for every fourth, and so many candidates at
#: most.
_SPREAD, _CENTRES = 0.4, 16
#: The sign of a determinant is not certain where the least singular value is below.
_UNCERTAIN = 1e-8
#: Starts that damped steps bring so near [m], [rad] get as many steps again.
_SLOW = 1e-2
#: Branches that some direction moves by less than this [m or rad a radian] may have others along
#: it, which a redundant arm is searched for so far along it [rad].
_FOLD, _STEPS_ASIDE = 0.03, (1e-4, 1e-3, 1e-2, 5e-2, 0.2, 0.6)
#: Two singular values below so many times the root of what the arm misses make a singularity of
#: both: curves through a solution are followed in so many directions, and of so many candidates
#: that which runs through them.
_FOLD_TWICE, _TURNS, _SPARSE = 2.0, 4, 16
#: A curve that was followed runs through what is so near to it [rad], and candidates may be away by
#: so many times what the arm misses more.
_BESIDE, _ASIDE = 1e-3, 30.0
#: Points of curves that are remembered, and solutions along one.
_VISITED, _ROOTS = 4096, 16


@kernel
def add_curve_branches_kernel(  # noqa: PLR0912
    plan: Array, model: Array, link: int, T: Frame, lower: Array, upper: Array, seed: Array,
    tolerance: float, raw: Array, found: int, before: int, phase: float, q: Array, out: Array,
    count: int,
) -> int:  # fmt: skip
    """Add the branches along the curves through what is nearly singular; the new count.

    Curves begin at the branches that are there from row ``before`` on, those that are added
    included, then at the ``found`` candidates of ``raw``. ``phase`` in [0, 1) turns the directions
    in which curves are followed where two are lost.
    """
    n = q.shape[0]
    joints = np.empty(JOINTS, dtype=np.int64)
    if not _moving(plan, model, link, joints):
        return _add_twins(
            plan, model, link, T, lower, upper, seed, tolerance, before, q, out, count
        )
    count = _sharpen_branches(
        plan, model, link, T, lower, upper, seed, tolerance, joints, before, q, out, count
    )
    J, start, w = np.empty((6, n)), np.empty(n), np.empty(6)
    u, v, second, none = np.empty(6), np.empty(6), np.empty(6), np.zeros(6)
    visited, seen, roots = np.empty((_VISITED, 2 * JOINTS)), 0, np.empty((_ROOTS, n))
    k, stride = before, 1 + found // _SPARSE
    # What is solved lies on its curve, a candidate beside it.
    tried, both = 0, _FOLD_TWICE * math.sqrt(plan[0, 5])
    while k < count or tried < found:
        solved = k < count
        if solved:
            start[:] = out[k, :n]
            about = (out[k, n + CODE], 0.0, out[k, n + VALUE])
            k += 1
        else:
            start[:] = seed
            _set_joints(plan, raw[tried], start)
            about = (raw[tried, BRANCH], 0.0, raw[tried, PARAMETER])
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
                room = _BESIDE if solved or turns > 1 else _BESIDE + _ASIDE * plan[0, 5]
                if is_visited_kernel(visited, seen, joints, start, room):
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
                    model, link, T, joints, turn == 0, 1.0 - 2.0 * side, start, w, v, tolerance,
                    visited, seen, roots,
                )  # fmt: skip
                for r in range(zeros):
                    q[:] = roots[r]
                    error = sharpen_kernel(model, link, T, joints, q)
                    count = admit_kernel(
                        plan, model, link, T, lower, upper, seed, tolerance, error, about, q, out,
                        count,
                    )  # fmt: skip
                if closed:
                    break
    return count


@kernel
def _moving(plan: Array, model: Array, link: int, joints: Indices) -> bool:
    """Write the joints that carry the link and are not held into ``joints``; whether they fit."""
    number, held = 0, int(plan[0, 2])
    for j in range(int(model[1 + int(model[0, 0]) + link, 0]) + 1):
        if j != held:
            if number < JOINTS:
                joints[number] = j
            number += 1
    return number == JOINTS


@kernel
def is_balanced_kernel(
    plan: Array, model: Array, link: int, before: int, q: Array, out: Array, count: int
) -> bool:
    """Whether as many branches have a positive determinant of the Jacobian as a negative one.

    All branches of an arm do, since they come and go in pairs of opposite signs and far poses have
    none: what is out of balance lacks one. True where a sign is not certain.
    """
    n = q.shape[0]
    joints, J, M, total = np.empty(JOINTS, dtype=np.int64), np.empty((6, n)), np.empty((6, 6)), 0
    u, v = np.zeros(6), np.empty(6)
    if not _moving(plan, model, link, joints):
        return True
    for k in range(before, count):
        q[:] = out[k, :n]
        frame_and_jacobian_kernel(model, q, link, J)
        for i in range(6):
            for a in range(JOINTS):
                M[i, a] = J[i, joints[a]]
        if weakest_kernel(J, joints, u, v, np.zeros(6)) < _UNCERTAIN:
            return True
        total += 1 if np.linalg.det(M) > 0.0 else -1
    return total == 0


@kernel
def _sharpen_branches(
    plan: Array, model: Array, link: int, T: Frame, lower: Array, upper: Array, seed: Array,
    tolerance: float, joints: Indices, before: int, q: Array, out: Array, count: int,
) -> int:  # fmt: skip
    """Enter the branches from row ``before`` on once more, to the last bits where nearly singular.

    Several that are one, but for the tolerance, are one then.
    """
    n, J, u, v, none = q.shape[0], np.empty((6, q.shape[0])), np.empty(6), np.empty(6), np.zeros(6)
    rows, count = out[before:count].copy(), before
    for k in range(rows.shape[0]):
        q[:] = rows[k, :n]
        error = (rows[k, n + POSITION], rows[k, n + ORIENTATION])
        frame_and_jacobian_kernel(model, q, link, J)
        if weakest_kernel(J, joints, u, v, none) < _FOLD:
            error = sharpen_kernel(model, link, T, joints, q)
        about = (rows[k, n + CODE], rows[k, n + GROUP], rows[k, n + VALUE])
        count = admit_kernel(
            plan, model, link, T, lower, upper, seed, tolerance, error, about, q, out, count
        )
    return count


@kernel
def _set_joints(plan: Array, candidate: Array, q: Array) -> None:
    """Put the angles and the parameter of a candidate into q (n,)."""
    for j in range(7 if plan[0, 0] == 2.0 else 6):
        q[int(plan[1 + j, 13])] = plan[1 + j, 0] * math.atan2(
            candidate[2 * j + 1], candidate[2 * j]
        )
    if plan[0, 2] >= 0.0:
        q[int(plan[0, 2])] = candidate[PARAMETER]


@kernel
def add_nearby_branches_kernel(
    plan: Array, model: Array, link: int, T: Frame, lower: Array, upper: Array, seed: Array,
    tolerance: float, raw: Array, found: int, trials: int, draw: int, q: Array, out: Array,
    count: int,
) -> int:  # fmt: skip
    """Search around the candidates of a form that the arm misses, near a singularity of the form.

    There branches of the true arm part, meet or vanish elsewhere than the form's: polished starts
    around each candidate, first turned against each other in the joints that a straight wrist
    leaves free, find those that are left.
    """
    n, held = q.shape[0], int(plan[0, 2])
    last = int(model[1 + n + link, 0])
    unlimited = np.full(n, np.inf)
    state = np.array([0x9E3779B97F4A7C15], dtype=np.uint64)
    state[0] += np.uint64(draw)
    some = min(found, _CENTRES)
    for i in range(some):
        # Members of families fill many rows in turn.
        k = i * found // some
        for trial in range(trials):
            _set_joints(plan, raw[k], q)
            spread = math.pi if trial % 4 == 3 else _SPREAD
            for j in range(last + 1):
                if j != held:
                    q[j] += spread * (2.0 * uniform_kernel(state) - 1.0)
            turn = math.pi * (2.0 * uniform_kernel(state) - 1.0)
            ends = (0, 2) if plan[0, 1] != 0.0 else (3, 5)
            a, b = int(plan[1 + ends[0], 13]), int(plan[1 + ends[1], 13])
            if uniform_kernel(state) < 0.5:
                q[min(a, b)] += turn
                q[max(a, b)] += turn if uniform_kernel(state) < 0.5 else -turn
            error = refine_kernel(model, link, T, -unlimited, unlimited, held, q)
            if tolerance < max(error[0], error[1]) < _SLOW:
                # Singular values that are small make steps so.
                error = refine_kernel(model, link, T, -unlimited, unlimited, held, q)
            about = (raw[k, BRANCH], raw[k, FAMILY], raw[k, PARAMETER])
            count = admit_kernel(
                plan, model, link, T, lower, upper, seed, tolerance, error, about, q, out, count
            )
    return count


@kernel
def _add_twins(
    plan: Array, model: Array, link: int, T: Frame, lower: Array, upper: Array, seed: Array,
    tolerance: float, before: int, q: Array, out: Array, count: int,
) -> int:  # fmt: skip
    """Look for the twin of each branch that is near a fold, where two of them meet.

    It lies along the direction that moves the link least. The form may have one root there, or
    none, where the true arm has two.
    """
    n, held = q.shape[0], int(plan[0, 2])
    J, v, unlimited = np.empty((6, n)), np.empty(n), np.full(n, np.inf)
    k = before
    while k < count:
        q[:] = out[k, :n]
        frame_and_jacobian_kernel(model, q, link, J)
        if _least_moving(J, held, int(model[1 + n + link, 0]), v) < _FOLD:
            for step in _STEPS_ASIDE:
                for side in (1.0, -1.0):
                    for j in range(n):
                        q[j] = out[k, j] + side * step * v[j]
                    error = refine_kernel(model, link, T, -unlimited, unlimited, held, q)
                    about = (out[k, n + CODE], 0.0, out[k, n + VALUE])
                    count = admit_kernel(
                        plan, model, link, T, lower, upper, seed, tolerance, error, about, q, out,
                        count,
                    )  # fmt: skip
        k += 1
    return count


@kernel
def _least_moving(J: Array, held: int, last: int, v: Array) -> float:
    """Write the direction that J (6, n) stretches least into v, by inverse iteration; how much."""
    n = v.shape[0]
    H = np.empty((n, n))
    if held >= 0:
        J[:, held] = 0.0
    for j in range(n):
        v[j] = 1.0 + 0.1 * j if j <= last and j != held else 0.0
    for _ in range(3):
        for a in range(n):
            for b in range(a + 1):
                H[a, b] = 0.0
                for i in range(6):
                    H[a, b] += J[i, a] * J[i, b]
            H[a, a] += 1e-14 if a <= last and a != held else 1.0
        cholesky_solve_kernel(H, v, n)
        v /= math.sqrt(np.sum(v * v))
    square = 0.0
    for i in range(6):
        along = 0.0
        for j in range(n):
            along += J[i, j] * v[j]
        square += along * along
    return math.sqrt(square)


@kernel
def add_perturbed_branches_kernel(
    plan: Array, model: Array, link: int, T: Frame, value: float, lower: Array, upper: Array,
    seed: Array, tolerance: float, free: Array, slack: float, t: Array, raw: Array, found: int,
    trials: int, q: Array, out: Array, count: int,
) -> tuple[int, int]:  # fmt: skip
    """Add the branches that damped steps reach from the candidates of poses near the target.

    For a target that has no candidate itself: the true arm has a singularity there that the form
    does not have, or the target is beyond the form's reach.
    """
    n, held = q.shape[0], int(plan[0, 2])
    state = np.array([0xD1B54A32D192ED03], dtype=np.uint64)
    unlimited = np.full(n, np.inf)
    for trial in range(trials):
        size = max(1e-7, 30.0 * plan[0, 5]) * (1.0 + 0.1 * trial * trial)
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
            (
                T[0], T[1], T[2], 0.0, T[4], T[5], T[6], 0.0, T[8], T[9], T[10], 0.0,
            ),
        )  # fmt: skip
        near = (
            near[0], near[1], near[2], T[3] + x, near[4], near[5], near[6], T[7] + y,
            near[8], near[9], near[10], T[11] + z,
        )  # fmt: skip
        first = found
        found = candidates_kernel(plan, near, value, free, slack, t, raw, found)
        for k in range(first, min(found, first + 16)):
            q[:] = seed
            _set_joints(plan, raw[k], q)
            error = refine_kernel(model, link, T, -unlimited, unlimited, held, q)
            about = (raw[k, BRANCH], 0.0, raw[k, PARAMETER])
            count = admit_kernel(
                plan, model, link, T, lower, upper, seed, tolerance, error, about, q, out, count
            )
    return found, count


@kernel
def _jitter(state: State, size: float) -> float:
    return size * (2.0 * uniform_kernel(state) - 1.0)
