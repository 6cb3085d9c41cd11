"""Extrema and jumps of piecewise polynomials, by the proof's own code.

On a piece p(u), 0 <= u <= 1, is written in Bernstein's basis: it lies between its least and largest
coefficient and takes the first and the last as its values at the ends. Parts whose hull exceeds the
largest value found are split (de Casteljau), at the root of the derivative where its coefficients
change their sign once, else in the middle. So every extremum is bounded from outside and reached
from inside. Planners scale time by ``Trajectory.peaks``, from the roots of the derivative.
Source: "Numerical solution of algebraic equations by Bernstein polynomials", Computing, 1994.
"""

from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array
from kinematics.trajectory.trajectory import Trajectory

#: A bound may be this much beyond what is reached [relative].
_SHARP = 1e-11
#: The least of that, as part of the largest coefficient: values that cancel have no more digits.
_SHARP_OF_SIZE = 1e-15
#: Values this near each other are the same, and told of the first instant: rounding does not
#: choose, which differs from processor to processor [relative; of shares of limits absolute].
TIED = 1e-11
#: Times this near each other belong to one peak that is being found, as a share of a piece: a
#: value that is off by ``TIED`` is reached this far from it.
_SAME_PEAK = 1e-4
#: Rounding of a coefficient in Bernstein's basis, as part of the largest one.
_ROUNDING = 64.0 * 2.0**-53
#: Splits of a piece, one within the other.
MAX_DEPTH = 60
#: Parts are never split nearer than this to an end, as a share of them.
_NEAREST = 1e-12
#: Steps towards the root of a derivative.
_ROOT_STEPS = 8
#: A step this short ends the search: the part's hull is off by as little.
_ROOT_FOUND = 1e-14

# Columns of what the kernel writes of each joint.
VALUE = 0
TIME = 1
BOUND = 2


class Extrema(NamedTuple):
    """Least and largest value of each joint's position or derivative, each of shape (n,).

    Args:
        minimum: Reached.
        time_of_minimum: [s].
        lower: Never fallen below, hardly any less than the minimum.
        maximum: Reached.
        time_of_maximum: [s].
        upper: Never exceeded, hardly any more than the maximum.
    """

    minimum: Array
    time_of_minimum: Array
    lower: Array
    maximum: Array
    time_of_maximum: Array
    upper: Array


def extrema(breaks: Array, coefficients: Array, order: int) -> Extrema:
    """Extrema of a derivative of piecewise polynomials over all of their time.

    Args:
        breaks: Shape (m + 1,) [s].
        coefficients: Ascending, shape (m, n, k).
        order: 0 for the position itself, 1 for velocity, ...
    """
    n, k = coefficients.shape[1:]
    highest, lowest = np.empty((n, 3)), np.empty((n, 3))
    stack = np.empty((MAX_DEPTH + 2, k + 3))
    extrema_kernel(breaks, coefficients, order, stack, highest, lowest)
    return Extrema(
        -lowest[:, VALUE],
        lowest[:, TIME],
        -lowest[:, BOUND],
        highest[:, VALUE],
        highest[:, TIME],
        highest[:, BOUND],
    )


def jumps(trajectory: Trajectory, order: int) -> Array:
    """Jumps of a derivative at each inner break, shape (m - 1, n).

    Args:
        trajectory: The motion.
        order: 0 for the position itself, 1 for velocity, ...
    """
    found = np.empty((trajectory.pieces - 1, trajectory.n))
    jumps_kernel(trajectory.breaks, trajectory.coefficients, order, found)
    return found


@kernel(allocates=False)
def jumps_kernel(breaks: Array, coefficients: Array, order: int, found: Array) -> None:
    """Kernel of ``jumps``."""
    for i in range(found.shape[0]):
        for j in range(found.shape[1]):
            found[i, j] = _jump(breaks, coefficients, order, i, j)


@kernel(allocates=False)
def largest_jump(breaks: Array, coefficients: Array, order: int) -> float:
    """The largest of the ``jumps`` of a derivative, whatever its sign; 0 where there are none."""
    largest = 0.0
    for i in range(coefficients.shape[0] - 1):
        for j in range(coefficients.shape[1]):
            size = abs(_jump(breaks, coefficients, order, i, j))
            # What is no number is told as such.
            if size > largest or np.isnan(size):
                largest = size
    return largest


@kernel(allocates=False)
def _jump(breaks: Array, coefficients: Array, order: int, i: int, j: int) -> float:
    """Jump of joint j's derivative at the end of piece i."""
    length, size = breaks[i + 1] - breaks[i], coefficients.shape[2]
    before, after = 0.0, 0.0
    for k in range(size - 1, order - 1, -1):
        factor = 1.0
        for step in range(order):
            factor *= k - step
        before = before * length + factor * coefficients[i, j, k]
        after = factor * coefficients[i + 1, j, k]
    return after - before


@kernel(allocates=False)
def extrema_kernel(
    breaks: Array, coefficients: Array, order: int, stack: Array, highest: Array, lowest: Array
) -> None:
    """Write the largest value of a derivative, its time and a bound, and of its negative, (n, 3).

    ``stack`` (MAX_DEPTH + 2, k + 3) is scratch: Bernstein coefficients, and where a part begins
    and ends in its piece.
    """
    m, n, size = coefficients.shape
    for j in range(n):
        for largest in (highest, lowest):
            largest[j, VALUE], largest[j, TIME], largest[j, BOUND] = -np.inf, breaks[0], -np.inf
        # Where pieces begin first: of the others few exceed the largest of these.
        factor = 1.0
        for step in range(order):
            factor *= order - step
        for i in range(m if order < size else 0):
            value = factor * coefficients[i, j, order]
            _raise(highest[j], value, breaks[i], 0.0)
            _raise(lowest[j], -value, breaks[i], 0.0)
        for i in range(m):
            length = breaks[i + 1] - breaks[i]
            b = stack[MAX_DEPTH + 1]
            count = to_bernstein(coefficients[i, j], length, order, b)
            low, high = np.inf, -np.inf
            for k in range(count):
                low, high = min(low, b[k]), max(high, b[k])
            whole = max(abs(low), abs(high))
            if not _settles(b, count, 1.0, breaks[i], length, high, whole, highest[j]):
                _search(stack, count, size, 1.0, breaks[i], length, whole, highest[j])
            if not _settles(b, count, -1.0, breaks[i], length, -low, whole, lowest[j]):
                _search(stack, count, size, -1.0, breaks[i], length, whole, lowest[j])


@kernel(allocates=False)
def _raise(largest: Array, value: float, time: float, near: float) -> None:
    """Raise the largest value (3,) to a larger one.

    Its time follows where more than rounding is added, or where it moves by no more than ``near``.
    """
    if value > largest[VALUE]:
        if value > largest[VALUE] + TIED * abs(largest[VALUE]) or (
            abs(time - largest[TIME]) <= near
        ):
            largest[TIME] = time
        largest[VALUE] = value


@kernel(allocates=False)
def to_bernstein(c: Array, length: float, order: int, b: Array) -> int:
    """Write the Bernstein coefficients of a derivative on [0, length]; their count.

    b_i = sum_k C(i, k) / C(d, k) a_k for sum_k a_k u^k, d the degree.
    """
    count: int = c.shape[0] - order
    while count > 1 and c[count - 1 + order] == 0.0:
        count -= 1
    if count < 1:
        b[0] = 0.0
        return 1
    power = 1.0
    for k in range(count):
        factor = power
        for step in range(order):
            factor *= k + order - step
        b[k] = factor * c[k + order]
        power *= length
    d = count - 1
    choose = 1.0
    for k in range(1, count):
        choose *= (d - k + 1.0) / k
        b[k] /= choose
    # C(i, k) by repeated sums, as in Pascal's triangle.
    for level in range(1, count):
        for k in range(d, level - 1, -1):
            b[k] += b[k - 1]
    return count


@kernel(allocates=False, inline="code")
def _settles(
    b: Array, count: int, sign: float, begin: float, length: float, hull: float, whole: float,
    largest: Array,
) -> bool:  # fmt: skip
    """Raise the largest value, its time and its bound (3,) to those of a polynomial's ends.

    Args:
        b: Bernstein coefficients of the polynomial, taken times ``sign``.
        count: How many they are.
        sign: 1 or -1.
        begin: Begin of the polynomial [s].
        length: How long it is [s].
        hull: The largest of its coefficients.
        whole: The largest absolute one.
        largest: Raised.

    Returns:
        Whether nothing between the ends is larger; else the bound is left to ``_search``.
    """
    _raise(largest, sign * b[0], begin, 0.0)
    _raise(largest, sign * b[count - 1], begin + length, 0.0)
    if not hull <= largest[VALUE] + _SHARP * abs(largest[VALUE]) + _SHARP_OF_SIZE * whole:
        return False
    largest[BOUND] = max(largest[BOUND], hull + _ROUNDING * whole)
    return True


@kernel(allocates=False)
def _search(
    stack: Array, count: int, size: int, sign: float, begin: float, length: float, whole: float,
    largest: Array,
) -> None:  # fmt: skip
    """Raise the largest value, its time and its bound (3,) to those of a polynomial's parts.

    The stack's last row holds the whole one, which is taken times ``sign``.
    """
    low, high = size + 1, size + 2
    b = stack[MAX_DEPTH + 1]
    for k in range(count):
        stack[0, k] = sign * b[k]
    stack[0, low], stack[0, high] = 0.0, 1.0
    _split(stack, 0, count, low, high)
    top = 2
    while top > 0:
        top -= 1
        part = stack[top]
        hull = part[0]
        for k in range(1, count):
            hull = max(hull, part[k])
        for k, end in ((0, low), (count - 1, high)):
            _raise(largest, part[k], begin + part[end] * length, _SAME_PEAK * length)
        spare = _SHARP * abs(largest[VALUE]) + _SHARP_OF_SIZE * whole
        if hull <= largest[VALUE] + spare or top >= MAX_DEPTH - 1:
            largest[BOUND] = max(largest[BOUND], hull + _ROUNDING * whole)
            continue
        _split(stack, top, count, low, high)
        top += 2


@kernel(allocates=False)
def _split(stack: Array, top: int, count: int, low: int, high: int) -> None:
    """Put the two parts of row ``top`` into it and the row after, the first of them last."""
    part, first = stack[top], stack[top + 1]
    t = _where_to_split(part, count)
    # De Casteljau: the first part's coefficients are the left edge of the triangle.
    for k in range(count):
        first[k] = part[0]
        for i in range(count - 1 - k):
            part[i] += t * (part[i + 1] - part[i])
    at = part[low] + t * (part[high] - part[low])
    first[low], first[high] = part[low], at
    # What is left in ``part`` is the right edge, the coefficients of the second part.
    part[low] = at


@kernel(allocates=False)
def _where_to_split(b: Array, count: int) -> float:
    """The root of the derivative where it falls once from above to below 0, else the middle."""
    falls, rises = 0, 0
    for k in range(count - 2):
        before, after = b[k + 1] - b[k], b[k + 2] - b[k + 1]
        falls += before > 0.0 >= after
        rises += before <= 0.0 < after
    if falls != 1 or rises != 0:
        return 0.5
    low, high, t = 0.0, 1.0, 0.5
    for _ in range(_ROOT_STEPS):
        slope, curvature = _slope(b, count, t)
        if slope > 0.0:
            low = t
        else:
            high = t
        before = t
        step = t - slope / curvature if curvature < 0.0 else low
        t = step if low < step < high else 0.5 * (low + high)
        if abs(t - before) <= _ROOT_FOUND:
            break
    return min(max(t, _NEAREST), 1.0 - _NEAREST)


@kernel(allocates=False)
def _slope(b: Array, count: int, t: float) -> tuple[float, float]:
    """First and second derivative of a polynomial in Bernstein's basis at t."""
    d, s = count - 1, 1.0 - t
    slope, curvature, choose, power = 0.0, 0.0, 1.0, 1.0
    # Sums over k of C(d - 1, k) s^(d - 1 - k) t^k (b_(k + 1) - b_k), by Horner in t / s or s / t.
    ratio = t / s if s >= t else s / t
    for index in range(d):
        k = index if s >= t else d - 1 - index
        weight = choose * power
        slope += weight * (b[k + 1] - b[k])
        choose *= (d - 1.0 - index) / (index + 1.0)
        power *= ratio
    slope *= d * max(s, t) ** (d - 1)
    choose, power = 1.0, 1.0
    for index in range(d - 1):
        k = index if s >= t else d - 2 - index
        weight = choose * power
        curvature += weight * (b[k + 2] - 2.0 * b[k + 1] + b[k])
        choose *= (d - 2.0 - index) / (index + 1.0)
        power *= ratio
    curvature *= d * (d - 1.0) * max(s, t) ** max(d - 2, 0)
    return slope, curvature
