"""``edge_check`` on rounded corners of a polyline: the widest curves that are free."""

import math

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array
from obstacles.collision.edge_check import FREE, MAX_INTERVALS, Cubic, certify_in
from obstacles.collision.model.kernel_work import workspace
from obstacles.collision.model.model_arrays import ModelArrays
from obstacles.collision.state_check import verdict_in

#: Intervals looked at before the caller is asked whether to go on: a few milliseconds.
_PAUSE = 1000


@kernel
def round_corners(
    model: ModelArrays, waypoints: Array, margin: float, halvings: int, keep: bool, smooth: bool,
    first: int, reaches: Array,
) -> int:  # fmt: skip
    """Write for each corner the first of a reach, its half, its quarter, ... whose curve is free.

    Args:
        model: The packed robot and scene.
        waypoints: Shape (k, n), none that repeats its predecessor [rad or m].
        margin: Asked for on top of the pairs' own margins [m].
        halvings: Reaches tried at a corner.
        keep: Whether corners that are not free themselves are passed over.
        smooth: Whether corners are rounded by cubics, or by parabolas.
        first: The corner to begin at.
        reaches: Largest reaches of corners that are to be looked at, 0 for others, shape
            (k - 2,); filled with the reaches found, negative where none is free.

    Returns:
        The corner to go on at; k - 2 after the last.
    """
    n, corners = waypoints.shape[1], waypoints.shape[0] - 2
    work, asked, outcome = workspace(model), np.empty(1, dtype=np.int64), np.empty(4)
    before, after, spent = np.empty(n), np.empty(n), 0.0
    curve = Cubic(np.empty(n), np.empty(n), np.zeros(n), np.zeros(n))
    for i in range(first, corners):
        if spent > _PAUSE:
            return int(i)
        if reaches[i] <= 0.0:
            continue
        reach, corner = reaches[i], waypoints[i + 1]
        reaches[i] = -1.0
        if keep and verdict_in(model, work, corner, margin, asked) != FREE:
            continue
        _write_direction(waypoints[i], corner, before)
        _write_direction(corner, waypoints[i + 2], after)
        for _ in range(halvings):
            verdict = FREE
            for side in range(2 if smooth else 1):
                if verdict != FREE:
                    break
                if smooth:
                    _write_cubic(corner, before, after, reach, side, curve)
                else:
                    _write_parabola(corner, before, after, reach, curve)
                verdict = certify_in(model, work, curve, margin, MAX_INTERVALS, outcome)
                spent += outcome[2]
            if verdict == FREE:
                reaches[i] = reach
                break
            reach /= 2.0
    return int(corners)


@kernel(allocates=False)
def _write_direction(start: Array, end: Array, unit: Array) -> None:
    """Write the unit vector (n,) along a leg."""
    square = 0.0
    for j in range(start.shape[0]):
        unit[j] = end[j] - start[j]
        square += unit[j] * unit[j]
    for j in range(start.shape[0]):
        unit[j] /= math.sqrt(square)


@kernel(allocates=False)
def _write_cubic(
    corner: Array, before: Array, after: Array, reach: float, side: int, curve: Cubic
) -> None:
    """Write the first cubic about a corner, or the second one backwards."""
    for j in range(corner.shape[0]):
        away = before[j] if side == 0 else -after[j]
        curve.b0[j], curve.b1[j] = corner[j] - reach * away, reach * away
        curve.b3[j] = reach * (after[j] - before[j]) / 6.0


@kernel(allocates=False)
def _write_parabola(corner: Array, before: Array, after: Array, reach: float, curve: Cubic) -> None:
    """Write the parabola about a corner."""
    for j in range(corner.shape[0]):
        curve.b0[j], curve.b1[j] = corner[j] - reach * before[j], 2.0 * reach * before[j]
        curve.b2[j] = reach * (after[j] - before[j])
