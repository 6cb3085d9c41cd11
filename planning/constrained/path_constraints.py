"""Constraints of a whole path, before planning: do start and goal hold them, can anything?"""

from dataclasses import replace

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidGoal
from planning.constrained.checker import ConstrainedChecker
from planning.constrained.pose_goals import goal_configurations
from planning.constraints.conflict import conflict
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.edge_bounds import TOLERANCE
from planning.problem import PoseGoal, Problem
from planning.ready import TOUCHING, Ready
from planning.result import Failure

#: Half a row's width along a path is at least this [m or rad]: the motion of a tool along a line
#: is made of joint motions that leave it, and a set without thickness can be left at no instant.
LEAST_TOLERANCE = 1e-4


def check_widths(constraints: ConstraintSet) -> None:
    """Refuse rows that are too thin for a motion.

    Raises:
        InvalidGoal: A tolerance is below 1e-4 m or rad.
    """
    for i, row in enumerate(constraints.rows):
        if not np.isinf(constraints.weights[i]):
            continue
        half = row.width if np.isinf(row.lower) else 0.5 * row.width
        if half < LEAST_TOLERANCE * (1.0 - 1e-9):
            raise InvalidGoal(
                f"{constraints.label(i)} has a tolerance of {half:.3g} {row.unit}: along a path "
                f"{LEAST_TOLERANCE:g} {row.unit} at least are needed",
                hint="Widen its tolerance or region; a millimetre is easily held.",
                constraint=int(constraints.owners[i]), tolerance=half,
                relaxation=LEAST_TOLERANCE - half, unit=row.unit,
            )  # fmt: skip


def apply_path_constraints(problem: Problem, ready: Ready | Failure, seed: int) -> Ready | Failure:
    """What is ready, with goals and checkers that hold the path's constraints, or why none does.

    Raises:
        InvalidGoal: A constraint is too thin for a motion.
    """
    whole = problem.constraints
    if isinstance(ready, Failure) or whole is None or not whole.hard.rows:
        return ready
    hard = whole.hard
    check_widths(hard)
    wrong = _violated_row(whole, ready.start)
    if wrong is not None or not any(_violated_row(whole, q) is None for q in ready.goals):
        found = conflict(whole, ready.start, seed)
        if found is not None:
            details = {
                "constraints": list(found.constraints), "relaxations": list(found.relaxations)
            }  # fmt: skip
            code = "INVALID_GOAL_CONSTRAINTS"
            return Failure(code, found.message, found.hint, "constraints", details=details)
    if wrong is not None:
        return _violation_failure(whole, "start", ready.start, wrong)
    goals = [q for q in ready.goals if _violated_row(whole, q) is None]
    goals = goals or _constrained_goals(problem, ready, seed)
    if not goals:
        nearest = min(ready.goals, key=lambda q: float(hard.residuals(q).max()))
        row = _violated_row(whole, nearest)
        assert row is not None
        return _violation_failure(whole, "goal", nearest, row)
    spare = -np.max([hard.residuals(q) for q in (ready.start, *goals)], axis=0)
    checkers = tuple(
        ConstrainedChecker(checker.model, checker.slack, constraints=hard, spare=spare)
        for checker in ready.checkers
        if all(checker.valid(q) for q in goals)
    )
    return replace(ready, goals=goals, checkers=checkers or ready.checkers[-1:])


def end_violation(constraints: ConstraintSet | None, which: str, q: Array) -> Failure | None:
    """Say what the "start" or "goal" at q (n,) violates most, if it violates anything."""
    row = None if constraints is None else _violated_row(constraints, q)
    if constraints is None or row is None:
        return None
    return _violation_failure(constraints, which, q, row)


def _violated_row(constraints: ConstraintSet, q: Array) -> int | None:
    """The hard row that is violated most, if one is."""
    residuals = np.where(np.isinf(constraints.weights), constraints.residuals(q), -np.inf)
    row = int(np.argmax(residuals))
    return row if residuals[row] > TOLERANCE else None


def _violation_failure(constraints: ConstraintSet, which: str, q: Array, row: int) -> Failure:
    residual, unit = float(constraints.residuals(q)[row]), constraints.rows[row].unit
    code = "START_STATE_VIOLATES" if which == "start" else "GOAL_VIOLATES"
    return Failure(
        code=f"{code}_PATH_CONSTRAINTS",
        message=f"the {which} violates {constraints.label(row)} by {residual:.4g} {unit}",
        hint=f"Move the {which} (inverse kinematics takes the same constraints), or widen the "
        f"constraint by {residual:.4g} {unit}.",
        stage=which,
        details={
            "constraint": int(constraints.owners[row]), "residual": residual, "unit": unit,
            "value": float(constraints.values(q)[row]),
        },
    )  # fmt: skip


def _constrained_goals(problem: Problem, ready: Ready, seed: int) -> list[Array]:
    """Goals by constrained inverse kinematics: poses inside their tolerances that hold all."""
    assert problem.constraints is not None
    goals: list[Array] = []
    checker = ready.checkers[-1]
    hard = problem.constraints.hard.constraints
    geometric = tuple(c for c in hard if c.rows(checker.model.chain))
    for goal in problem.goals:
        if not isinstance(goal, PoseGoal):
            continue
        found = goal_configurations(problem, goal, ready.start, seed, geometric)
        goals += [np.array(s.joints) for s in found if s.clearance > TOUCHING]
    return [q for q in goals if checker.valid(q)]
