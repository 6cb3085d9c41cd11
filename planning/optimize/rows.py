"""Linear rows in the unknowns z = (control points, duration T, slack s).

Limits hold by the control points of the derivatives, |D_r P| <= limit_r T^r. T^r lies above its
tangent, so the tangent in its place keeps the rows linear and on the safe side. What is not linear
in the control points (distances, torques, constraints) is linearised at places along the motion,
and may be violated by the slack s >= 0 that all of them share.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse

from kinematics.arrays import Array, Indices
from kinematics.caches.bounded_cache import bounded_cache
from planning.optimize.iterate import Iterate
from planning.optimize.spline import SplineSpace
from planning.optimize.task import End, Task

#: Its stubs know no stacks of sparse and dense matrices.
sparse: Any = scipy.sparse


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """lower <= A z <= upper.

    Args:
        A: Sparse, R x (N n + 2).
        lower: Shape (R,).
        upper: Shape (R,).
    """

    A: Any
    lower: Array
    upper: Array

    @classmethod
    def below(cls, A: Any, upper: Array) -> "Rows":
        """A z <= upper."""
        return cls(A, np.full(len(upper), -np.inf), upper)


def stack_rows(blocks: Sequence[Rows]) -> Rows:
    """All rows of several blocks."""
    return Rows(
        sparse.vstack([block.A for block in blocks], format="csc"),
        np.concatenate([block.lower for block in blocks]),
        np.concatenate([block.upper for block in blocks]),
    )


def limit_rows(task: Task, iterate: Iterate, hair: float) -> list[Rows]:
    """The limits of velocity, acceleration and jerk, ``hair`` (a share) below what is allowed."""
    blocks, T = [], iterate.duration
    for order, limits in task.orders.items():
        D = _scaled_differences(iterate.space, order, tuple(limits.tolist()))
        # Divided by the limit and T^r: |D P / T^r| - r T'/T <= 1 - r.
        count, power = D.shape[0], T**order
        time = np.full((count, 1), -order / T * (1.0 - hair))
        upper = np.full(count, (1.0 - order) * (1.0 - hair))
        none = np.zeros((count, 1))
        for sign in (1.0, -1.0):
            A = sparse.hstack([sign / power * D, time, none])
            blocks.append(Rows.below(A, upper))
    return blocks


@bounded_cache(maxsize=32)
def _scaled_differences(space: SplineSpace, order: int, limits: tuple[float, ...]) -> Any:
    D = sparse.csr_matrix(space.differences[order - 1])
    return sparse.kron(D, sparse.diags(1.0 / np.array(limits)), format="csr")


def end_rows(iterate: Iterate, start: End, end: End) -> list[Rows]:
    """Velocity and acceleration at ends that are not at rest, D_r P = value T^r linearised."""
    blocks = []
    for place, given in ((0, start), (-1, end)):
        if given.still:
            continue
        for order, value in enumerate(given.derivatives[1:], start=1):
            blocks.append(_end_row(iterate, place, order, value))
    return blocks


def _end_row(iterate: Iterate, place: int, order: int, value: Array) -> Rows:
    n, T = iterate.points.shape[1], iterate.duration
    D = sparse.csr_matrix(iterate.space.differences[order - 1][[place]] / T**order)
    A = sparse.hstack(
        [sparse.kron(D, sparse.identity(n)), -(order / T * value)[:, None], np.zeros((n, 1))]
    )
    known = (1.0 - order) * value
    return Rows(A, known, known)


def local_matrix(
    iterate: Iterate,
    places: Array,
    gradients: Sequence[Array],
    in_time: Array | None = None,
    in_slack: float = 0.0,
) -> Any:
    """Derivatives  sum_r g_r . (B_r P) + c T + k s  of what is looked at along the motion.

    Args:
        iterate: Iterate at which it is linearised.
        places: u of each row, shape (R,).
        gradients: Gradients with respect to q, dq/du, d2q/du2 as far as they count, shape (R, n)
            each.
        in_time: c, shape (R,).
        in_slack: k.

    Returns:
        Sparse, R x (N n + 2).
    """
    space, (N, n), R = iterate.space, iterate.points.shape, len(places)
    width = (space.degree + 1) * n
    values = np.zeros((R, space.degree + 1, n))
    first: Indices = np.zeros(R, dtype=np.int64)
    for order, g in enumerate(gradients):
        first, basis = space.basis(places, order)
        values += basis[:, :, None] * g[:, None, :]
    columns = first[:, None] * n + np.arange(width)
    time = np.zeros(R) if in_time is None else in_time
    entries = np.column_stack([values.reshape(R, width), time, np.full(R, in_slack)])
    columns = np.column_stack([columns, np.broadcast_to([N * n, N * n + 1], (R, 2))])
    starts = np.arange(R + 1) * (width + 2)
    shape = (R, N * n + 2)
    return sparse.csr_matrix((entries.ravel(), columns.ravel(), starts), shape=shape)
