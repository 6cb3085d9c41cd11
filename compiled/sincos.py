"""Cosines and sines of many angles at once."""

import math

from compiled.arrays import Array
from compiled.kernel import kernel
from compiled.simd import LANES, Lanes, anywhere, choose, first, floor, load, store

#: k times the first piece of pi/2 is exact up to here; beyond, the library's functions are called.
_LARGEST = 1e6
#: Numbers on the stack for cosines and sines of up to eight angles.
TURNS = 2 * LANES


@kernel(inline="code")
def turn_of_kernel(q: Lanes) -> tuple[Lanes, Lanes]:
    """Cosine and sine of an angle, of a number or of a vector, to 2e-16.

    x = k pi/2 + r by pi/2 in three pieces, and minimax polynomials for |r| <= pi/4 ("A freely
    distributable C math library", fdlibm, 1993), chosen by arithmetic instead of branches. Two
    library calls an angle would be most of what forward kinematics costs.
    """
    k = floor(q * (2.0 / math.pi) + 0.5)
    r = q - k * 1.5707963267341256
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
    odd = half > floor(half)
    half = 0.5 * floor(half)
    sign = choose(half > floor(half), -1.0, 1.0)
    return sign * choose(odd, -s, c), sign * choose(odd, c, s)


@kernel(allocates=False)
def turns_kernel(q: Array, cosines: Array, sines: Array) -> None:
    """Write cosine and sine of each of q (n,)."""
    whole = q.shape[0] - q.shape[0] % LANES
    for i in range(0, whole, LANES):
        angles = load(q, i)
        c, s = turn_of_kernel(angles)
        store(cosines, i, c)
        store(sines, i, s)
        if anywhere(abs(angles) >= _LARGEST):
            for j in range(i, i + LANES):
                if abs(q[j]) >= _LARGEST:
                    cosines[j], sines[j] = math.cos(q[j]), math.sin(q[j])
    for i in range(whole, q.shape[0]):
        cosines[i], sines[i] = turn_of_kernel(q[i])
        if abs(q[i]) >= _LARGEST:
            cosines[i], sines[i] = math.cos(q[i]), math.sin(q[i])


@kernel(inline="code")
def few_turns_kernel(q: Array, turns: Array) -> bool:
    """Write cosines and sines of q (n,) into turns (TURNS,), on the stack.

    False where ``turn_at_kernel`` must not take them from there: q is not 1 to 8 angles side by
    side, or one is too large. A number is read from memory sooner than from a lane that a loop
    chooses.
    """
    angles = first(q)
    c, s = turn_of_kernel(angles)
    store(turns, 0, c)
    store(turns, LANES, s)
    few = q.shape[0] <= LANES and (q.shape[0] == 1 or q.strides[0] == 8)
    return few and not anywhere(abs(angles) >= _LARGEST)


@kernel(inline="code")
def turn_at_kernel(q: Array, j: int, few: bool, turns: Array) -> tuple[float, float]:
    """Cosine and sine of q[j]; ``few`` is the answer of ``few_turns_kernel`` for q and turns."""
    if few:
        return turns[j], turns[LANES + j]
    if abs(q[j]) < _LARGEST:
        return turn_of_kernel(q[j])
    return math.cos(q[j]), math.sin(q[j])
