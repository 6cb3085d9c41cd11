"""Why there is no path under constraints: which of them, left out, leaves a way."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from kinematics.arrays import Array
from obstacles.collision.checker import Checker, collision_model
from obstacles.scenes.scene import Scene
from planning.constrained.checker import ConstrainedChecker
from planning.constrained.projected_rrt import Manifold, projected_rrt, shortcut_along
from planning.constraints.constraint_set import ConstraintSet
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
    return replace(checker, model=collision_model(model.robot, Scene(())))


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
