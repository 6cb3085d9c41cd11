"""Global error of the integrator: its local errors, carried along the linearised closed loop.

The error e of a computed state obeys e' = J e to first order, with J the Jacobian of the loop: a
stable loop forgets errors, an unstable one multiplies them. An error estimate of a step is a
weighted root mean square, so that the errors that it allows fill an ellipsoid x^T P^-1 x <= 1. Over
a step P becomes Phi P Phi^T, and the step's own ellipsoid L is added:

    P <- (1 + 1/p) P + (1 + p) L,    p = sqrt(tr P / tr L),

the smallest ellipsoid of this family that holds the sums. |e_i| <= sqrt(P_ii).

A torque that is held from one call of the controller to the next depends on the error at the call:
e' = J e + F e(call). What holds until the next call is kept as a map Psi of the error at the call.
Source: "Ellipsoidal calculus for estimation and control".
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import kernel
from compiled.linear_solve import lu_factor_kernel, lu_solve_kernel
from kinematics.arrays import Array
from tracking.simulation.loop import (
    DIFFERENCE,
    EVALUATIONS,
    HELD,
    Loop,
    command_kernel,
    jacobian_kernel,
    rate_kernel,
)

#: Rounding of a step, as part of the state.
ROUNDING = 1e-15
#: Allowance for terms of second order and for what a Jacobian in the middle of a step misses.
_ALLOWANCE = 2.0
#: An error beyond this [rad or m] is not known any more.
LOST = 10.0
#: Most parts of a step: beyond, parts decay so fast that their errors are overestimated.
_MOST_PARTS = 64


class ErrorCarrier(NamedTuple):
    """Errors of a run on their way, N states, with scratch.

    Args:
        is_kept: Whether errors are carried at all; the arrays are of one state otherwise.
        P: Ellipsoid of the error at the last call of the controller, shape (N, N).
        Psi: Map of that error to the error now, shape (N, N).
        D: Ellipsoid of what came since, shape (N, N).
        J: Jacobian of the loop, shape (N, N).
        feedback: F, what the error at the call adds to e', shape (N, N); 0 for continuous loops.
        work: Scratch, shape (3, N, N).
        vectors: Scratch, shape (4, N).
        command: Scratch, shape (2, n + b).
        pivots: Scratch, shape (N,).
    """

    is_kept: bool
    P: Array
    Psi: Array
    D: Array
    J: Array
    feedback: Array
    work: Array
    vectors: Array
    command: Array
    pivots: NDArray[np.int64]


def error_carrier(N: int, commands: int, *, is_kept: bool) -> ErrorCarrier:
    """A carrier of errors for N states and so many numbers of a command; nothing is off yet."""
    size = N if is_kept else 1
    square = (size, size)
    return ErrorCarrier(
        is_kept,
        np.zeros(square),
        np.eye(size),
        np.zeros(square),
        np.zeros(square),
        np.zeros(square),
        np.zeros((3, *square)),
        np.zeros((4, size)),
        np.zeros((2, commands)),
        np.zeros(size, dtype=np.int64),
    )


@kernel(allocates=False)
def multiply(A: Array, B: Array, out: Array) -> None:
    """Write the product A B of square matrices (N, N) into out (N, N)."""
    N = A.shape[0]
    for i in range(N):
        for j in range(N):
            out[i, j] = 0.0
        for k in range(N):
            a = A[i, k]
            if a != 0.0:
                for j in range(N):
                    out[i, j] += a * B[k, j]


@kernel(allocates=False)
def map_ellipsoid(A: Array, P: Array, work: Array) -> None:
    """Replace P (N, N) by A P A^T; ``work`` is (N, N)."""
    N = P.shape[0]
    multiply(A, P, work)
    for i in range(N):
        for j in range(N):
            s = 0.0
            for k in range(N):
                s += work[i, k] * A[j, k]
            P[i, j] = s


@kernel(allocates=False)
def add_ellipsoid(P: Array, L: Array, weights: Array) -> None:
    """Replace P (N, N) by an ellipsoid that holds all sums of points of P and of L (N, N).

    ``weights`` (N,) are the squares of the reciprocal units of the states, for the traces.
    """
    N = P.shape[0]
    old, new = 0.0, 0.0
    for i in range(N):
        old += weights[i] * P[i, i]
        new += weights[i] * L[i, i]
    if new <= 0.0:
        return
    p = np.sqrt(old / new)
    for i in range(N):
        for j in range(N):
            P[i, j] = L[i, j] * (1.0 + p) + (P[i, j] * (1.0 + 1.0 / p) if p > 0.0 else 0.0)


@kernel(allocates=False)
def set_jacobian(loop: Loop, carrier: ErrorCarrier, t: float, x: Array) -> float:
    """Write the Jacobian of the rate at x (N,) into ``carrier.J``.

    Returns:
        How fast the loop is [1/s]: the root of its largest row sum, or its largest diagonal entry.
    """
    N = x.shape[0]
    base = carrier.vectors[2]
    rate_kernel(loop, t, x, base)
    jacobian_kernel(loop, t, x, base, carrier.vectors, carrier.J)
    speed = 0.0
    for i in range(N):
        row = 0.0
        for j in range(N):
            row += abs(carrier.J[i, j])
        speed = max(speed, np.sqrt(row), abs(carrier.J[i, i]))
    return speed


@kernel(allocates=False)
def begin_call(loop: Loop, carrier: ErrorCarrier, t: float, x: Array, weights: Array) -> None:
    """Carry on from a call of a held controller at state x (N,).

    Write what an error of the state at the call adds to the rate until the next one.
    """
    evaluations = loop.flags[EVALUATIONS]
    _merge(carrier, weights)
    N, n = x.shape[0], loop.limit.shape[0]
    trial, rate, base = carrier.vectors[0], carrier.vectors[1], carrier.vectors[2]
    wanted, moved = carrier.command[0], carrier.command[1]
    gains, drive = carrier.work[0], carrier.work[1]
    command_kernel(loop, t, x, wanted)
    for i in range(N):
        trial[i] = x[i]
    for j in range(N):
        trial[j] = x[j] + DIFFERENCE * max(1.0, abs(x[j]))
        step = trial[j] - x[j]
        command_kernel(loop, t, trial, moved)
        trial[j] = x[j]
        for i in range(N):
            # The command has n + b numbers, the state 2 n + b: rows from n on.
            gains[i, j] = (moved[i - n] - wanted[i - n]) / step if i >= n else 0.0
    rate_kernel(loop, t, x, base)
    for k in range(N):
        for i in range(N):
            drive[i, k] = 1.0 if i == k and i >= 2 * n else 0.0
    for k in range(n):
        torque = loop.command[k]
        loop.command[k] = torque + max(1.0, abs(torque)) * DIFFERENCE
        step = loop.command[k] - torque
        rate_kernel(loop, t, x, rate)
        loop.command[k] = torque
        for i in range(n, 2 * n):
            drive[i, n + k] = (rate[i] - base[i]) / step
    # The first n torques drive the velocities; what follows is the rate of the estimate itself.
    multiply(drive, gains, carrier.feedback)
    # As it was: ``asked`` tells what is saturated.
    command_kernel(loop, t, x, wanted)
    loop.flags[EVALUATIONS] = evaluations


@kernel
def _merge(carrier: ErrorCarrier, weights: Array) -> None:
    """Make the error now the one that is carried on."""
    N = carrier.P.shape[0]
    map_ellipsoid(carrier.Psi, carrier.P, carrier.work[0])
    add_ellipsoid(carrier.P, carrier.D, weights)
    for i in range(N):
        for j in range(N):
            carrier.D[i, j] = 0.0
            carrier.Psi[i, j] = 1.0 if i == j else 0.0


@kernel(allocates=False)
def _advance(carrier: ErrorCarrier, h: float, parts: int, X: Array, is_driven: bool) -> bool:
    """Carry the columns of X (N, N) over a step h in so many parts, by a Padé approximation.

    X' = J X, or J X + F where the controller's call drives it.

    Returns:
        Whether the system could be solved.
    """
    N, part = X.shape[0], h / parts
    J, square, below = carrier.J, carrier.work[0], carrier.work[1]
    multiply(J, J, square)
    for i in range(N):
        for j in range(N):
            z, one = 0.5 * part * J[i, j], 1.0 if i == j else 0.0
            second = part * part / 12.0 * square[i, j]
            square[i, j] = one + z + second
            below[i, j] = one - z + second
    if not lu_factor_kernel(below, carrier.pivots, 0.0):
        return False
    right = carrier.work[2]
    for _ in range(parts):
        multiply(square, X, right)
        for j in range(N):
            column = carrier.vectors[3]
            for i in range(N):
                column[i] = right[i, j]
                if is_driven:
                    column[i] += part * carrier.feedback[i, j]
            lu_solve_kernel(below, carrier.pivots, column)
            for i in range(N):
                X[i, j] = column[i]
    return True


@kernel
def carry_errors(
    loop: Loop,
    carrier: ErrorCarrier,
    t: float,
    h: float,
    middle: Array,
    allowed: Array,
    weights: Array,
    largest: Array,
) -> None:
    """Carry errors over an accepted step and add the step's own.

    Args:
        loop: The loop.
        carrier: Errors at the start of the step.
        t: Begin of the step [s].
        h: Length of the step [s].
        middle: State in the middle of the step, shape (N,).
        allowed: Half axes of the ellipsoid of the step's own errors, shape (N,).
        weights: Squares of the reciprocal units of the states, shape (N,).
        largest: Raised to the largest |e| of positions and velocities so far, shape (2, n).
    """
    N, n = middle.shape[0], largest.shape[1]
    is_held = loop.flags[HELD] != 0
    evaluations = loop.flags[EVALUATIONS]
    speed = set_jacobian(loop, carrier, t + 0.5 * h, middle)
    loop.flags[EVALUATIONS] = evaluations
    parts = min(_MOST_PARTS, max(1, int(np.ceil(2.0 * h * speed)))) if np.isfinite(speed) else 1
    is_known = _advance(carrier, h, parts, carrier.Psi, is_held)
    if is_held:
        since = 0.0
        for i in range(N):
            since += carrier.D[i, i]
        if since > 0.0:
            Phi = np.eye(N)
            is_known = is_known and _advance(carrier, h, parts, Phi, False)
            map_ellipsoid(Phi, carrier.D, carrier.work[0])
    added = carrier.work[2]
    for i in range(N):
        for j in range(N):
            added[i, j] = allowed[i] ** 2 if i == j else 0.0
    add_ellipsoid(carrier.D, added, weights)
    if not is_held:
        _merge(carrier, weights)
    now = carrier.work[1]
    for i in range(N):
        for j in range(N):
            now[i, j] = carrier.P[i, j]
    if is_held:
        map_ellipsoid(carrier.Psi, now, carrier.work[0])
    for i in range(2 * n):
        size = _ALLOWANCE * (np.sqrt(max(now[i, i], 0.0)) + np.sqrt(max(carrier.D[i, i], 0.0)))
        if not (is_known and size < LOST):
            size = LOST
        largest[i // n, i % n] = max(largest[i // n, i % n], size)
