"""A plane with a wall that has a gap: what stands in for a robot among obstacles."""

from functools import cached_property
from itertools import pairwise
from typing import Any, cast

import numpy as np

from kinematics.arrays import Array
from kinematics.model.chain import Chain
from obstacles.collision.checker import Checker
from tests.planning.scenes import builtin

#: Coordinates of a segment's first point and its last one: plain numbers, for searches ask often.
Ends = tuple[float, float, float, float]
#: The least coordinates of a box, and its largest ones.
Box = tuple[float, float, float, float]
#: Half the wall's thickness, and its gap's upper end, in the plane of the first two joints.
HALF, GAP = 0.1, 0.8


class Wall:
    """Free but for |x| < HALF, y < GAP, and a closed cell about the point CELL."""

    CELL = np.array([1.2, -1.2])

    def valid(self, q: Array) -> bool:
        return self.free(q, q)

    def free(self, a: Array, b: Array) -> bool:
        ends = (*a[:2].tolist(), *b[:2].tolist())
        return not any(_meets(ends, box) for box in self._boxes)

    @cached_property
    def _boxes(self) -> list[Box]:
        boxes = [(-HALF, -10.0, HALF, GAP)]
        for sign in (-1.0, 1.0):
            for axis in (0, 1):
                low, high = self.CELL - 0.25, self.CELL + 0.25
                side = self.CELL[axis] + sign * 0.2
                low[axis], high[axis] = side - 0.05, side + 0.05
                boxes.append((*low.tolist(), *high.tolist()))
        return boxes

    def polyline(self, waypoints: Array) -> tuple[Any, int]:
        free = all(self.free(a, b) for a, b in pairwise(waypoints))
        return type("Verdict", (), {"free": free})(), 0


def _meets(ends: Ends, box: Box) -> bool:
    """Whether a segment meets an open box, by clipping."""
    first, last = 0.0, 1.0
    for axis in (0, 1):
        a, low, high = ends[axis], box[axis], box[axis + 2]
        step = ends[axis + 2] - a
        if step == 0.0:
            if not low < a < high:
                return False
            continue
        near, far = (low - a) / step, (high - a) / step
        if near > far:
            near, far = far, near
        first, last = max(first, near), min(last, far)
        if first >= last:
            return False
    return True


WALL = cast(Checker, Wall())
START, GOAL, ENCLOSED = np.array([-1.0, 0.0]), np.array([1.0, 0.0]), Wall.CELL
#: Around the wall's end: to its one corner, along its top, and down again.
SHORTEST = 2.0 * float(np.hypot(1.0 - HALF, GAP)) + 2.0 * HALF


def plane() -> Chain:
    """Two joints."""
    return builtin("planar_rr").chain
