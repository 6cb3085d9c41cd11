"""From places, speeds and accelerations along a path to exact polynomials of time.

Between two knots of the path with known (s, v, a) lie two phases of constant jerk and the same
duration h / 2. That the three quantities fit asks for

    6 h (v_0 + v_1) + h^2 (a_0 - a_1) = 12 (s_1 - s_0),
    j_1 = 4 B - A,  j_2 = 3 A - 4 B,  A = (a_1 - a_0) / h,  B = (v_1 - v_0 - a_0 h) / h^2.

So s(t) is cubic in each phase and has continuous acceleration; on a path of degree d the pieces of
q(s(t)) have degree 3 d. Nothing is fitted.
"""

import math

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import kernel
from kinematics.arrays import Array


@kernel
def phases_kernel(states: Array, phases: Array) -> bool:
    """Write (start, speed, acceleration / 2, jerk / 6, duration) of the phases; False if none fit.

    Args:
        states: (s, v, a) at the knots, shape (N + 1, 3).
        phases: Shape (2 N, 5).
    """
    for i in range(states.shape[0] - 1):
        s0, v0, a0 = states[i]
        s1, v1, a1 = states[i + 1]
        way, total = s1 - s0, v0 + v1
        square = 9.0 * total * total + 12.0 * (a0 - a1) * way
        if not square >= 0.0:
            return False
        h = 12.0 * way / (3.0 * total + math.sqrt(square))
        if not 0.0 < h < np.inf:
            return False
        A, B = (a1 - a0) / h, (v1 - v0 - a0 * h) / (h * h)
        j1, j2 = 4.0 * B - A, 3.0 * A - 4.0 * B
        half = 0.5 * h
        v, a = v0 + (a0 + 0.5 * j1 * half) * half, a0 + j1 * half
        s = s0 + (v0 + (0.5 * a0 + j1 * half / 6.0) * half) * half
        first, second = phases[2 * i], phases[2 * i + 1]
        first[0], first[1], first[2], first[3], first[4] = s0, v0, 0.5 * a0, j1 / 6.0, half
        second[0], second[1], second[2], second[3], second[4] = s, v, 0.5 * a, j2 / 6.0, half
    return True


@kernel
def ratios_kernel(
    coefficients: Array,
    pieces: NDArray[np.int64],
    breaks: Array,
    phases: Array,
    limits: Array,
    ratios: Array,
) -> None:
    """Write the largest ratios to the limits at both ends of both phases of each cell.

    Args:
        coefficients: Coefficients of the path, shape (p, n, d + 1), d at most 3.
        pieces: The path's piece of each cell, shape (N,).
        breaks: Breaks of the path, shape (p + 1,).
        phases: Phases as ``phases_kernel`` writes them, shape (2 N, 5).
        limits: Limits of velocity, acceleration and jerk, shape (3, n).
        ratios: Shape (3, N).
    """
    n, size = coefficients.shape[1:]
    for i in range(pieces.shape[0]):
        worst_v, worst_a, worst_j = 0.0, 0.0, 0.0
        for phase in range(2 * i, 2 * i + 2):
            start, one, two, three, h = phases[phase]
            for end in range(2):
                t = end * h
                u = start + (one + (two + three * t) * t) * t - breaks[pieces[i]]
                v = one + (2.0 * two + 3.0 * three * t) * t
                a, j = 2.0 * two + 6.0 * three * t, 6.0 * three
                for joint in range(n):
                    c = coefficients[pieces[i], joint]
                    c2 = c[2] if size > 2 else 0.0
                    c3 = c[3] if size > 3 else 0.0
                    q1 = c[1] + (2.0 * c2 + 3.0 * c3 * u) * u
                    q2, q3 = 2.0 * c2 + 6.0 * c3 * u, 6.0 * c3
                    worst_v = max(worst_v, abs(q1 * v) / limits[0, joint])
                    worst_a = max(worst_a, abs(q1 * a + q2 * v * v) / limits[1, joint])
                    third = q1 * j + 3.0 * q2 * v * a + q3 * v * v * v
                    worst_j = max(worst_j, abs(third) / limits[2, joint])
        ratios[0, i], ratios[1, i], ratios[2, i] = worst_v, worst_a, worst_j
