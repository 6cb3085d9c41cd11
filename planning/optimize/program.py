"""A round of optimisation as a nonlinear program for IPOPT: built once, given numbers again.

    minimise  1/2 z' H z + g' z   over z = (control points P, duration T, slack s)
    with      |D_r P|_ij <= (1 - hair) limit_j T^r,   lower <= W z <= upper,   least <= z <= most

Limits keep their powers of T, of which the convex problem has the tangents. A linear row touches
the control points of one piece of the spline alone, so each piece has room for so many rows of its
own, and W is a parameter: the program depends on the sizes and on H's pattern, not on numbers.
Source: "On the implementation of an interior-point filter line-search algorithm for large-scale
nonlinear programming", Mathematical Programming, 2006.
"""

from typing import Any

import casadi
import numpy as np
import scipy.sparse

from kinematics.arrays import Array, Indices
from kinematics.caches.bounded_cache import bounded_cache
from planning.optimize.linearization import Rows
from planning.optimize.quadratic import Quadratic
from planning.optimize.spline import SplineSpace

#: Its stubs know no indices of sparse matrices.
sparse: Any = scipy.sparse

#: Rows of a piece come in multiples of this, so that programs can be used again.
_ROOM = 32
_OPTIONS: dict[str, Any] = {
    "print_time": False,
    "error_on_fail": False,
    "ipopt": {"print_level": 0, "sb": "yes", "max_iter": 100, "tol": 1e-6},
}


def solve(
    space: SplineSpace, limits: dict[int, Array], rows: Rows, quadratic: Quadratic, start: Array
) -> Array | None:
    """The unknowns (N n + 2,) where IPOPT ends; None where they do not keep the rows.

    Args:
        space: Space of the splines.
        limits: Limits of the spline's derivatives by order, shape (n,) each.
        rows: All others.
        quadratic: Objective and bounds of the unknowns; its rows do not count.
        start: The unknowns to begin with.
    """
    n = len(next(iter(limits.values())))
    H = sparse.csc_matrix(quadratic.H)
    H.sort_indices()
    piece, slot = _places(space, rows.A, n)
    room = _ROOM * (1 + int(slot.max(initial=0)) // _ROOM)
    pattern = (tuple(H.indptr.tolist()), tuple(H.indices.tolist()))
    solver = _program(space, n, tuple(limits), room, pattern)
    W, lower, upper = _pack_rows(space, rows, n, (piece, slot, room))
    shares = np.concatenate(list(limits.values()))
    held = 2 * n * sum(space.count - order for order in limits)
    answer = solver(
        x0=start,
        p=np.concatenate([H.data, quadratic.g, shares, W]),
        lbx=quadratic.least,
        ubx=quadratic.most,
        lbg=np.concatenate([np.full(held, -np.inf), lower]),
        ubg=np.concatenate([np.zeros(held), upper]),
    )
    z = np.array(answer["x"]).ravel()
    loose = Quadratic(
        quadratic.H, quadratic.g, rows.A, rows.lower, rows.upper, quadratic.least, quadratic.most
    )
    return z if loose.satisfies(z) else None


def _places(space: SplineSpace, A: Any, n: int) -> tuple[Indices, Indices]:
    """The piece whose control points each row of A touches, and its number among those."""
    rows = sparse.csr_matrix(A)
    rows.sort_indices()
    filled = np.diff(rows.indptr) > 0
    first = np.zeros(rows.shape[0], dtype=np.int64)
    first[filled] = rows.indices[rows.indptr[:-1][filled]] // n
    piece = np.where(first >= space.count, 0, np.minimum(first, space.pieces - 1))
    slot = np.zeros(len(piece), dtype=np.int64)
    for k in range(space.pieces):
        own = np.flatnonzero(piece == k)
        slot[own] = np.arange(len(own))
    return piece, slot


def _pack_rows(
    space: SplineSpace, rows: Rows, n: int, places: tuple[Indices, Indices, int]
) -> tuple[Array, Array, Array]:
    """W of all pieces, column by column, and the bounds of their rows."""
    piece, slot, room = places
    width, size = (space.degree + 1) * n, space.count * n
    W = np.zeros((space.pieces, width + 2, room))
    entries = sparse.coo_matrix(rows.A)
    at, column = entries.row, entries.col
    local = np.where(column < size, column - n * piece[at], width + column - size)
    W[piece[at], local, slot[at]] = entries.data
    lower = np.full((space.pieces, room), -np.inf)
    upper = np.full((space.pieces, room), np.inf)
    lower[piece, slot], upper[piece, slot] = rows.lower, rows.upper
    return W.ravel(), lower.ravel(), upper.ravel()


@bounded_cache(maxsize=16)
def _program(
    space: SplineSpace,
    n: int,
    orders: tuple[int, ...],
    room: int,
    pattern: tuple[tuple[int, ...], tuple[int, ...]],
) -> Any:
    size, width = space.count * n, (space.degree + 1) * n
    z = casadi.MX.sym("z", size + 2)
    P, T = casadi.reshape(z[:size], n, space.count).T, z[size]
    data = casadi.MX.sym("H", len(pattern[1]))
    H = casadi.MX(casadi.Sparsity(size + 2, size + 2, *pattern), data)
    g = casadi.MX.sym("g", size + 2)
    shares = casadi.MX.sym("limits", n * len(orders))
    W = casadi.MX.sym("W", (width + 2) * room * space.pieces)
    held = []
    for i, order in enumerate(orders):
        rate = casadi.mtimes(casadi.sparsify(casadi.DM(space.differences[order - 1])), P)
        rate = casadi.vec(rate / casadi.repmat(shares[n * i : n * (i + 1)].T, rate.shape[0], 1))
        held += [rate - T**order, -rate - T**order]
    for k in range(space.pieces):
        own = casadi.reshape(W[k * (width + 2) * room : (k + 1) * (width + 2) * room], room, -1)
        held.append(casadi.mtimes(own, casadi.vertcat(z[n * k : n * k + width], z[size:])))
    problem: dict[str, Any] = {
        "x": z,
        "p": casadi.vertcat(data, g, shares, W),
        "f": 0.5 * casadi.bilin(H, z, z) + casadi.dot(g, z),
        "g": casadi.vertcat(*held),
    }
    return casadi.nlpsol("motion", "ipopt", problem, _OPTIONS)
