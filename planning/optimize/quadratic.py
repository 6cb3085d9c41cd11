"""Convex quadratic problems, solved by an interior-point method through CasADi.

    minimise  1/2 z' H z + g' z   subject to   lower <= A z <= upper,  least <= z <= most

The solver is PIQP, a proximal interior-point method for sparse problems: it needs about as many
steps whatever the numbers are, and gives the same bytes for the same problem.
Source: "PIQP: a proximal interior-point quadratic programming solver", 2023.
"""

from dataclasses import dataclass
from typing import Any

import casadi
import numpy as np
from scipy import sparse

from kinematics.arrays import Array


@dataclass(frozen=True, slots=True, eq=False)
class Quadratic:
    """A convex quadratic problem in N unknowns with R rows.

    Args:
        H: Hessian, positive semidefinite, N x N.
        g: Gradient at 0, shape (N,).
        A: Rows, R x N.
        lower: Shape (R,), -inf where there is none.
        upper: Shape (R,), inf where there is none.
        least: Lower bounds of the unknowns, shape (N,).
        most: Upper bounds of the unknowns, shape (N,).
    """

    H: Any
    g: Array
    A: Any
    lower: Array
    upper: Array
    least: Array
    most: Array

    def solve(self) -> Array | None:
        """The unknowns (N,) of the least value; None where the solver found none."""
        H, A = _columns(self.H), _columns(self.A)
        options = {"error_on_fail": False}
        solver: Any = casadi.conic(
            "quadratic", "piqp", {"h": _pattern(H), "a": _pattern(A)}, options
        )
        z = np.full(len(self.g), np.nan)
        buffer, run = solver.buffer()
        given = (H.data, self.g, A.data, self.lower, self.upper, self.least, self.most)
        held = [np.ascontiguousarray(values, dtype=np.float64) for values in given]
        for i, values in enumerate(held):
            buffer.set_arg(i, values.data)
        buffer.set_res(0, z.data)
        try:
            run()
        except RuntimeError:
            return None
        return z if self.satisfies(z) else None

    def value(self, z: Array) -> float:
        """1/2 z' H z + g' z."""
        return float(0.5 * (z @ (self.H @ z)) + self.g @ z)

    def satisfies(self, z: Array) -> bool:
        """Whether a point keeps the constraints: a solver that gave up leaves one that does not."""
        if not np.isfinite(z).all():
            return False
        rows = self.A @ z
        # How far off constraints a solution may be, in their own (relative) units.
        tolerance = 1e-6
        scale = tolerance * (1.0 + np.abs(rows))
        within = (rows >= self.lower - scale) & (rows <= self.upper + scale)
        size = tolerance * (1.0 + np.abs(z))
        inside = (z >= self.least - size) & (z <= self.most + size)
        return bool(within.all() and inside.all())


def _columns(matrix: Any) -> Any:
    packed = sparse.csc_matrix(matrix)
    packed.sort_indices()
    return packed


def _pattern(matrix: Any) -> Any:
    rows, columns = matrix.shape
    return casadi.Sparsity(rows, columns, matrix.indptr.tolist(), matrix.indices.tolist())
