"""Numbers as people write them: the rule by which a miss is rounding, and repaired, or a mistake.

What an exact value must fulfil (the norm of a quaternion, the rows of a rotation, the centre of an
arc) a written one misses by rounding to the decimals or digits that it is written with. So much is
taken, and told from `TOLD` on; more is refused. Numbers with fewer than three count as having
three: what is coarser names no direction. The module needs no arrays, as the server has none.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from decimal import Decimal

from kinematics.errors import InvalidPose

#: A quaternion with three decimals keeps this much of its norm: half a unit of each, at most.
NORM_TOLERANCE = 1e-3
#: Numbers of single precision keep a rotation orthonormal within this, whatever is written of them.
ORTHONORMAL_TOLERANCE = 1e-6
#: Rules of an inertia that came through text may miss by so much of its largest entry in any case,
#: and at most by so much, however few digits are written.
TENSOR_TOLERANCE = 1e-6
_MOST_OF_TENSOR = 1e-2
#: Repairs are told from here on [-]: what single precision loses stays below.
TOLD = 1e-6
#: An axis shorter than this names no direction, and a number below it is a zero that was computed.
_SHORTEST_AXIS = 1e-12
_FEWEST_DECIMALS = 3


def rounding(numbers: Iterable[float]) -> float:
    """The rounding error of numbers: half a unit of the last decimal that any is written with.

    Args:
        numbers: Finite, of one vector; trailing zeros of some may have been lost.
    """
    return float(0.5 * 10.0 ** -max(_decimals(numbers), _FEWEST_DECIMALS))


def _written(numbers: Iterable[float]) -> Iterator[Decimal]:
    """The numbers with the digits that they are written with, without computed zeros."""
    written = (x for x in numbers if abs(x) >= _SHORTEST_AXIS)
    return (Decimal(repr(float(x))).normalize() for x in written)


def _decimals(numbers: Iterable[float]) -> int:
    return max((0, *(-int(x.as_tuple().exponent) for x in _written(numbers))))


def _digits(numbers: Iterable[float]) -> int:
    """The most significant digits that any number is written with, or three.

    What is written with so many digits, rather than decimals, has more decimals where it is small.
    """
    return max((_FEWEST_DECIMALS, *(len(x.as_tuple().digits) for x in _written(numbers))))


def tensor_rounding(rows: Sequence[Sequence[float]]) -> float:
    """By how much rounding makes entries of a symmetric matrix that mirror each other differ.

    It is one unit of the last decimal, or 1e-6 of the largest entry, but 1 % of that at most.

    Args:
        rows: Shape (3, 3), finite.
    """
    return _of_tensor(rows, _decimals(x for row in rows for x in row))


def moment_rounding(rows: Sequence[Sequence[float]]) -> float:
    """By how much rounding moves the principal moments of an inertia, at most.

    It is one unit of the largest entry's last digit, or 1e-6 of that entry, but 1 % at most.

    Args:
        rows: Shape (3, 3), finite.
    """
    largest = max(abs(x) for row in rows for x in row)
    before = math.floor(math.log10(largest)) + 1 if largest > 0.0 else 0
    return _of_tensor(rows, _digits(x for row in rows for x in row) - before)


def _of_tensor(rows: Sequence[Sequence[float]], decimals: int) -> float:
    largest = max(abs(x) for row in rows for x in row)
    # A difference of one unit is worked out with rounding of its own.
    unit = 1.000001 * 10.0**-decimals
    return max(TENSOR_TOLERANCE * largest, min(unit, _MOST_OF_TENSOR * largest))


def asymmetry(rows: Sequence[Sequence[float]]) -> float:
    """The largest difference of two entries of a matrix (3, 3) that mirror each other."""
    return max(abs(rows[i][j] - rows[j][i]) for i, j in ((0, 1), (0, 2), (1, 2)))


def check_quaternion_norm(norm: float) -> None:
    """Refuse a quaternion by its norm.

    Raises:
        InvalidPose: The norm differs from 1 by more than 1e-3.
    """
    # Said this way round what is not a number is refused, too.
    if not abs(norm - 1.0) <= NORM_TOLERANCE:
        raise InvalidPose(
            f"quaternion_xyzw has norm {norm:.6g}; it must be within {NORM_TOLERANCE} of 1",
            hint="Normalise it; the order is [x, y, z, w].",
            norm=norm,
        )


def check_rotation(rows: Sequence[Sequence[float]]) -> float:
    """Refuse a matrix R that is no rotation within its rounding; the largest error of R^T R - I.

    Where entries are rounded by u, columns c_i and c_j of a rotation have the product
    c_i . c_j = (i == j) up to u (|c_i|_1 + |c_j|_1) + 3 u^2.

    Args:
        rows: Shape (3, 3).

    Raises:
        InvalidPose: An error is more than that and more than 1e-6, or the determinant is not +1.
    """
    (a, b, c), (d, e, f), (g, h, i) = rows
    errors = {
        (0, 0): a * a + d * d + g * g - 1.0,
        (1, 1): b * b + e * e + h * h - 1.0,
        (2, 2): c * c + f * f + i * i - 1.0,
        (0, 1): a * b + d * e + g * h,
        (0, 2): a * c + d * f + g * i,
        (1, 2): b * c + e * f + h * i,
    }
    error = max(map(abs, errors.values()))
    determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    if determinant > 0.0 and error <= ORTHONORMAL_TOLERANCE:
        return error
    if determinant > 0.0 and error <= 1.0:
        # Entries near 1 are written 0.9999 or 1: digits count as decimals.
        u = 0.5 * 10.0 ** -_digits((*rows[0], *rows[1], *rows[2]))
        sizes = [sum(abs(row[k]) for row in rows) for k in range(3)]
        if all(abs(x) <= u * (sizes[k] + sizes[m]) + 3.0 * u * u for (k, m), x in errors.items()):
            return error
    raise InvalidPose(
        f"rotation_matrix is not a rotation: R^T R differs from I by {error:.3g}, "
        f"det R = {determinant:.6g}",
        hint="Give an orthonormal matrix with determinant +1, row by row, with three decimals or "
        "more, or give quaternion_xyzw or rpy.",
    )


def check_axis_length(length: float) -> None:
    """Refuse an axis by its length.

    Raises:
        InvalidPose: The axis has no direction.
    """
    if not length >= _SHORTEST_AXIS:
        raise InvalidPose("the axis has length 0, so it names no direction")
