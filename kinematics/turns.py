"""Cosines and sines of many angles at once."""

import math

import numpy as np

from kinematics.chain import Array
from kinematics.kernel import kernel


@kernel
def turns_kernel(q: Array, cosines: Array, sines: Array) -> None:
    """Write cosine and sine of each of q (n,), to 2e-16, in a loop that compiles to vectors.

    x = k pi/2 + r by pi/2 in three pieces, and minimax polynomials for |r| <= pi/4 ("A freely
    distributable C math library", fdlibm, 1993), chosen by arithmetic instead of branches. Two
    library calls an angle would be most of what forward kinematics costs.
    """
    for i in range(q.shape[0]):
        k = np.floor(q[i] * (2.0 / math.pi) + 0.5)
        r = q[i] - k * 1.5707963267341256
        r = (r - k * 6.077100506303966e-11) - k * 2.0222662487959506e-21
        z = r * r
        s = -2.50507602534068634195e-08 + z * 1.58969099521155010221e-10
        s = -1.98412698298579493134e-04 + z * (2.75573137070700676789e-06 + z * s)
        s = -1.66666666666666324348e-01 + z * (8.33333333332248946124e-03 + z * s)
        s = r + r * z * s
        c = 2.08757232129817482790e-09 + z * -1.13596475577881948265e-11
        c = 2.48015872894767294178e-05 + z * (-2.75573143513906633035e-07 + z * c)
        c = 4.16666666666666019037e-02 + z * (-1.38888888888741095749e-03 + z * c)
        c = (1.0 - 0.5 * z) + z * z * c
        half = 0.5 * k
        odd = 2.0 * (half - np.floor(half))
        half = 0.5 * np.floor(half)
        sign = 1.0 - 4.0 * (half - np.floor(half))
        sines[i] = sign * ((1.0 - odd) * s + odd * c)
        cosines[i] = sign * ((1.0 - odd) * c - odd * s)
    for i in range(q.shape[0]):
        # k times the first piece of pi/2 is exact up to here.
        if not abs(q[i]) < 1e6:
            cosines[i], sines[i] = math.cos(q[i]), math.sin(q[i])
