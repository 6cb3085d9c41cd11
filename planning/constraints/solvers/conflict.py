"""Constraints that can't hold together: which they are, and by how much each has to give way."""

from dataclasses import dataclass

import numpy as np

from kinematics.arrays import Array
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import Constraint
from planning.constraints.solvers.active_set import descend
from planning.constraints.solvers.active_set_program import make_goal
from planning.values.deadline import Deadline

#: A configuration that is this near to holding all [m or rad] shows that they can.
_HELD = 1e-6


@dataclass(frozen=True, slots=True)
class Conflict:
    """Constraints of which any one has to give way.

    Args:
        constraints: Numbers of the constraints.
        relaxations: Widening that each of them would need if the others stay [unit];
            infinite where no width was found to do.
        message: Names of the constraints, in words.
        hint: Remedy.
    """

    constraints: tuple[int, ...]
    relaxations: tuple[float, ...]
    message: str
    hint: str


def conflict(
    constraints: ConstraintSet,
    near: Array | None = None,
    seed: int = 0,
    deadline: Deadline | None = None,
) -> Conflict | None:
    """The constraints that exclude each other, or None where some configuration holds all.

    A search, not a proof: it starts from many configurations. Joint limits count too; collisions
    do not. Where none holds all, constraints are left out one by one as long as the rest is still
    impossible (a deletion filter), until each one of those kept is needed for the conflict.

    Args:
        constraints: The hard ones count.
        near: Configuration to search from, shape (n,).
        seed: Seed of the starts.
        deadline: Instant at which the search stops. A constraint set that is not known by then to
            be impossible counts as possible, and a conflict that is known may have constraints that
            it does not need.
    """
    hard = [(i, c) for i, c in enumerate(constraints.constraints) if c.weight is None]
    hard = [(i, c) for i, c in hard if c.rows(constraints.chain)]
    chain = constraints.chain

    def possible(kept: list[tuple[int, Constraint]]) -> bool:
        own = ConstraintSet(chain, tuple(c for _, c in kept))
        # Starts from which none was found before constraints count as impossible: sets that are
        # possible at all are mostly found from one of the first three.
        worst, _ = _least_violation(own, near, seed, 60, deadline)
        return worst <= _HELD or _is_late(deadline)

    if not hard or possible(hard):
        return None
    for entry in list(hard):
        rest = [other for other in hard if other is not entry]
        if rest and not possible(rest):
            hard = rest
    numbers = tuple(i for i, _ in hard)
    relaxations = tuple(_relaxation(constraints, numbers, i, near, seed, deadline) for i in numbers)
    return _describe(constraints, numbers, relaxations)


def _describe(
    constraints: ConstraintSet, numbers: tuple[int, ...], relaxations: tuple[float, ...]
) -> Conflict:
    names = [f"constraint {i} ({constraints.constraints[i].name})" for i in numbers]
    if len(names) == 1:
        message = f"no configuration inside the joint limits was found that holds {names[0]}"
    else:
        message = f"no configuration was found that holds {' and '.join(names)} together"
    ways = []
    for i, name, wider in zip(numbers, names, relaxations, strict=True):
        row = int(np.flatnonzero(constraints.owners == i)[0])
        if np.isfinite(wider):
            # Widening that is not told as a number [m or rad].
            width = f"{wider:.4g} {constraints.rows[row].unit}" if wider > 1e-6 else "very little"
            ways.append(f"widen {name} by {width}")
        else:
            ways.append(f"leave out {name}")
    return Conflict(numbers, relaxations, message, f"Any one of these helps: {'; '.join(ways)}.")


def _relaxation(
    constraints: ConstraintSet,
    numbers: tuple[int, ...],
    give: int,
    near: Array | None,
    seed: int,
    deadline: Deadline | None,
) -> float:
    """Widening of one constraint with which the others of a conflict hold too, inf if none does."""
    chain = constraints.chain
    others = tuple(constraints.constraints[i] for i in numbers if i != give)
    alone = ConstraintSet(chain, (constraints.constraints[give],))
    rest = ConstraintSet(chain, others)
    # Weighed so much, the posture hardly counts beside it.
    # Fewer starts than before: constraints are relaxed one by one.
    worst, q = _least_violation(rest, near, seed, 12, deadline, alone, 1e4)
    if worst > _HELD:
        return float("inf")
    return float(alone.residuals(q).max())


def _least_violation(
    constraints: ConstraintSet,
    near: Array | None,
    seed: int,
    starts: int,
    deadline: Deadline | None,
    soft: ConstraintSet | None = None,
    weight: float = 0.0,
) -> tuple[float, Array]:
    """The least violation found and where; of those that hold, the one the soft ones like best."""
    chain = constraints.chain
    low, high = chain.sampling_bounds()
    first = 0.5 * (low + high) if near is None else np.array(near)
    goal = make_goal(constraints, first, np.zeros(chain.n), soft=soft)
    goal = goal._replace(weights=np.full(len(goal.soft), weight))
    random = np.random.default_rng(seed)
    best, best_q = (np.inf, np.inf), first
    for start in range(starts):
        if _is_late(deadline):
            break
        q = np.clip(first, chain.limits.lower, chain.limits.upper)
        q = np.array(q) if start == 0 else random.uniform(low, high)
        told = np.empty(2)
        try:
            descend(None, goal, q, told)
        except np.linalg.LinAlgError:  # the arm is so large that rounding hides what a step does
            continue
        rank = (max(float(told[0]), _HELD), float(told[1]))
        if rank < best:
            best, best_q = rank, q
        if soft is None and told[0] <= _HELD:
            break
    return best[0] if best[0] > _HELD else 0.0, best_q


def _is_late(deadline: Deadline | None) -> bool:
    return deadline is not None and deadline.passed
