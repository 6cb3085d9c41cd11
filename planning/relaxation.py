"""Why there is no path under constraints: which of them, left out, leaves a way."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from kinematics.chain import Array
from obstacles.checker import Checker
from planning.constrained_checker import ConstrainedChecker
from planning.constraints.constraint_set import ConstraintSet
from planning.deadline import Deadline
from planning.manifold import Manifold, connect


@dataclass(frozen=True, slots=True)
class Relaxation:
    """Constraints of which each, left out alone, leaves a way that was found.

    Args:
        constraints: Their numbers.
        names: What they are, in words.
    """

    constraints: tuple[int, ...]
    names: tuple[str, ...]

    @property
    def details(self) -> dict[str, Any]:
        """As values a program can use."""
        return {"constraints_that_unblock": list(self.constraints)}

    @property
    def sentence(self) -> str:
        """What would help, for a person."""
        if not self.constraints:
            return "Leaving out any one of the constraints did not help in time."
        named = zip(self.constraints, self.names, strict=True)
        texts = [f"without constraint {i} ({name})" for i, name in named]
        return f"There is a way {' or '.join(texts)}: widen it."


def relaxed(
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
    helping = []
    for place, i in enumerate(numbers):
        rest = tuple(c for j, c in enumerate(whole.constraints) if j != i)
        own = Deadline.after(deadline.remaining / (len(numbers) - place))
        if _way(checker, ConstraintSet(whole.chain, rest), start, goals, seed, own):
            helping.append(i)
    return Relaxation(tuple(helping), tuple(whole.constraints[i].name for i in helping))


def _way(
    checker: ConstrainedChecker,
    rest: ConstraintSet,
    start: Array,
    goals: list[Array],
    seed: int,
    deadline: Deadline,
) -> bool:
    plain = Checker(checker.model, checker.slack)
    spare = np.zeros(len(rest.rows))
    freer = ConstrainedChecker(plain.model, plain.slack, constraints=rest, spare=spare)
    if any(freer.free(start, goal) for goal in goals):
        return True
    return connect(Manifold(freer), start, goals, seed, deadline)[0] is not None
