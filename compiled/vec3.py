"""Vectors of three components as tuples of floats, which stay in registers inside kernels.

The arithmetic is that of IEEE 754 in the order written, so that verdicts can hang on it.
"""

from compiled.arrays import Array
from compiled.kernel import kernel

Vector = tuple[float, float, float]


@kernel(allocates=False)
def add(a: Vector, b: Vector) -> Vector:
    """The sum a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@kernel(allocates=False)
def subtract(a: Vector, b: Vector) -> Vector:
    """The difference a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@kernel(allocates=False)
def scale(s: float, a: Vector) -> Vector:
    """The multiple s a."""
    return s * a[0], s * a[1], s * a[2]


@kernel(allocates=False)
def dot(a: Vector, b: Vector) -> float:
    """The scalar product a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel(allocates=False)
def cross(a: Vector, b: Vector) -> Vector:
    """The vector product a x b."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@kernel(allocates=False)
def rotate(R: Array, a: Vector) -> Vector:
    """The product R a, of the first three rows and columns of R."""
    return (
        R[0, 0] * a[0] + R[0, 1] * a[1] + R[0, 2] * a[2],
        R[1, 0] * a[0] + R[1, 1] * a[1] + R[1, 2] * a[2],
        R[2, 0] * a[0] + R[2, 1] * a[1] + R[2, 2] * a[2],
    )


@kernel(allocates=False)
def turned_back(R: Array, a: Vector) -> Vector:
    """The product R^T a, likewise."""
    return (
        R[0, 0] * a[0] + R[1, 0] * a[1] + R[2, 0] * a[2],
        R[0, 1] * a[0] + R[1, 1] * a[1] + R[2, 1] * a[2],
        R[0, 2] * a[0] + R[1, 2] * a[1] + R[2, 2] * a[2],
    )


@kernel(allocates=False)
def load(row: Array, at: int) -> Vector:
    """The vector in three columns of a row, from column ``at`` on."""
    return row[at], row[at + 1], row[at + 2]


@kernel(allocates=False)
def row(points: Array, i: int) -> Vector:
    """The point in row i of (k, 3)."""
    return points[i, 0], points[i, 1], points[i, 2]


@kernel(allocates=False)
def column(frame: Array, at: int) -> Vector:
    """The column of a frame written by rows of four numbers, its first one at column ``at``."""
    return frame[at], frame[at + 4], frame[at + 8]


@kernel(allocates=False)
def store(row: Array, at: int, a: Vector) -> None:
    """Write a vector into three columns of a row, from column ``at`` on."""
    row[at], row[at + 1], row[at + 2] = a
