"""Constraints of a whole path, checked before planning at the start and at the goals."""

from dataclasses import replace

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidGoal
from planning.constrained.checker import ConstrainedChecker
from planning.constrained.ik import goal_configurations
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.edge_bounds import TOLERANCE
from planning.constraints.row import RowKind
from planning.constraints.solvers.conflict import conflict
from planning.planner import TOUCHING, Ready
from planning.problem import PoseGoal, Problem
from planning.result import Failure
from planning.values.deadline import Deadline


def check_widths(constraints: ConstraintSet) -> None:
    """Refuse rows that are too thin for a motion.

    Raises:
        InvalidGoal: A tolerance is below 1e-4 m or rad.
    """
    # Half a row's width along a path is at least this [m or rad]: the motion of a tool along a line
    # is made of joint motions that leave it, and a set without thickness can be left at no instant.
    # Bounds of a joint need none: straight joint motions do not leave them, so it may be locked.
    least_tolerance = 1e-4
    for i, row in enumerate(constraints.rows):
        if not np.isinf(constraints.weights[i]) or row.kind == RowKind.JOINT:
            continue
        half = row.width if np.isinf(row.lower) else 0.5 * row.width
        if half < least_tolerance * (1.0 - 1e-9):
            raise InvalidGoal(
                f"{constraints.label(i)} has a tolerance of {half:.3g} {row.unit}: along a path "
                f"{least_tolerance:g} {row.unit} at least are needed",
                hint="Widen its tolerance or region; a millimetre is easily held.",
                constraint=int(constraints.owners[i]),
                tolerance=half,
                relaxation=least_tolerance - half,
                unit=row.unit,
            )


def apply_path_constraints(
    problem: Problem, ready: Ready | Failure, seed: int, deadline: Deadline | None = None
) -> Ready | Failure:
    """Bring the path's constraints into a problem that is ready: into its goals and checkers.

    Args:
        problem: Problem with its constraints.
        ready: Result of preflight; a failure is handed on.
        seed: Seed of inverse kinematics.
        deadline: Instant at which the search for goals, or for a conflict, is given up.

    Returns:
        The problem with the goals that hold the constraints and checkers that know them, or why
        the start or every goal violates them.

    Raises:
        InvalidGoal: A constraint is too thin for a motion.
    """
    constraints = problem.constraints
    if isinstance(ready, Failure) or constraints is None or not constraints.hard.rows:
        return ready
    hard = constraints.hard
    check_widths(hard)
    row = _violated_row(constraints, ready.start)
    goals = [q for q in ready.goals if _violated_row(constraints, q) is None]
    if row is not None or not goals:
        failure = _conflict_failure(constraints, ready.start, seed, deadline)
        if failure is not None:
            return failure
    if row is not None:
        return _violation_failure(constraints, "start", ready.start, row)
    goals = goals or _constrained_goals(problem, ready, seed, deadline)
    if not goals:
        nearest = min(ready.goals, key=lambda q: float(hard.residuals(q).max()))
        row = _violated_row(constraints, nearest)
        assert row is not None
        return _violation_failure(constraints, "goal", nearest, row)
    spare = -np.max([hard.residuals(q) for q in (ready.start, *goals)], axis=0)
    checkers = tuple(
        ConstrainedChecker(checker.model, checker.slack, constraints=hard, spare=spare)
        for checker in ready.checkers
        if all(checker.valid(q) for q in goals)
    )
    return replace(ready, goals=goals, best=None, checkers=checkers or ready.checkers[-1:])


def _conflict_failure(
    constraints: ConstraintSet, start: Array, seed: int, deadline: Deadline | None
) -> Failure | None:
    """Why no configuration at all holds the constraints, where none does."""
    contradiction = conflict(constraints, start, seed, deadline)
    if contradiction is None:
        return None
    return Failure(
        code="INVALID_GOAL_CONSTRAINTS",
        message=contradiction.message,
        hint=contradiction.hint,
        stage="constraints",
        details={
            "constraints": list(contradiction.constraints),
            "relaxations": list(contradiction.relaxations),
        },
    )


def end_violation(constraints: ConstraintSet | None, which: str, q: Array) -> Failure | None:
    """The failure of a "start" or "goal" at q (n,) that violates a constraint, if it does."""
    row = None if constraints is None else _violated_row(constraints, q)
    if constraints is None or row is None:
        return None
    return _violation_failure(constraints, which, q, row)


def _violated_row(constraints: ConstraintSet, q: Array) -> int | None:
    """Number of the hard row that q (n,) violates most, if it violates one."""
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
            "constraint": int(constraints.owners[row]),
            "residual": residual,
            "unit": unit,
            "value": float(constraints.values(q)[row]),
        },
    )


def _constrained_goals(
    problem: Problem, ready: Ready, seed: int, deadline: Deadline | None
) -> list[Array]:
    """Configurations of the goal poses, within their tolerances, that hold all constraints."""
    assert problem.constraints is not None
    goals: list[Array] = []
    checker = ready.checkers[-1]
    hard = problem.constraints.hard.constraints
    geometric = tuple(c for c in hard if c.rows(checker.model.robot.chain))
    for goal in problem.goals:
        if not isinstance(goal, PoseGoal):
            continue
        solutions = goal_configurations(problem, goal, ready.start, seed, geometric, deadline)
        goals += [np.array(s.joints) for s in solutions if s.clearance > TOUCHING]
    return [q for q in goals if checker.valid(q)]
