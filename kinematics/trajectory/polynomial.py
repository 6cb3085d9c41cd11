"""Kernels over piecewise polynomials: values, exact extrema, shifts, compositions.

A piece has ascending coefficients c, p(t) = sum_k c_k t^k on [0, h]. Ranges are found on the unit
interval, q(u) = p(h u), so that neither the length of a piece nor its units matter.
"""

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices

# A root in the unit interval is known as well as doubles know it: half an ulp of 1.
_ROOT_TOLERANCE = 1.1e-16
# Safeguarded Newton needs about 6 steps, pure bisection 53; more is never of use.
_MAX_STEPS = 100


@kernel
def unit_derivative_kernel(c: Array, h: float, order: int, out: Array) -> int:
    """Write the coefficients of d^order p / dt^order at t = h u, in powers of u, and their count.

    A derivative beyond the degree is the zero polynomial (one coefficient).
    """
    count: int = c.shape[0] - order
    if count < 1:
        out[0] = 0.0
        return 1
    power = 1.0
    for k in range(count):
        factor = power
        for i in range(order):
            factor *= k + order - i
        out[k] = c[k + order] * factor
        power *= h
    # Pieces of a lower degree than the rest cost no more than they must.
    while count > 1 and out[count - 1] == 0.0:
        count -= 1
    return count


@kernel
def horner_kernel(c: Array, count: int, u: float) -> float:
    """Answer sum_k c_k u^k over the first ``count`` coefficients."""
    value: float = c[count - 1]
    for k in range(count - 2, -1, -1):
        value = value * u + c[k]
    return value


@kernel
def sample_kernel(
    breaks: Array, coefficients: Array, times: Array, order: int, values: Array
) -> None:
    """Write the derivative of the given order at ``times`` (p,), which ascend or not, to (p, n)."""
    m, n, count = coefficients.shape
    piece = 0
    for row in range(times.shape[0]):
        t = times[row]
        # Times mostly ascend: walk, and start over where they do not.
        if t < breaks[piece]:
            piece = 0
        while piece < m - 1 and t >= breaks[piece + 1]:
            piece += 1
        u = t - breaks[piece]
        for joint in range(n):
            value = 0.0
            for k in range(count - 1, order - 1, -1):
                factor = coefficients[piece, joint, k]
                for i in range(order):
                    factor *= k - i
                value = value * u + factor
            values[row, joint] = value


@kernel
def bracketed_root_kernel(
    c: Array, slope: Array, count: int, low: float, high: float, f_low: float
) -> float:
    """The root of a polynomial between ``low`` and ``high``, where its sign changes.

    Newton's step, replaced by a bisection where it leaves the bracket or gains too little.
    """
    x = 0.5 * (low + high)
    step = high - low
    before = step
    for _ in range(_MAX_STEPS):
        f = horner_kernel(c, count, x)
        if f == 0.0:
            return x
        if (f < 0.0) == (f_low < 0.0):
            low = x
        else:
            high = x
        d = horner_kernel(slope, count - 1, x)
        newton = x - f / d if d != 0.0 else low
        if low < newton < high and abs(newton - x) < 0.5 * before:
            after = newton
        else:
            after = 0.5 * (low + high)
        before, step = step, abs(after - x)
        x = after
        if step <= _ROOT_TOLERANCE:
            break
    return x


@kernel
def unit_roots_kernel(c: Array, count: int, table: Array, roots: Array, spare: Array) -> int:
    """Write the sign changes of a polynomial in (0, 1], ascending, and answer how many there are.

    Between two neighbouring roots of its derivative a polynomial is monotone and has at most one
    root, which signs at the ends reveal; the derivative's roots come the same way, from the
    constant highest derivative upwards. A root of even order that rounding hides is no sign
    change: for the extrema of the integral nothing is lost.

    Args:
        c: Coefficients in powers of u.
        count: Number of coefficients that count.
        table: Room for the derivatives, at least (count, count).
        roots: The answer, room for ``count`` values.
        spare: Room for ``count`` values.

    Returns:
        The number of roots.
    """
    for k in range(count):
        table[0, k] = c[k]
    for level in range(1, count):
        for k in range(count - level):
            table[level, k] = table[level - 1, k + 1] * (k + 1)
    found = 0
    for level in range(count - 2, -1, -1):
        terms = count - level
        for i in range(found):
            spare[i] = roots[i]
        spare[found] = 1.0
        intervals = found + 1
        found = 0
        low, f_low = 0.0, table[level, 0]
        for i in range(intervals):
            high = spare[i]
            f_high = horner_kernel(table[level], terms, high)
            if f_high == 0.0:
                if found == 0 or roots[found - 1] < high:
                    roots[found] = high
                    found += 1
            elif f_low != 0.0 and (f_low < 0.0) != (f_high < 0.0):
                roots[found] = bracketed_root_kernel(
                    table[level], table[level + 1], terms, low, high, f_low
                )
                found += 1
            low, f_low = high, f_high
    return found


@kernel
def widen_kernel(c: Array, count: int, u: float, time: float, best: Array) -> None:
    """Let ``best`` = (minimum, its time, maximum, its time) take in the value at u."""
    value = horner_kernel(c, count, u)
    if value < best[0]:
        best[0], best[1] = value, time
    if value > best[2]:
        best[2], best[3] = value, time


@kernel
def inside_hull_kernel(c: Array, count: int, low: float, high: float, spare: Array) -> bool:
    """Say whether the Bernstein coefficients on [0, 1], which enclose the values, lie in a range.

    b_i = sum_(j<=i) C(i, j) / C(d, j) c_j, by d sweeps of additions.
    """
    degree = count - 1
    binomial = 1.0
    for k in range(count):
        spare[k] = c[k] / binomial
        binomial = binomial * (degree - k) / (k + 1)
    for sweep in range(1, count):
        for k in range(degree, sweep - 1, -1):
            spare[k] += spare[k - 1]
    inside = True
    for k in range(count):
        # Said this way round a NaN is never inside.
        inside &= low <= spare[k] <= high
    return inside


@kernel
def extrema_kernel(
    breaks: Array, coefficients: Array, order: int, largest_only: bool, work: Array, best: Array
) -> None:
    """Write (minimum, its time, maximum, its time) of a derivative, a row a joint, shape (n, 4).

    The ends of all pieces come first: a piece whose coefficients' sums or whose Bernstein hull lie
    within what they already span holds no extremum and costs no root.

    Args:
        breaks: Shape (m + 1,).
        coefficients: Shape (m, n, k).
        order: Order of the derivative.
        largest_only: Only the one of the two that is larger in absolute value need be right.
        work: Room, shape (k + 3, k).
        best: The answer, shape (n, 4).
    """
    m, n = coefficients.shape[:2]
    c, roots, spare, table = work[0], work[1], work[2], work[3:]
    for joint in range(n):
        row = best[joint]
        row[0], row[1], row[2], row[3] = float("inf"), 0.0, float("-inf"), 0.0
        for i in range(m):
            h = breaks[i + 1] - breaks[i]
            count = unit_derivative_kernel(coefficients[i, joint], h, order, c)
            widen_kernel(c, count, 0.0, breaks[i], row)
            widen_kernel(c, count, 1.0, breaks[i + 1], row)
        for i in range(m):
            h = breaks[i + 1] - breaks[i]
            count = unit_derivative_kernel(coefficients[i, joint], h, order, c)
            low, high = row[0], row[2]
            if largest_only:
                high = max(-low, high)
                low = -high
            below, above = c[0], c[0]
            for k in range(1, count):
                if c[k] < 0.0:
                    below += c[k]
                else:
                    above += c[k]
            # Said this way round a NaN is never inside.
            if count < 3 or (low <= below and above <= high):
                continue
            if inside_hull_kernel(c, count, low, high, spare):
                continue
            widen_inside_kernel(c, count, breaks[i], h, table, roots, spare, row)


@kernel
def widen_inside_kernel(
    c: Array,
    count: int,
    start: float,
    h: float,
    table: Array,
    roots: Array,
    spare: Array,
    best: Array,
) -> None:
    """Widen ``best`` by the stationary values of one piece."""
    for k in range(count - 1):
        spare[k] = c[k + 1] * (k + 1)
    found = unit_roots_kernel(spare, count - 1, table, roots, spare)
    for i in range(found):
        widen_kernel(c, count, roots[i], start + h * roots[i], best)


@kernel
def piece_extrema_kernel(
    breaks: Array, coefficients: Array, order: int, work: Array, lower: Array, upper: Array
) -> None:
    """Write the least and largest value of a derivative in every piece, both (m, n).

    ``work`` is room of shape (k + 4, max(k, 4)).
    """
    m, n = coefficients.shape[:2]
    c, roots, spare, best, table = work[0], work[1], work[2], work[3], work[4:]
    for i in range(m):
        h = breaks[i + 1] - breaks[i]
        for joint in range(n):
            count = unit_derivative_kernel(coefficients[i, joint], h, order, c)
            best[0], best[2] = float("inf"), float("-inf")
            widen_kernel(c, count, 0.0, 0.0, best)
            widen_kernel(c, count, 1.0, 1.0, best)
            if count > 2 and not inside_hull_kernel(c, count, best[0], best[2], spare):
                widen_inside_kernel(c, count, 0.0, 1.0, table, roots, spare, best)
            lower[i, joint], upper[i, joint] = best[0], best[2]


@kernel
def shift_kernel(c: Array, offset: float, out: Array) -> None:
    """Write the coefficients of p(t + offset): Taylor's shift by repeated synthetic division."""
    count = c.shape[0]
    for k in range(count):
        out[k] = c[k]
    for sweep in range(count - 1):
        for k in range(count - 2, sweep - 1, -1):
            out[k] += offset * out[k + 1]


@kernel(allocates=False)
def compose_kernel(outer: Array, top: int, inner: Array, product: Array, out: Array) -> None:
    """Write the coefficients of outer(inner(t)).

    Args:
        outer: Ascending powers; those above ``top`` are not checked, shape (>= top + 1,).
        top: Degree of the outer polynomial.
        inner: Ascending powers from 1 on (there is no constant), shape (d,).
        product: Scratch, shape (>= top d + 1,).
        out: Ascending powers, shape (>= top d + 1,); entries above top d stay as they are.
    """
    degree = inner.shape[0]
    out[0] = outer[top]
    used = 1
    for k in range(top - 1, -1, -1):
        for m in range(used + degree):
            product[m] = 0.0
        for m in range(used):
            for i in range(degree):
                product[m + 1 + i] += out[m] * inner[i]
        used += degree
        for m in range(used):
            out[m] = product[m]
        out[0] += outer[k]


@kernel
def compose_pieces_kernel(
    coefficients: Array, owners: Indices, phases: Array, order: int, work: Array, out: Array
) -> None:
    """Write the coefficients of q(s(t)) for polynomials s(t).

    Args:
        coefficients: Coefficients of q(s), shape (p, n, d + 1).
        owners: The piece of each phase, shape (m,).
        phases: Rows of the start within the piece and the coefficients of t to t^order of s, shape
            (m, >= order + 1).
        order: Degree of s(t).
        work: Memory, shape (2, order d + 1).
        out: Zeros come in, shape (m, n, order d + 1).
    """
    n, size = coefficients.shape[1:]
    shifted, product, inner = work[0, :size], work[1], np.empty(order)
    for i in range(owners.shape[0]):
        for k in range(order):
            inner[k] = phases[i, 1 + k]
        for j in range(n):
            shift_kernel(coefficients[owners[i], j], phases[i, 0], shifted)
            top = size - 1
            while top > 0 and shifted[top] == 0.0:
                top -= 1
            compose_kernel(shifted, top, inner, product, out[i, j])


def composed_pieces(coefficients: Array, owners: Indices, phases: Array, order: int) -> Array:
    """Coefficients of q(s(t)), shape (m, n, order d + 1), as ``compose_pieces_kernel`` takes them.

    Args:
        coefficients: Coefficients of q(s) of degree d, shape (p, n, d + 1).
        owners: The piece of each phase, shape (m,).
        phases: Rows of the start within the piece and the coefficients of t to t^order of s, shape
            (m, >= order + 1).
        order: Degree of s(t).
    """
    size = order * (coefficients.shape[2] - 1) + 1
    pieces, work = np.zeros((len(owners), coefficients.shape[1], size)), np.empty((2, size))
    compose_pieces_kernel(coefficients, owners, phases, order, work, pieces)
    return pieces
