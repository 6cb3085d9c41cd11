"""Check of many cells of a family of stops by the proof's own check of an interval."""

from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from planning.proof.collision.interval_check import check_interval
from planning.proof.collision.pair_table import PairArrays
from planning.proof.collision.sweep_state import OPEN, REFERRED, VISITS, Sweep

#: Cells after which the clearance need be only half as sharp, and again after as many.
_SHARP_CELLS = 3_000

# Numbers of ``CellRows.progress``.
#: The cell to look at next.
NEXT = 0
#: Cells looked at.
LOOKED_AT = 1
#: The last cell that lowered the clearance, -1 for none.
NEAREST = 2

# Why a check of cells stops.
#: All cells that were asked for were looked at.
DONE = 0
#: Pairs of the last cell are nearer than their margin in its middle, or are too close to be told.
ASKING = 1
#: There is no space for open pairs in the sweep.
FULL = 2
#: There is no space for the pairs that stay open.
CROWDED = 3


class CellRows(NamedTuple):
    """Cells with the pairs open on each (b cells).

    Args:
        columns: Joints as the proof encloses them, shape (b, n, JOINT_COLUMNS).
        pairs: Pairs of elements open on the cells, shape (p, 2).
        directions: The direction to try first for each of them, 0 for none, shape (p, 3).
        starts: First pair of each cell, shape (b + 1,).
        kept: Filled with the pairs that stay open, shape (q, 2).
        kept_directions: Filled likewise, shape (q, 3).
        kept_starts: Filled with the first of these of each cell, shape (b + 1,).
        progress: Numbers by NEXT to NEAREST, shape (3,).
    """

    columns: Array
    pairs: Indices
    directions: Array
    starts: Indices
    kept: Indices
    kept_directions: Array
    kept_starts: Indices
    progress: Indices

    @classmethod
    def of(cls, columns: Array, pairs: Indices, directions: Array, starts: Indices) -> "CellRows":
        """Cells that nothing is known of yet."""
        b, room = len(columns), 2 * len(pairs) + 1024
        kept, rows = np.empty((room, 2), dtype=np.int64), np.empty((room, 3))
        counts = np.zeros(b + 1, dtype=np.int64)
        return cls(columns, pairs, directions, starts, kept, rows, counts, np.array([0, 0, -1]))

    def enlarged(self) -> "CellRows":
        """The same with twice the space for pairs that stay open."""
        return self._replace(
            kept=np.concatenate([self.kept, np.zeros_like(self.kept)]),
            kept_directions=np.concatenate([self.kept_directions, 0.0 * self.kept_directions]),
        )


@kernel(allocates=False)
def check_cells(model: PairArrays, w: Sweep, cells: CellRows, most: int) -> int:
    """Look at cells in turn until DONE with so many, ASKING, FULL or CROWDED.

    Args:
        model: The pairs.
        w: A sweep at depth 0, the half of its interval 1.
        cells: The cells.
        most: Cells to look at.
    """
    progress, n = cells.progress, cells.columns.shape[1]
    last = min(progress[NEXT] + most, cells.columns.shape[0])
    while progress[NEXT] < last:
        k = progress[NEXT]
        first, count = cells.starts[k], cells.starts[k + 1] - cells.starts[k]
        if count >= w.pairs.shape[0]:
            return FULL
        for j in range(n):
            for column in range(cells.columns.shape[2]):
                w.joints[j, column] = cells.columns[k, j, column]
        for entry in range(count):
            _copy(cells.pairs, cells.directions, first + entry, w.pairs, w.directions, entry)
        w.starts[0], w.counts[0] = 0, count
        w.counters[VISITS] += 1
        least = min(w.clearance[0], w.clearance[1])
        if not check_interval(model, w):
            return FULL
        begin = cells.kept_starts[k]
        still, referred = w.counters[OPEN], w.counters[REFERRED]
        if begin + still + referred > cells.kept.shape[0]:
            return CROWDED
        for entry in range(still):
            _copy(w.pairs, w.directions, count + entry, cells.kept, cells.kept_directions,
                  begin + entry)  # fmt: skip
        for entry in range(referred):
            row = begin + still + entry
            for side in range(2):
                cells.kept[row, side] = w.referred[entry, side]
            for axis in range(3):
                cells.kept_directions[row, axis] = 0.0
        cells.kept_starts[k + 1] = begin + still + referred
        if min(w.clearance[0], w.clearance[1]) < least:
            progress[NEAREST] = k
        progress[NEXT] = k + 1
        progress[LOOKED_AT] += 1
        if w.counters[VISITS] % _SHARP_CELLS == 0:
            # Bounds are sharp beyond a share of the least distance met.
            w.nearest[0], w.nearest[1] = 0.5 * w.nearest[0], 0.5 * w.nearest[1]
        if referred > 0:
            return ASKING
    return DONE


@kernel(allocates=False, inline="code")
def _copy(
    pairs: Indices, directions: Array, i: int, to_pairs: Indices, to_directions: Array, k: int
) -> None:
    """Copy a pair with its direction."""
    to_pairs[k, 0], to_pairs[k, 1] = pairs[i, 0], pairs[i, 1]
    for axis in range(3):
        to_directions[k, axis] = directions[i, axis]
