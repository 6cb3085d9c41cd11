"""A plane with a wall that has a gap: what stands in for a robot among obstacles."""

from itertools import pairwise
from typing import Any, cast

import numpy as np

from kinematics.arrays import Array
from kinematics.chain import Chain
from obstacles.checker import Checker
from tests.planning.scenes import builtin

#: Half the wall's thickness, and its gap's upper end, in the plane of the first two joints.
HALF, GAP = 0.1, 0.8


class Wall:
    """Free but for |x| < HALF, y < GAP, and a closed cell about the point CELL."""

    CELL = np.array([1.2, -1.2])

    def valid(self, q: Array) -> bool:
        return self.free(q, q)

    def free(self, a: Array, b: Array) -> bool:
        boxes = [(np.array([-HALF, -10.0]), np.array([HALF, GAP]))]
        for sign in (-1.0, 1.0):
            for axis in (0, 1):
                low, high = self.CELL - 0.25, self.CELL + 0.25
                side = self.CELL[axis] + sign * 0.2
                low[axis], high[axis] = side - 0.05, side + 0.05
                boxes.append((low, high))
        return not any(_meets(a, b, low, high) for low, high in boxes)

    def polyline(self, waypoints: Array) -> tuple[Any, int]:
        free = all(self.free(a, b) for a, b in pairwise(waypoints))
        return type("Verdict", (), {"free": free})(), 0


def _meets(a: Array, b: Array, low: Array, high: Array) -> bool:
    """Whether a segment meets an open box, by clipping."""
    first, last = 0.0, 1.0
    for axis in range(2):
        step = b[axis] - a[axis]
        if step == 0.0:
            if not low[axis] < a[axis] < high[axis]:
                return False
            continue
        near, far = sorted(((low[axis] - a[axis]) / step, (high[axis] - a[axis]) / step))
        first, last = max(first, near), min(last, far)
    return first < last


WALL = cast(Checker, Wall())
START, GOAL, ENCLOSED = np.array([-1.0, 0.0]), np.array([1.0, 0.0]), Wall.CELL
#: Around the wall's end: to its one corner, along its top, and down again.
SHORTEST = 2.0 * float(np.hypot(1.0 - HALF, GAP)) + 2.0 * HALF


def plane() -> Chain:
    """Two joints."""
    return builtin("planar_rr").chain
