"""Separating directions: proofs that two convex pieces are apart, checked whoever found them.

For any unit direction u, and h the support function of a piece,

    distance(A, B)  >=  -h_B(-u) - h_A(u),

so one number a piece settles it. Finding a good u is a search with many ways to go wrong; checking
one is a maximum of sums of three products. The support functions here are this module's own.
Source: "Certifying algorithms", Computer Science Review, 2011.
"""

import math

import numpy as np

from compiled.kernel import kernel
from compiled.simd import LANES, lane, load
from kinematics.arrays import Array, Indices
from obstacles.convex.piece import PieceKind

Vector = tuple[float, float, float]

_POLYTOPE = int(PieceKind.POLYTOPE)
_CYLINDER = int(PieceKind.CYLINDER)
_HALFSPACE = int(PieceKind.HALFSPACE)

# For numbers of the size of all lengths that they are summed from: two rotations are multiplied and
# a translation is added, each a sum of three products of entries of at most 1.
#: Rounding that one joint's frame can add [units of rounding].
_UNITS_A_JOINT = 32.0
#: Rounding that one piece's place and support can add [units of rounding].
_UNITS_A_PIECE = 64.0
#: Unit of rounding [relative].
_UNIT = 2.0**-53


@kernel(allocates=False)
def highest(columns: Array, start: int, stop: int, x: float, y: float, z: float) -> float:
    """Largest of x v_0 + y v_1 + z v_2 over the columns v from start to stop of (3, v)."""
    a, b, c = columns[0], columns[1], columns[2]
    if stop - start < LANES:
        most = -np.inf
        for k in range(start, stop):
            most = max(most, x * a[k] + y * b[k] + z * c[k])
        return most
    best = x * load(a, start) + y * load(b, start) + z * load(c, start)
    for begin in range(start + LANES, stop, LANES):
        k = min(begin, stop - LANES)  # the last eight may hold some of those before again
        best = max(best, x * load(a, k) + y * load(b, k) + z * load(c, k))
    most = lane(best, 0)
    for number in range(1, LANES):
        most = max(most, lane(best, number))
    return most


@kernel(allocates=False)
def height(
    kind: int, size: Vector, columns: Array, start: int, stop: int, poses: Array, i: int, u: Vector
) -> float:
    """Support function of piece i (no half-space), placed, along a direction [m]."""
    x, y, z = u
    a = poses[i, 0, 0] * x + poses[i, 1, 0] * y + poses[i, 2, 0] * z
    b = poses[i, 0, 1] * x + poses[i, 1, 1] * y + poses[i, 2, 1] * z
    c = poses[i, 0, 2] * x + poses[i, 1, 2] * y + poses[i, 2, 2] * z
    radius, half, offset = size
    base = poses[i, 0, 3] * x + poses[i, 1, 3] * y + poses[i, 2, 3] * z
    base += offset * math.sqrt(x * x + y * y + z * z)
    if kind == _POLYTOPE:
        return float(base + highest(columns, start, stop, a, b, c))
    rim = radius * math.sqrt(a * a + b * b)
    if kind == _CYLINDER:
        return float(base + half * abs(c) + rim)
    return float(base + max(half * c, rim - half * c))


@kernel(allocates=False)
def direction(kinds: Indices, poses: Array, i: int, j: int, u: Vector) -> tuple[bool, Vector]:
    """The unit direction to look along from piece i to piece j, and whether there is one.

    A half-space i has but one direction that can prove anything; a half-space j has none.
    """
    if kinds[j] == _HALFSPACE:
        return False, u
    if kinds[i] == _HALFSPACE:
        u = (poses[i, 0, 2], poses[i, 1, 2], poses[i, 2, 2])
    length = math.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    if not 0.0 < length < np.inf:
        return False, u
    return True, (u[0] / length, u[1] / length, u[2] / length)


@kernel(allocates=False)
def gap(
    kinds: Indices,
    sizes: Array,
    columns: Array,
    starts: Indices,
    poses: Array,
    i: int,
    j: int,
    u: Vector,
) -> tuple[float, float]:
    """Lower bound of the distance of pieces i and j along a unit direction, but for rounding [m].

    And how far piece i goes along it.

    Args:
        kinds: Kinds of the pieces' cores, as ``PieceKind``, shape (p,).
        sizes: Radius, half height and rounding of each piece, shape (p, 3) [m].
        columns: The pieces' vertices in their own frames, shape (3, v) [m].
        starts: Vertices of piece i are ``columns[:, starts[i]:starts[i + 1]]``, shape (p + 1,).
        poses: Poses of all pieces in one frame, shape (p, 4, 4).
        i: One piece.
        j: The other piece.
        u: Direction from piece i towards piece j, as ``direction`` answers it.
    """
    size = (sizes[i, 0], sizes[i, 1], sizes[i, 2])
    if kinds[i] == _HALFSPACE:
        top = poses[i, 0, 3] * u[0] + poses[i, 1, 3] * u[1] + poses[i, 2, 3] * u[2] + size[2]
    else:
        top = height(kinds[i], size, columns, starts[i], starts[i + 1], poses, i, u)
    size = (sizes[j, 0], sizes[j, 1], sizes[j, 2])
    back = (-u[0], -u[1], -u[2])
    bottom = -height(kinds[j], size, columns, starts[j], starts[j + 1], poses, j, back)
    return float(bottom - top), float(top)


@kernel(allocates=False)
def rounding_bound(joints: int, lengths: float) -> float:
    """Bound of the rounding error of a gap, the frames included [m].

    Args:
        joints: How many there are.
        lengths: Sum of the sizes of all numbers that frames and pieces are summed from [m].
    """
    return float((_UNITS_A_PIECE + _UNITS_A_JOINT * joints) * _UNIT * lengths)
