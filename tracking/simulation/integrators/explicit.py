"""One step of the explicit Runge-Kutta method of order 8 of Dormand and Prince, with dense output.

"Solving Ordinary Differential Equations I", section II.5, with the error estimate and the test for
stiffness of its code DOP853; the coefficients are those of ``scipy.integrate.DOP853``.
"""

from typing import NamedTuple

import numpy as np
from scipy.integrate import DOP853

from compiled.kernel import kernel
from kinematics.arrays import Array
from tracking.simulation.loop import Loop, rate_kernel

_A = np.ascontiguousarray(DOP853.A, dtype=np.float64)
_B = np.ascontiguousarray(DOP853.B, dtype=np.float64)
_C = np.ascontiguousarray(DOP853.C, dtype=np.float64)
_E3 = np.ascontiguousarray(DOP853.E3, dtype=np.float64)
_E5 = np.ascontiguousarray(DOP853.E5, dtype=np.float64)
_D = np.ascontiguousarray(DOP853.D, dtype=np.float64)
_A_EXTRA = np.ascontiguousarray(DOP853.A_EXTRA, dtype=np.float64)
_C_EXTRA = np.ascontiguousarray(DOP853.C_EXTRA, dtype=np.float64)
STAGES = 12
#: Stages with those of the dense output.
ALL_STAGES = 16
#: Polynomials of the dense output.
POWERS = 7
#: |h lambda| beyond which the method is not stable along the real axis.
STABILITY = 6.1


class Steps(NamedTuple):
    """Scratch of the explicit method for N states.

    Args:
        K: Derivatives at the stages, shape (16, N).
        F: Dense output, shape (7, N).
        trial: Shape (N,).
    """

    K: Array
    F: Array
    trial: Array


@kernel(inline="always")
def explicit_step(
    loop: Loop, steps: Steps, t: float, h: float, x: Array, tolerances: Array, end: Array
) -> tuple[float, float]:
    """Step from x (N,) at t over h into ``end`` (N,); ``steps.K[0]`` is the derivative at x.

    ``tolerances`` (2,) are relative and absolute.

    Returns:
        The error in units of what is allowed (NaN where the step left all bounds), and an estimate
        of |h lambda|.
    """
    N, K, trial = x.shape[0], steps.K, steps.trial
    for s in range(1, STAGES):
        for i in range(N):
            step = 0.0
            for k in range(s):
                step += _A[s, k] * K[k, i]
            trial[i] = x[i] + h * step
        rate_kernel(loop, t + _C[s] * h, trial, K[s])
    for i in range(N):
        step = 0.0
        for k in range(STAGES):
            step += _B[k] * K[k, i]
        end[i] = x[i] + h * step
    rate_kernel(loop, t + h, end, K[STAGES])
    fifth, third, change, distance = 0.0, 0.0, 0.0, 0.0
    for i in range(N):
        scale = tolerances[1] + tolerances[0] * max(abs(x[i]), abs(end[i]))
        e5, e3 = 0.0, 0.0
        for k in range(STAGES + 1):
            e5 += _E5[k] * K[k, i]
            e3 += _E3[k] * K[k, i]
        fifth += (e5 / scale) ** 2
        third += (e3 / scale) ** 2
        change += (K[STAGES, i] - K[STAGES - 1, i]) ** 2
        distance += (end[i] - trial[i]) ** 2
    stiffness = h * np.sqrt(change / distance) if distance > 0.0 else 0.0
    if fifth == 0.0 and third == 0.0:
        return 0.0, stiffness
    return h * fifth / np.sqrt((fifth + 0.01 * third) * N), stiffness


@kernel(inline="always")
def explicit_dense(loop: Loop, steps: Steps, t: float, h: float, x: Array, end: Array) -> None:
    """Make the dense output of the step just made, at the cost of three more evaluations."""
    N, K, F = x.shape[0], steps.K, steps.F
    for s in range(STAGES + 1, ALL_STAGES):
        row = s - STAGES - 1
        for i in range(N):
            step = 0.0
            for k in range(s):
                step += _A_EXTRA[row, k] * K[k, i]
            steps.trial[i] = x[i] + h * step
        rate_kernel(loop, t + _C_EXTRA[row] * h, steps.trial, K[s])
    for i in range(N):
        step = end[i] - x[i]
        F[0, i] = step
        F[1, i] = h * K[0, i] - step
        F[2, i] = 2.0 * step - h * (K[STAGES, i] + K[0, i])
        for k in range(4):
            d = 0.0
            for s in range(ALL_STAGES):
                d += _D[k, s] * K[s, i]
            F[3 + k, i] = h * d


@kernel
def explicit_polynomials(F: Array, x: Array, out: Array) -> None:
    """Write the dense output as powers of the part of the step that has passed into out (k, 8).

    Args:
        F: The dense output, shape (7, N).
        x: State at the start of the step, shape (N,).
        out: Coefficients of the first k states.
    """
    for i in range(out.shape[0]):
        c = out[i]
        for k in range(c.shape[0]):
            c[k] = 0.0
        for k in range(POWERS):
            c[0] += F[POWERS - 1 - k, i]
            # Times u or, for every second polynomial, 1 - u.
            for j in range(POWERS, 0, -1):
                c[j] = c[j - 1] if k % 2 == 0 else c[j] - c[j - 1]
            if k % 2 == 0:
                c[0] = 0.0
        c[0] += x[i]
