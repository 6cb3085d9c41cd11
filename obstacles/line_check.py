"""``edge_check`` on straight joint motions: one of them, or the legs of a polyline."""

import numpy as np

from kinematics.arrays import Array
from kinematics.chain import MAX_JOINTS
from kinematics.compiled.kernel import kernel
from kinematics.compiled.simd import on_stack
from obstacles.edge_check import FREE, MAX_INTERVALS, Cubic, certify_in
from obstacles.kernel_work import Workspace, workspace
from obstacles.model_arrays import ModelArrays
from obstacles.state_check import blocked_at, verdict_in


@kernel(allocates=False)
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


@kernel
def certify_edge(model: ModelArrays, start: Array, end: Array, margin: float) -> int:
    """``certify_curve`` on the straight motion from ``start`` to ``end``, the verdict alone.

    Its end is looked at first: a state costs a tenth of a proof, and a thousandth of one that finds
    a contact at the end of a motion which comes near others before.
    """
    return _edge_in(model, workspace(model), start, end, margin)


@kernel(allocates=False)
def _edge_in(model: ModelArrays, work: Workspace, start: Array, end: Array, margin: float) -> int:
    verdict = verdict_in(model, work, end, margin, on_stack(1).view(np.int64))
    if verdict != FREE:
        return verdict
    return certify_line(model, work, start, end, margin, MAX_INTERVALS, on_stack(4))


@kernel
def early_contact(
    model: ModelArrays, start: Array, end: Array, margin: float, looks: int, outcome: Array
) -> int:
    """``certify_curve`` of the first state on a straight motion that a look finds not free.

    Args:
        model: The packed robot and scene.
        start: Where the straight motion begins, shape (n,) [rad or m].
        end: Where it ends, shape (n,).
        margin: Asked for on top of the pairs' own margins [m].
        looks: Parts of the motion between which states are looked at, a power of 2.
        outcome: As of ``certify_curve``; its first number is the state's share of the motion.

    Returns:
        The verdict on the state; FREE where no look finds one.
    """
    work, n = workspace(model), start.shape[0]
    share = blocked_at(model, work, start, end, margin, 2, looks, on_stack(1).view(np.int64))
    if share < 0.0:
        return FREE
    there, zero = on_stack(MAX_JOINTS)[:n], on_stack(MAX_JOINTS)[:n]
    for j in range(n):
        there[j], zero[j] = start[j] + share * (end[j] - start[j]), 0.0
    curve = Cubic(there, zero, zero, zero)
    verdict = certify_in(model, work, curve, margin, MAX_INTERVALS, outcome)
    outcome[0] = share
    return verdict


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
