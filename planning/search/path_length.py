"""Lengths in joint space: of paths, and of steps along them."""

import math

from compiled.kernel import kernel
from kinematics.arrays import Array

#: A path so many times as long as the straight line is worth another pair of trees: shortening does
#: for the others what that would do.
_LONG = 3.0


@kernel(allocates=False, inline="always")
def square_distance(points: Array, i: int, q: Array) -> float:
    """Square of the distance between row i of configurations (k, n) and another one (n,)."""
    square = 0.0
    for j in range(q.shape[0]):
        square += (points[i, j] - q[j]) ** 2
    return square


@kernel(allocates=False)
def write_step(origin: Array, target: Array, step: float, end: Array) -> None:
    """Write where a step from ``origin`` towards ``target`` ends, all (n,)."""
    square = 0.0
    for j in range(target.shape[0]):
        square += (origin[j] - target[j]) ** 2
    arrives = square <= step * step
    share = 1.0 if arrives else step / math.sqrt(square)
    for j in range(target.shape[0]):
        end[j] = target[j] if arrives else origin[j] + share * (target[j] - origin[j])


@kernel(allocates=False)
def is_detour(path: Array, count: int) -> bool:
    """Whether a path of so many waypoints (k, n) is a detour that is worth another search."""
    return path_length(path, 0, count) > _LONG * math.sqrt(
        square_distance(path, 0, path[count - 1])
    )


@kernel(allocates=False)
def path_length(path: Array, begin: int, end: int) -> float:
    """Length of the rows from ``begin`` to before ``end`` of a path (k, n)."""
    length = 0.0
    for row in range(begin + 1, end):
        length += math.sqrt(square_distance(path, row - 1, path[row]))
    return length
