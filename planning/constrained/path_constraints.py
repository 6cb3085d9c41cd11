"""Constraints of a whole path: checked at its start and goals, and which of them bar the way."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidGoal
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.constrained.checker import ConstrainedChecker
from planning.constrained.ik import goal_configurations
from planning.constrained.projected_rrt import Manifold, projected_rrt, shortcut_along
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.edge_bounds import TOLERANCE
from planning.constraints.row import RowKind
from planning.constraints.solvers.conflict import conflict
from planning.planner import TOUCHING, Ready
from planning.problem import PoseGoal, Problem
from planning.result import Failure
from planning.values.deadline import Deadline


@dataclass(frozen=True, slots=True)
class Relaxation:
    """Constraints of which each, left out alone, leaves a path that was found.

    Args:
        constraints: Numbers of the constraints.
        names: Names of the constraints, for a person.
        wider: How much each has to be widened for the path that was found; less may do.
        units: Unit of each of these, "m" or "rad".
        without_obstacles: Whether a way was found that holds all constraints where no obstacle
            stands; None where there was no time to look.
    """

    constraints: tuple[int, ...]
    names: tuple[str, ...]
    wider: tuple[float, ...]
    units: tuple[str, ...]
    without_obstacles: bool | None = None

    @property
    def details(self) -> dict[str, Any]:
        """The relaxation as values a program can use."""
        return {
            "constraints_that_unblock": list(self.constraints),
            "relaxations": list(self.wider),
            "way_without_obstacles": self.without_obstacles,
        }

    @property
    def sentence(self) -> str:
        """The relaxation in one sentence."""
        known = ""
        if self.without_obstacles is not None:
            known = " Without the obstacles there is a way."
        if self.without_obstacles is False:
            known = " Without the obstacles no way was found either."
        if not self.constraints:
            return f"Leaving out any one of the constraints did not help in time.{known}"
        named = zip(self.constraints, self.names, self.wider, self.units, strict=True)
        # Widening that is not reported as a number [m or rad].
        texts = [
            f"constraint {i} ({name}) is widened by "
            + (f"{wider:.4g} {unit}" if wider > 1e-6 else "very little")
            for i, name, wider, unit in named
        ]
        return f"There is a way if {', or '.join(texts)}; less may do.{known}"


def find_relaxation(
    checker: ConstrainedChecker, start: Array, goals: list[Array], seed: int, deadline: Deadline
) -> Relaxation:
    """Leave out each constraint in turn and look for a path.

    Args:
        checker: The robot in its scene with its hard constraints.
        start: Shape (n,).
        goals: Configurations (n,).
        seed: Seed of the searches.
        deadline: Instant at which the search stops; each constraint gets its share.
    """
    every = checker.constraints
    numbers = sorted({int(i) for i in every.owners})
    helping: list[tuple[int, float, str]] = []
    alone = _without_obstacles(checker)
    until = deadline.within(deadline.remaining / (len(numbers) + 1))
    clear = alone is None or _find_path(alone, every, start, goals, seed, until) is not None
    for tried, i in enumerate(numbers):
        others = tuple(c for j, c in enumerate(every.constraints) if j != i)
        until = deadline.within(deadline.remaining / (len(numbers) - tried))
        path = _find_path(checker, ConstraintSet(every.chain, others), start, goals, seed, until)
        if path is not None:
            only = ConstraintSet(every.chain, (every.constraints[i],))
            helping.append((i, *_worst_residual(only, path)))
    return Relaxation(
        tuple(i for i, _, _ in helping),
        tuple(every.constraints[i].name for i, _, _ in helping),
        tuple(wider for _, wider, _ in helping),
        tuple(unit for _, _, unit in helping),
        None if alone is None else clear,
    )


def _without_obstacles(checker: ConstrainedChecker) -> ConstrainedChecker | None:
    """The checker of the same robot where nothing stands; None where nothing does anyway."""
    model = checker.model
    if not model.scene.ids:
        return None
    return replace(checker, model=Checker.of(model.robot, Scene(())).model)


def _worst_residual(constraint: ConstraintSet, path: Array) -> tuple[float, str]:
    """The worst residual of a constraint along a polyline (k, n), and its unit."""
    # Samples of each leg of a path at which residuals are evaluated.
    shares = np.linspace(0.0, 1.0, 33)[:, None, None]
    residuals = constraint.residuals(path[:-1] + shares * np.diff(path, axis=0))
    row = int(np.argmax(residuals.reshape(-1, residuals.shape[-1]).max(axis=0)))
    return max(float(residuals[..., row].max()), 0.0), constraint.rows[row].unit


def _find_path(
    checker: ConstrainedChecker,
    constraints: ConstraintSet,
    start: Array,
    goals: list[Array],
    seed: int,
    deadline: Deadline,
) -> Array | None:
    plain = Checker(checker.model, checker.slack)
    spare = np.zeros(len(constraints.rows))
    freer = ConstrainedChecker(plain.model, plain.slack, constraints=constraints, spare=spare)
    for goal in goals:
        if freer.free(start, goal):
            return np.array([start, goal])
    path, _ = projected_rrt(Manifold(freer), start, goals, seed, deadline)
    # The constraint is to be widened by little: a shorter path mostly violates it less.
    return None if path is None else shortcut_along(Manifold(freer), path, seed, deadline)


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
