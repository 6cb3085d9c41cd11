"""The nonlinear program of constrained inverse kinematics, evaluated in kernels.

    minimise |q - posture|^2 / 2 in a metric or - log w, and the soft rows
    subject to the hard rows, the joint limits, and the signed distances of near pairs

with the manipulability w. ``active_set`` solves it.
"""

import math
from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from kinematics.jacobian import frame_and_jacobian_kernel
from obstacles.collision.model.collision_model import CollisionModel, ModelArrays
from obstacles.collision.proximity import near_pairs
from obstacles.distance.piece_set import ANCHOR_STOP, NODE
from planning.constraints.constraint_set import ConstraintSet, RowWork, evaluate_kernel
from planning.constraints.row import Column
from planning.constraints.row_value import covector_kernel, sideways_kernel

#: Near pairs that a step has room for; what a cloud has beyond it the exact check sees in the end.
_MAX_NEAR_PAIRS = 512
#: Columns of ``Work.pace``: linearisations that are left, whether the last steps ended for good,
#: the share of a step down the objective that is tried first, and the gain that is none.
LEFT, ENDED, SHARE, GAIN = range(4)
#: A gain of the objective below this is none, times 1 and the objective.
LEAST_GAIN = 1e-10


class Goal(NamedTuple):
    """Goal of a constrained search: constraints, limits and objective.

    Args:
        hard: Packed rows that must hold, shape (m, WIDTH).
        soft: Packed rows that should, shape (s, WIDTH).
        weights: Weights of the soft rows, shape (s,).
        lower: Joint limits, shape (n,).
        upper: Joint limits, shape (n,).
        posture: Configuration that q is kept near, shape (n,).
        metric: Weights of that, 0 where manipulability counts instead, shape (n,).
        chain: ``Chain.model``.
        link: Link whose manipulability counts, -1 for the tip; -2 where it does not count.
    """

    hard: Array
    soft: Array
    weights: Array
    lower: Array
    upper: Array
    posture: Array
    metric: Array
    chain: Array
    link: int


def make_goal(
    constraints: ConstraintSet,
    posture: Array,
    metric: Array,
    *,
    soft: ConstraintSet | None = None,
    link: int = -2,
    rows: Array | None = None,
) -> Goal:
    """A goal for the kernels, which are compiled for arrays that may be written to.

    Args:
        constraints: Constraints whose rows must hold, whether they have weights or not.
        posture: Shape (n,).
        metric: Shape (n,).
        soft: Rows that should hold, with their weights.
        link: Link as in ``Goal``.
        rows: Rows in place of those of the constraints, shape (m, WIDTH).
    """
    chain = constraints.chain
    wished = constraints.packed[:0] if soft is None else soft.packed
    weights = np.zeros(0) if soft is None else soft.weights
    hard = constraints.packed if rows is None else rows
    return Goal(
        hard=np.array(hard),
        soft=np.array(wished),
        weights=np.array(weights),
        lower=np.array(chain.limits.lower),
        upper=np.array(chain.limits.upper),
        posture=np.array(posture),
        metric=np.array(metric),
        chain=chain.model,
        link=link,
    )


def search_arrays(model: CollisionModel, headroom: float = 0.0) -> ModelArrays:
    """A robot in its scene for the kernels, with so much [m] to keep beyond the margins."""
    arrays = model.arrays
    return arrays._replace(margin=arrays.margin + headroom, own_margin=arrays.own_margin + headroom)


def without_surfaces(arrays: ModelArrays) -> ModelArrays:
    """Arrays of a model whose covers of meshes are solids; the model itself where it has none."""
    if not arrays.surfaces.shape[0]:
        return arrays
    robot, scene = arrays.robot.copy(), arrays.scene.copy()
    robot[:, NODE : ANCHOR_STOP + 1] = 0.0
    scene[:, NODE : ANCHOR_STOP + 1] = 0.0
    return arrays._replace(robot=robot, scene=scene)


class Work(NamedTuple):
    """Scratch of a descent (m rows, k pairs), and its ``pace``, shape (4,)."""

    rows: RowWork
    pairs: Indices
    distances: Array
    gradients: Array
    A: Array
    b: Array
    slope: Array
    J: Array
    pace: Array


@kernel
def make_work(model: ModelArrays | None, goal: Goal) -> Work:
    """Room for a descent."""
    n = goal.lower.shape[0]
    k = 0 if model is None else _MAX_NEAR_PAIRS
    m = max(goal.hard.shape[0], goal.soft.shape[0])
    rows = 6 * goal.hard.shape[0] + 2 * n + k
    return Work(
        RowWork(np.empty((n, 4, 4)), np.empty((3, 3)), np.empty(m), np.empty(m), np.empty((m, n))),
        np.empty(k, dtype=np.int64),
        np.empty(k),
        np.empty((k, n)),
        np.empty((rows, n)),
        np.empty(rows),
        np.empty(n),
        np.empty((6, n)),
        np.array([math.inf, 0.0, 1.0, LEAST_GAIN]),
    )


@kernel
def linearise(
    model: ModelArrays | None, goal: Goal, q: Array, work: Work
) -> tuple[int, float, float]:
    """Write A dq <= b, all constraints at q to first order.

    Returns:
        The number of rows, the worst violation, and the sum of the squares of all.
    """
    n = q.shape[0]
    work.pace[LEFT] -= 1.0
    evaluate_kernel(goal.chain, goal.hard, q, work.rows)
    A, b = work.A, work.b
    count, worst, total = 0, 0.0, 0.0
    for i in range(goal.hard.shape[0]):
        value, residual = work.rows.values[i], work.rows.residuals[i]
        # The residual's slope is the value's, turned round where the lower bound counts.
        below, above = goal.hard[i, Column.UPPER] - value, value - goal.hard[i, Column.LOWER]
        sign = 1.0 if -below >= -above else -1.0
        for side in (1.0, -1.0):
            room = below if side > 0.0 else above
            if room == math.inf:
                continue
            for j in range(n):
                A[count, j] = side * sign * work.rows.jacobian[i, j]
            b[count] = room
            count += 1
        if residual > 0.0 and sign > 0.0:
            count = _bound_sideways(goal, i, work, count)
        if residual > 0.0:
            worst = max(worst, residual)
            total += residual * residual
    # Where nothing is there to collide with, the compiler leaves this out.
    if model is not None:
        # Pairs more than 4 cm apart do not shape a step.
        near = near_pairs(model, q, 0.04, work.pairs, work.distances, work.gradients)
        for i in range(min(near, _MAX_NEAR_PAIRS)):
            for j in range(n):
                A[count, j] = -work.gradients[i, j]
            b[count] = work.distances[i]
            count += 1
            if work.distances[i] < 0.0:
                worst = max(worst, -work.distances[i])
                total += work.distances[i] ** 2
    for j in range(n):
        for side in (1.0, -1.0):
            room = goal.upper[j] - q[j] if side > 0.0 else q[j] - goal.lower[j]
            if room < math.inf:
                for k in range(n):
                    A[count, k] = side if k == j else 0.0
                b[count] = max(room, 0.0)
                count += 1
    return count, worst, total


@kernel(allocates=False)
def _bound_sideways(goal: Goal, i: int, work: Work, count: int) -> int:
    """Add the bounds across a violated distance or angle; the number of rows."""
    for second in (False, True):
        bound, linear, angular = sideways_kernel(work.rows.frames, goal.hard[i], second)
        if bound == math.inf:
            continue
        covector_kernel(goal.chain, work.rows.frames, goal.hard[i], linear, angular, work.A[count])
        for j in range(work.A.shape[1]):
            work.A[count + 1, j] = -work.A[count, j]
        work.b[count], work.b[count + 1] = bound, bound
        count += 2
    return count


@kernel
def objective_kernel(goal: Goal, q: Array, work: Work) -> float:
    """Objective |q - posture|^2 / 2 in the metric, or - log w, plus the soft rows."""
    value = 0.0
    for j in range(q.shape[0]):
        value += 0.5 * goal.metric[j] * (q[j] - goal.posture[j]) ** 2
    if goal.link > -2:
        value -= log_manipulability(goal, q, work.J)
    if goal.soft.shape[0] > 0:
        evaluate_kernel(goal.chain, goal.soft, q, work.rows)
        for i in range(goal.soft.shape[0]):
            value += 0.5 * goal.weights[i] * max(work.rows.residuals[i], 0.0) ** 2
    return value


@kernel
def log_manipulability(goal: Goal, q: Array, J: Array) -> float:
    """The logarithm of sqrt(det(J J^T)), of J^T J where the arm has fewer than six joints."""
    n = q.shape[0]
    frame_and_jacobian_kernel(goal.chain, q, goal.link, J)
    size = min(6, n)
    G = np.zeros((size, size))
    for i in range(size):
        for k in range(size):
            if n >= 6:
                for j in range(n):
                    G[i, k] += J[i, j] * J[k, j]
            else:
                for j in range(6):
                    G[i, k] += J[j, i] * J[j, k]
        G[i, i] += 1e-12
    return 0.5 * math.log(max(np.linalg.det(G), 1e-300))


@kernel
def slope_kernel(goal: Goal, q: Array, work: Work, H: Array) -> None:
    """Write the objective's slope into ``work.slope`` and its Gauss-Newton matrix into H."""
    n = q.shape[0]
    H[:] = 0.0
    for j in range(n):
        H[j, j] = max(goal.metric[j], 1e-2)
        work.slope[j] = goal.metric[j] * (q[j] - goal.posture[j])
    # Step of the finite difference that the slope of the manipulability is taken by [rad or m].
    difference = 1e-5
    if goal.link > -2:
        here = log_manipulability(goal, q, work.J)
        for j in range(n):
            H[j, j] = 1.0
            kept = q[j]
            q[j] = kept + difference
            work.slope[j] -= (log_manipulability(goal, q, work.J) - here) / difference
            q[j] = kept
    if goal.soft.shape[0] > 0:
        evaluate_kernel(goal.chain, goal.soft, q, work.rows)
        for i in range(goal.soft.shape[0]):
            residual = work.rows.residuals[i]
            if residual <= 0.0:
                continue
            for j in range(n):
                a = goal.weights[i] * work.rows.jacobian[i, j]
                work.slope[j] += a * residual
                for k in range(n):
                    H[j, k] += a * work.rows.jacobian[i, k]
