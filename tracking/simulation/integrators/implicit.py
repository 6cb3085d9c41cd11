"""One step of the implicit Runge-Kutta method Radau IIA of order 5, for stiff closed loops.

"Solving Ordinary Differential Equations II", section IV.8: collocation at three points, solved by
simplified Newton iterations that are split by the eigenvalues of the method into one real and one
complex linear system.

``implicit_step`` takes the point that it starts from as three arguments: with a tuple of them a
stiff simulation took 1.03 times as long.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import kernel
from compiled.linear_solve import Complex, lu_factor_kernel, lu_solve_kernel
from kinematics.arrays import Array
from tracking.simulation.loop import Loop, rate_kernel

_ROOT6 = np.sqrt(6.0)
#: Where the stages lie: the zeros of the right Radau polynomial.
_NODES = np.array([(4.0 - _ROOT6) / 10.0, (4.0 + _ROOT6) / 10.0, 1.0])


def _collocation() -> Array:
    """The matrix of the method: a_ij is the integral of Lagrange polynomial j from 0 to node i."""
    powers = np.arange(1.0, 4.0)
    integrals = _NODES[:, None] ** powers / powers
    return np.asarray(integrals @ np.linalg.inv(_NODES[:, None] ** (powers - 1.0)))


def _decomposition() -> tuple[float, complex, Array, Array]:
    """Real and complex eigenvalue of the inverse, and the real matrices that split it."""
    values, vectors = np.linalg.eig(np.linalg.inv(_collocation()))
    real = int(np.argmin(np.abs(values.imag)))
    pair = int(np.argmax(values.imag))
    T = np.column_stack([vectors[:, real].real, vectors[:, pair].real, vectors[:, pair].imag])
    return float(values[real].real), complex(values[pair].conjugate()), T, np.linalg.inv(T)


_REAL, _COMPLEX, _T, _T_INVERSE = _decomposition()
#: Of the embedded formula of order 3, in terms of the stages.
_ERROR = np.array([-13.0 - 7.0 * _ROOT6, -13.0 + 7.0 * _ROOT6, -1.0]) / 3.0
_ITERATIONS = 7
#: Newton is done when what is left is this part of the tolerance, or rounding error.
_NEWTON = 0.01


class Stages(NamedTuple):
    """Scratch of the implicit method for N states.

    Args:
        J: Jacobian of the derivative, shape (N, N).
        real: Real matrix, overwritten by its factors, shape (N, N).
        complex: Complex matrix, overwritten by its factors, shape (N, N).
        pivots: Rows exchanged in each, shape (2, N).
        Z: Stages less the state, shape (3, N).
        W: W in split form, shape (3, N).
        F: Derivatives at the stages, shape (3, N).
        vectors: Shape (3, N).
        right: Complex right-hand side, shape (N,).
    """

    J: Array
    real: Array
    complex: Complex
    pivots: NDArray[np.int64]
    Z: Array
    W: Array
    F: Array
    vectors: Array
    right: Complex


def stages(N: int) -> Stages:
    """Scratch for N states."""
    return Stages(
        np.zeros((N, N)),
        np.zeros((N, N)),
        np.zeros((N, N), dtype=np.complex128),
        np.zeros((2, N), dtype=np.int64),
        np.zeros((3, N)),
        np.zeros((3, N)),
        np.zeros((3, N)),
        np.zeros((3, N)),
        np.zeros(N, dtype=np.complex128),
    )


@kernel(allocates=False)
def factor_all(stages: Stages, h: float) -> bool:
    """Factor (gamma / h) E - J for both eigenvalues gamma."""
    N = stages.J.shape[0]
    for i in range(N):
        for j in range(N):
            stages.real[i, j] = -stages.J[i, j]
            stages.complex[i, j] = -stages.J[i, j]
        stages.real[i, i] += _REAL / h
        stages.complex[i, i] += _COMPLEX / h
    if not lu_factor_kernel(stages.real, stages.pivots[0], 0.0):
        return False
    return lu_factor_kernel(stages.complex, stages.pivots[1], 0.0)


@kernel(inline="always")
def newton(loop: Loop, stages: Stages, t: float, h: float, x: Array, tolerances: Array) -> bool:
    """Solve for the stages ``stages.Z``; False where the iterations do not converge."""
    N, Z, W, F, S = x.shape[0], stages.Z, stages.W, stages.F, _T_INVERSE
    trial, right = stages.vectors[0], stages.vectors[1]
    for s in range(3):
        for i in range(N):
            Z[s, i], W[s, i] = 0.0, 0.0
    before = 0.0
    for turn in range(_ITERATIONS):
        for s in range(3):
            for i in range(N):
                trial[i] = x[i] + Z[s, i]
            rate_kernel(loop, t + _NODES[s] * h, trial, F[s])
            if not np.isfinite(F[s, 0]):
                return False
        for i in range(N):
            # In the coordinates in which the method falls apart.
            f0 = S[0, 0] * F[0, i] + S[0, 1] * F[1, i] + S[0, 2] * F[2, i]
            f1 = S[1, 0] * F[0, i] + S[1, 1] * F[1, i] + S[1, 2] * F[2, i]
            f2 = S[2, 0] * F[0, i] + S[2, 1] * F[1, i] + S[2, 2] * F[2, i]
            right[i] = f0 - _REAL / h * W[0, i]
            stages.right[i] = complex(f1, f2) - _COMPLEX / h * complex(W[1, i], W[2, i])
        lu_solve_kernel(stages.real, stages.pivots[0], right)
        lu_solve_kernel(stages.complex, stages.pivots[1], stages.right)
        size = 0.0
        for i in range(N):
            scale = tolerances[1] + tolerances[0] * abs(x[i])
            c = stages.right[i]
            size += (right[i] ** 2 + c.real**2 + c.imag**2) / scale**2
            W[0, i] += right[i]
            W[1, i] += c.real
            W[2, i] += c.imag
        size = np.sqrt(size / (3.0 * N))
        for s in range(3):
            for i in range(N):
                Z[s, i] = _T[s, 0] * W[0, i] + _T[s, 1] * W[1, i] + _T[s, 2] * W[2, i]
        if turn > 0:
            ratio = size / before if before > 0.0 else 0.0
            if ratio < 1.0 and ratio / (1.0 - ratio) * size < _NEWTON:
                return True
            left = _ITERATIONS - 1 - turn
            if not ratio < 1.0 or ratio**left / (1.0 - ratio) * size > _NEWTON:
                # Rounding errors of a stiff right-hand side may be all that is left.
                return bool(size < _NEWTON)
        elif size == 0.0:
            return True
        before = size
    return False


@kernel(inline="always")
def implicit_step(
    loop: Loop,
    stages: Stages,
    t: float,
    h: float,
    x: Array,
    f: Array,
    tolerances: Array,
    end: Array,
    is_retry: bool,
) -> float:
    """Step from x (N,) at t over h into ``end`` (N,), with f the derivative at x.

    ``stages`` must hold the factors of ``factor_all`` for this h.

    Returns:
        The error in units of what is allowed; inf where the iterations do not converge.
    """
    N = x.shape[0]
    if not newton(loop, stages, t, h, x, tolerances):
        return np.inf
    error, weighted = stages.vectors[0], stages.vectors[1]
    for i in range(N):
        end[i] = x[i] + stages.Z[2, i]
        weighted[i] = (
            _ERROR[0] * stages.Z[0, i] + _ERROR[1] * stages.Z[1, i] + _ERROR[2] * stages.Z[2, i]
        ) / h
        error[i] = f[i] + weighted[i]
    lu_solve_kernel(stages.real, stages.pivots[0], error)
    size = scaled_error(error, x, end, tolerances)
    if size > 1.0 and is_retry:
        # Of a stiff part the estimate is far too large once: smoothed, it is right.
        trial = stages.vectors[2]
        for i in range(N):
            trial[i] = x[i] + error[i]
        rate_kernel(loop, t, trial, error)
        for i in range(N):
            error[i] += weighted[i]
        lu_solve_kernel(stages.real, stages.pivots[0], error)
        size = scaled_error(error, x, end, tolerances)
    return size


@kernel(allocates=False)
def scaled_error(error: Array, x: Array, end: Array, tolerances: Array) -> float:
    """Root mean square of an error in units of what is allowed."""
    total = 0.0
    for i in range(x.shape[0]):
        scale = tolerances[1] + tolerances[0] * max(abs(x[i]), abs(end[i]))
        total += (error[i] / scale) ** 2
    return float(np.sqrt(total / x.shape[0]))


@kernel(allocates=False)
def implicit_polynomials(stages: Stages, x: Array, out: Array) -> None:
    """Write the collocation polynomial as powers of the part of the step that has passed.

    Args:
        stages: Stages of the step.
        x: State at the start of the step, shape (N,).
        out: Coefficients of all states, shape (N, 8).
    """
    a, b = _NODES[0], _NODES[1]
    A, B, C = a * (a - b) * (a - 1.0), b * (b - a) * (b - 1.0), (1.0 - a) * (1.0 - b)
    Z = stages.Z
    for i in range(out.shape[0]):
        first, second, third = Z[0, i] / A, Z[1, i] / B, Z[2, i] / C
        for k in range(out.shape[1]):
            out[i, k] = 0.0
        out[i, 0] = x[i]
        out[i, 1] = b * first + a * second + a * b * third
        out[i, 2] = -((1.0 + b) * first + (1.0 + a) * second + (a + b) * third)
        out[i, 3] = first + second + third
