"""Why there is no path under constraints: which of them, left out, leaves a way."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from kinematics.arrays import Array
from obstacles.checker import Checker
from planning.constrained.checker import ConstrainedChecker
from planning.constrained.projected_rrt import Manifold, projected_rrt, shortcut_along
from planning.constraints.constraint_set import ConstraintSet
from planning.deadline import Deadline

#: Places of each leg of a way at which residuals are looked at.
_LOOKED_AT = 33


@dataclass(frozen=True, slots=True)
class Relaxation:
    """Constraints of which each, left out alone, leaves a way that was found.

    Args:
        constraints: Their numbers.
        names: What they are, in words.
        wider: By how much each has to be wider for the way that was found [unit]; less may do.
        units: Of these.
    """

    constraints: tuple[int, ...]
    names: tuple[str, ...]
    wider: tuple[float, ...]
    units: tuple[str, ...]

    @property
    def details(self) -> dict[str, Any]:
        """As values a program can use."""
        return {
            "constraints_that_unblock": list(self.constraints),
            "relaxations": list(self.wider),
        }

    @property
    def sentence(self) -> str:
        """What would help, for a person."""
        if not self.constraints:
            return "Leaving out any one of the constraints did not help in time."
        named = zip(self.constraints, self.names, self.wider, self.units, strict=True)
        texts = [
            f"constraint {i} ({name}) is widened by {wider:.4g} {unit}"
            for i, name, wider, unit in named
        ]
        return f"There is a way if {', or '.join(texts)}; less may do."


def find_relaxation(
    checker: ConstrainedChecker, start: Array, goals: list[Array], seed: int, deadline: Deadline
) -> Relaxation:
    """Leave out each constraint in turn and look for a way.

    Args:
        checker: The robot in its scene with its hard constraints.
        start: Shape (n,).
        goals: Configurations (n,).
        seed: Of the searches.
        deadline: When to stop; each search gets its share.
    """
    whole = checker.constraints
    numbers = sorted({int(i) for i in whole.owners})
    helping: list[tuple[int, float, str]] = []
    for place, i in enumerate(numbers):
        rest = tuple(c for j, c in enumerate(whole.constraints) if j != i)
        own = Deadline.after(deadline.remaining / (len(numbers) - place))
        way = _way(checker, ConstraintSet(whole.chain, rest), start, goals, seed, own)
        if way is not None:
            alone = ConstraintSet(whole.chain, (whole.constraints[i],))
            helping.append((i, *_needed(alone, way)))
    return Relaxation(
        tuple(i for i, _, _ in helping),
        tuple(whole.constraints[i].name for i, _, _ in helping),
        tuple(wider for _, wider, _ in helping),
        tuple(unit for _, _, unit in helping),
    )


def _needed(constraint: ConstraintSet, way: Array) -> tuple[float, str]:
    """The worst residual of a constraint along a polyline (k, n), and its unit."""
    shares = np.linspace(0.0, 1.0, _LOOKED_AT)[:, None, None]
    residuals = constraint.residuals(way[:-1] + shares * np.diff(way, axis=0))
    row = int(np.argmax(residuals.reshape(-1, residuals.shape[-1]).max(axis=0)))
    return max(float(residuals[..., row].max()), 0.0), constraint.rows[row].unit


def _way(
    checker: ConstrainedChecker,
    rest: ConstraintSet,
    start: Array,
    goals: list[Array],
    seed: int,
    deadline: Deadline,
) -> Array | None:
    plain = Checker(checker.model, checker.slack)
    spare = np.zeros(len(rest.rows))
    freer = ConstrainedChecker(plain.model, plain.slack, constraints=rest, spare=spare)
    for goal in goals:
        if freer.free(start, goal):
            return np.array([start, goal])
    way, _ = projected_rrt(Manifold(freer), start, goals, seed, deadline)
    # What is asked for in vain is to be widened by little: the way found is made shorter first.
    return None if way is None else shortcut_along(Manifold(freer), way, seed, deadline)
