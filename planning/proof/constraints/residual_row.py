"""Rows of path constraints, packed for the proof's kernels."""

from collections.abc import Sequence

import numpy as np

from kinematics.arrays import Array
from planning.constraints.row import Row

# Columns of a row as the kernels here read it.
KIND = 0
CARRIER = 1
REFERENCE = 2
#: First of three, as are those of vectors below [m].
POINT = 3
AXIS = 6
CENTER = 9
DIRECTION = 12
LOWER = 15
UPPER = 16
#: First of the nine entries of K.
TURN = 17
WIDTH = 26


def pack(rows: Sequence[Row]) -> Array:
    """Rows as the kernels here read them, shape (m, WIDTH)."""
    packed = np.empty((len(rows), WIDTH))
    for k, row in enumerate(rows):
        packed[k, :POINT] = row.kind, row.carrier, row.reference
        packed[k, POINT:LOWER] = np.concatenate([row.point, row.axis, row.center, row.direction])
        packed[k, LOWER:TURN] = row.lower, row.upper
        packed[k, TURN:] = row.turn.reshape(9)
    return packed
