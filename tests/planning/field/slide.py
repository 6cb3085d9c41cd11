"""A ball on two slides that descends on a potential whose force is known in closed form."""

from typing import Any

import numpy as np

from kinematics.arrays import Array
from obstacles.collision.checker import Checker
from obstacles.projection.projection import Projector
from obstacles.scenes.scene import Scene
from planning.constraints.row import WIDTH
from planning.field.control_points import origin_points
from planning.field.gradient_descent import (
    ITERATIONS,
    VISITED,
    Proof,
    Rules,
    Track,
    descend_kernel,
    keep_kernel,
)
from planning.field.options import FieldOptions
from planning.field.potential import Field
from planning.field.python_descent import PythonDescent
from planning.field.weights import FieldWeights
from tests.planning.slider import slider

_CAPACITY = 500


class Slide:
    """One descent of the slider, by the kernel or in Python.

    Args:
        engine: "kernel" or "python".
        start: Where it begins, shape (2,) [m].
        goal: Shape (2,) [m].
        scene: What stands in the way.
        rows: Rows of constraints, shape (r, WIDTH).
        slack: Distance to keep beyond margins [m].
        repulsive: eta of the ball's middle [N m^3]. Its pull grows all the way: far from obstacles
            U = |q - goal|^2 / 2.
        options: Of ``FieldOptions``.
    """

    def __init__(
        self,
        engine: str,
        start: list[float],
        goal: list[float],
        scene: Scene | None = None,
        rows: Array | None = None,
        slack: float = 0.0,
        repulsive: float = 1e-6,
        **options: Any,
    ) -> None:
        robot, around = slider(), scene or Scene()
        limits = robot.chain.limits
        self.checker = Checker(Checker.of(robot, around).model, slack)
        self.rules: Rules = FieldOptions(**options).rules(limits.lower, limits.upper)
        constraints = np.zeros((0, WIDTH)) if rows is None else np.array(rows)
        self._proof = Proof(self.checker.model.arrays, slack, constraints)
        where = origin_points(robot.chain)
        spring = FieldWeights((0.0, 1.0), attractive_cap=10.0, repulsive_weights=(0.0, repulsive))
        self.field = Field(robot.chain, where, Projector(around), np.array(goal), spring)
        self._python = PythonDescent(
            self.field.value, self.field.vanishing_force, np.array(goal), self._proof, self.rules
        )
        self._engine = engine
        self.track = Track(
            np.empty((_CAPACITY, 2)),
            np.empty(_CAPACITY),
            np.empty(2),
            np.array([self.rules.longest, np.inf, -1.0, -1.0]),
            np.zeros(3, dtype=np.int64),
        )
        q = np.array(start)
        keep_kernel(self.track, q, *self.field.value(q))

    def go(self, until: int, across: Array | None = None, walk: int = 0) -> int:
        """Descend until so many steps were taken, after a walk; the outcome."""
        direction = np.zeros(2) if across is None else across
        if self._engine == "python":
            return self._python.run(self.track, until, direction, walk)
        return int(
            descend_kernel(
                self._proof, self.rules, self.field.model, self.track, until, direction, walk
            )
        )

    @property
    def visited(self) -> Array:
        """Configurations so far, shape (k, 2) [m]."""
        return self.track.visited[: self.track.counts[VISITED]].copy()

    @property
    def potentials(self) -> Array:
        """U at each of them, shape (k,) [J]."""
        return self.track.potentials[: self.track.counts[VISITED]].copy()

    @property
    def iterations(self) -> int:
        """Steps taken so far."""
        return int(self.track.counts[ITERATIONS])

    @property
    def steps(self) -> Array:
        """How far the joint that moved most moved in each step, shape (k - 1,) [m]."""
        return np.asarray(np.abs(np.diff(self.visited, axis=0)).max(axis=1))
