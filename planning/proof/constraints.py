"""Residuals of a timed motion's constraints, bounded for every instant."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.chain import Chain
from kinematics.trajectory import Trajectory
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.row import Row
from planning.proof.residual_bounds import (
    ResidualBounds,
    Verdict,
    bound_residuals,
    sample_residuals,
)
from planning.proof.violation import Violation

#: Samples that tell about how bad a violation gets, and when.
_SAMPLES = 1_000
#: What is added to the worst sample for a bound that is tried first: share, and least [m or rad].
_ABOVE = 1e-3
_LEAST_ABOVE = 1e-6
#: Factor by which more is added where that is no bound, and how often.
_WIDENING = 4.0
_WIDENINGS = 12


@dataclass(frozen=True, slots=True)
class ConstraintReport:
    """Residual of a constraint along a motion.

    Args:
        constraint: Its number in the request.
        name: What it is, in words.
        residual: Upper bound over all t of its worst residual, negative by what is to spare.
        unit: Of the residual, "m" or "rad".
        time: About when it is worst [s].
        hard: Whether it has to hold.
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
        constraints: On the trajectory's robot.
        trajectory: Of all its joints, in its order.
    """
    reports: list[ConstraintReport] = []
    first: Violation | None = None
    for i, constraint in enumerate(constraints.constraints):
        rows = [constraints.rows[k] for k in np.flatnonzero(constraints.owners == i)]
        if not rows:
            continue
        bounds = bound_residuals(constraints.chain, rows, trajectory)
        k = int(np.argmax(bounds.worst))
        worst, time = float(bounds.worst[k]), float(bounds.times[k])
        if bounds.verdict == Verdict.VIOLATED:
            # The proof stopped at the first violation: how bad it gets is another question.
            times = np.linspace(0.0, trajectory.duration, _SAMPLES)
            samples = sample_residuals(constraints.chain, rows, trajectory, times)
            at, column = divmod(int(np.argmax(samples)), len(rows))
            if samples[at, column] > worst:
                worst, time, k = float(samples[at, column]), float(times[at]), column
            worst = _upper_bound(constraints.chain, rows, trajectory, worst)
        hard = constraint.weight is None
        reports.append(ConstraintReport(i, constraint.name, worst, rows[k].unit, time, hard))
        if not hard or bounds.verdict == Verdict.HOLDS:
            continue
        if first is None or bounds.time < first.time:
            first = _violation(i, constraint.name, rows[bounds.row], bounds)
    return tuple(reports), first


def _upper_bound(
    chain: Chain, rows: Sequence[Row], trajectory: Trajectory, sampled: float
) -> float:
    """A bound of the worst residual of rows that are violated, a little above a sampled one.

    Rows that are wider by that much hold for all t. Where none was found the largest that was
    tried is told: thousands of times the sampled one.
    """
    above = max(_ABOVE * sampled, _LEAST_ABOVE)
    for _ in range(_WIDENINGS):
        wider = sampled + above
        widened = [replace(row, lower=row.lower - wider, upper=row.upper + wider) for row in rows]
        bounds = bound_residuals(chain, widened, trajectory)
        if bounds.verdict == Verdict.HOLDS:
            return wider + max(float(bounds.worst.max()), 0.0)
        above *= _WIDENING
    return wider


def _violation(i: int, name: str, row: Row, bounds: ResidualBounds) -> Violation:
    """The violation of constraint i by one of its rows."""
    problem = f"exceeds its bounds by {bounds.residual:.4g} {row.unit}"
    if bounds.verdict == Verdict.UNDECIDED:
        problem = "comes too close to its bounds to be decided"
    message = f"constraint {i} ({name}, {row.label}) {problem}"
    details = {"constraint": i, "residual": bounds.residual, "unit": row.unit}
    return Violation("path_constraint", bounds.time, message, details)
