"""``edge_check`` on straight joint motions, legs of a polyline and its rounded corners."""

import math

import numpy as np

from compiled.kernel import kernel
from compiled.simd import on_stack
from kinematics.arrays import Array
from kinematics.model.chain import MAX_JOINTS
from obstacles.collision.edge_check import (
    FREE,
    MAX_INTERVALS,
    TOO_SMALL,
    Cubic,
    Entries,
    certify_in,
    certify_spans,
)
from obstacles.collision.lanes.motion import open_stretches
from obstacles.collision.model.kernel_work import Workspace, workspace
from obstacles.collision.model.model_arrays import ModelArrays
from obstacles.collision.state_check import blocked_at, verdict_in

#: Intervals checked before the caller is asked whether to go on: a few milliseconds.
_PAUSE = 1000


@kernel(allocates=False, inline="always")
def certify_line(
    model: ModelArrays, work: Workspace, start: Array, end: Array, margin: float, most: int,
    outcome: Array,
) -> int:  # fmt: skip
    """``certify_in`` on the straight motion from ``start`` to ``end``, both (n,)."""
    n = start.shape[0]
    step, zero = on_stack(MAX_JOINTS)[:n], on_stack(MAX_JOINTS)[:n]
    for j in range(n):
        step[j], zero[j] = end[j] - start[j], 0.0
    return certify_in(model, work, Cubic(start, step, zero, zero), margin, most, outcome)


@kernel(allocates=False)
def prove_line(
    model: ModelArrays, work: Workspace, start: Array, end: Array, margin: float, most: int,
    outcome: Array,
) -> int:  # fmt: skip
    """``certify_line`` with stretches in lanes first; it answers no clearance (-inf).

    Where most of a motion has some centimetres of clearance it costs a third.
    """
    n = start.shape[0]
    step, zero = on_stack(MAX_JOINTS)[:n], on_stack(MAX_JOINTS)[:n]
    for j in range(n):
        step[j], zero[j] = end[j] - start[j], 0.0
    curve, count = Cubic(start, step, zero, zero), open_stretches(model, work, start, end, margin)
    if count == 0:
        outcome[0], outcome[1], outcome[2], outcome[3] = 0.0, -1.0, 0.0, -np.inf
        return FREE
    if count > 0:
        open_pairs = Entries(work.entries[0], work.hints[0])
        verdict = certify_spans(model, work, curve, margin, most, open_pairs, count, outcome)
        if verdict != TOO_SMALL:
            outcome[3] = -np.inf
            return verdict
    return certify_in(model, work, curve, margin, most, outcome)


@kernel
def certify_edge(model: ModelArrays, start: Array, end: Array, margin: float) -> int:
    """``certify_curve`` on the straight motion from ``start`` to ``end``, the verdict alone.

    Its end is checked first: a state costs a tenth of a proof, and a thousandth of one that finds
    a contact at the end of a motion which comes near others before.
    """
    work = workspace(model)
    verdict = verdict_in(model, work, end, margin, on_stack(1).view(np.int64))
    if verdict != FREE:
        return verdict
    return prove_line(model, work, start, end, margin, MAX_INTERVALS, on_stack(4))


@kernel
def check_straight(
    model: ModelArrays, start: Array, end: Array, margin: float, checks: int, outcome: Array
) -> int:
    """``prove_line`` behind a check of states on the way, which finds most contacts.

    Args:
        model: The packed robot and scene.
        start: Start of the motion, shape (n,) [rad or m].
        end: End of the motion, shape (n,).
        margin: Asked for on top of the pairs' own margins [m].
        checks: Parts of the motion between which states are checked, a power of 2.
        outcome: Outcome as of ``certify_curve``, without a clearance.

    Returns:
        The verdict on the first state that a check finds not free, else on the motion.
    """
    work, n = workspace(model), start.shape[0]
    share = blocked_at(model, work, start, end, margin, 2, checks, on_stack(1).view(np.int64))
    if share >= 0.0:
        there, zero = on_stack(MAX_JOINTS)[:n], on_stack(MAX_JOINTS)[:n]
        for j in range(n):
            there[j], zero[j] = start[j] + share * (end[j] - start[j]), 0.0
        curve = Cubic(there, zero, zero, zero)
        verdict = certify_in(model, work, curve, margin, MAX_INTERVALS, outcome)
        # A check may leave open what is free by a hair: a state proves nothing of the motion.
        if verdict != FREE:
            outcome[0], outcome[3] = share, -np.inf
            return verdict
    return prove_line(model, work, start, end, margin, MAX_INTERVALS, outcome)


@kernel
def certify_path(
    model: ModelArrays, waypoints: Array, margin: float, outcome: Array
) -> tuple[int, int]:
    """``certify_curve`` along every leg of a polyline (m, n); the verdict and the leg it is on."""
    work = workspace(model)
    for leg in range(waypoints.shape[0] - 1):
        verdict = certify_line(
            model, work, waypoints[leg], waypoints[leg + 1], margin, MAX_INTERVALS, outcome
        )
        if verdict != FREE:
            return verdict, leg
    return FREE, waypoints.shape[0] - 1


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
        reaches: Largest reaches of corners that are to be rounded, 0 for others, shape
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


@kernel(allocates=False, inline="always")
def _write_direction(start: Array, end: Array, unit: Array) -> None:
    """Write the unit vector (n,) along a leg."""
    square = 0.0
    for j in range(start.shape[0]):
        unit[j] = end[j] - start[j]
        square += unit[j] * unit[j]
    for j in range(start.shape[0]):
        unit[j] /= math.sqrt(square)


@kernel(allocates=False, inline="always")
def _write_cubic(
    corner: Array, before: Array, after: Array, reach: float, side: int, curve: Cubic
) -> None:
    """Write the first cubic about a corner, or the second one backwards."""
    for j in range(corner.shape[0]):
        away = before[j] if side == 0 else -after[j]
        curve.b0[j], curve.b1[j] = corner[j] - reach * away, reach * away
        curve.b3[j] = reach * (after[j] - before[j]) / 6.0


@kernel(allocates=False, inline="always")
def _write_parabola(corner: Array, before: Array, after: Array, reach: float, curve: Cubic) -> None:
    """Write the parabola about a corner."""
    for j in range(corner.shape[0]):
        curve.b0[j], curve.b1[j] = corner[j] - reach * before[j], 2.0 * reach * before[j]
        curve.b2[j] = reach * (after[j] - before[j])
