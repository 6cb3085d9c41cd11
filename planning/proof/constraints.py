"""How well a timed motion holds its constraints, bounded for every instant."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from kinematics.trajectory import Trajectory
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.edge_bounds import HOLDS, VIOLATED, held
from planning.proof.limits import Violation

#: Samples that tell how bad a violation gets.
_SAMPLES = 1_000


@dataclass(frozen=True, slots=True)
class ConstraintReport:
    """How well a constraint is held along a motion.

    Args:
        constraint: Its number in the request.
        name: What it is, in words.
        residual: Upper bound over all t of its worst residual, negative by what is to spare; the
            largest one found where it is violated.
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
        own = ConstraintSet(constraints.chain, (constraint,))
        if not own.rows:
            continue
        found = held(own, trajectory)
        row = int(np.argmax(found.worst))
        hard = constraint.weight is None
        unit = own.rows[row].unit
        worst, time = float(found.worst[row]), float(found.times[row])
        if found.verdict == VIOLATED:
            # The proof stopped at the first violation: how bad it gets is told by samples.
            times = np.linspace(0.0, trajectory.duration, _SAMPLES)
            sampled = own.residuals(trajectory.sample(times))
            place, row = divmod(int(np.argmax(sampled)), sampled.shape[1])
            if sampled[place, row] > worst:
                worst, time, unit = (
                    float(sampled[place, row]),
                    float(times[place]),
                    own.rows[row].unit,
                )
        reports.append(ConstraintReport(i, constraint.name, worst, unit, time, hard))
        if not hard or found.verdict == HOLDS or (first is not None and first.time <= found.time):
            continue
        wrong = own.rows[found.row]
        said = f"exceeds its bounds by {found.residual:.4g} {wrong.unit}"
        if found.verdict != VIOLATED:
            said = "comes too close to its bounds to be decided"
        details: Mapping[str, Any] = {
            "constraint": i, "residual": found.residual, "unit": wrong.unit
        }  # fmt: skip
        message = f"constraint {i} ({constraint.name}, {wrong.label}) {said}"
        first = Violation("path_constraint", found.time, message, details)
    return tuple(reports), first
