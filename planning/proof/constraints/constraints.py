"""Residuals of a timed motion's constraints, bounded for every instant."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.trajectory.trajectory import Trajectory
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.row import Row
from planning.proof.constraints.residual_search import ResidualBounds, Verdict, bound_residuals
from planning.proof.limits.limit_uses import Violation


@dataclass(frozen=True, slots=True)
class ConstraintReport:
    """Residual of a constraint along a motion.

    Args:
        constraint: Number of the constraint in the request.
        name: Description of the constraint in words.
        residual: Upper bound over all t of its worst residual, negative by what is to spare; it is
            a hundredth or 1e-6 above it at most.
        unit: Unit of the residual, "m" or "rad".
        time: Approximate time at which it is worst [s].
        hard: Whether the constraint has to hold.
    """

    constraint: int
    name: str
    residual: float
    unit: str
    time: float
    hard: bool


def check_motion(
    constraints: ConstraintSet, trajectory: Trajectory
) -> tuple[tuple[ConstraintReport, ...], Violation | None]:
    """Bound each constraint along a motion for every t, and find the first violation of a hard one.

    Args:
        constraints: Constraints on the trajectory's robot.
        trajectory: Trajectory of all its joints, in its order.
    """
    reports: list[ConstraintReport] = []
    first: Violation | None = None
    for i, constraint in enumerate(constraints.constraints):
        rows = [constraints.rows[k] for k in np.flatnonzero(constraints.owners == i)]
        if not rows:
            continue
        bounds = bound_residuals(constraints.chain, rows, trajectory)
        hard = constraint.weight is None
        unit = rows[bounds.worst_row].unit
        reports.append(
            ConstraintReport(i, constraint.name, bounds.worst, unit, bounds.worst_time, hard)
        )
        if not hard or bounds.verdict == Verdict.HOLDS:
            continue
        if first is None or bounds.time < first.time:
            first = _violation(i, constraint.name, rows, bounds)
    return tuple(reports), first


def _violation(i: int, name: str, rows: Sequence[Row], bounds: ResidualBounds) -> Violation:
    """The violation of constraint i by its rows: where it begins, and how bad it gets."""
    row, worst = rows[bounds.row], rows[bounds.worst_row]
    problem = "comes too close to its bounds to be decided"
    if bounds.verdict == Verdict.VIOLATED:
        beyond = f"by {bounds.worst:.4g} {worst.unit} at {bounds.worst_time:.4g} s"
        problem = f"leaves its bounds; {worst.label} exceeds them {beyond}"
    told = name if row.label == name else f"{name}, {row.label}"
    message = f"constraint {i} ({told}) {problem}"
    details = {"constraint": i, "residual": bounds.worst, "unit": worst.unit}
    return Violation("path_constraint", bounds.time, message, details)
