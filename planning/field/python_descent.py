"""Gradient descent on a potential whose values come from Python, each step proved free.

The same rules as ``gradient_descent.descend_kernel``, step for step, for potentials that kernels
can't evaluate. The motions are proved by the same kernel.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from kinematics.arrays import Array
from obstacles.kernel_work import Workspace, workspace
from planning.field.gradient_descent import (
    ARRIVED,
    BLOCKED,
    FLAT,
    GOING,
    GROWTH,
    ITERATIONS,
    LOWEST,
    NO_FORCE,
    PROGRESS,
    STALE,
    STEP,
    STRONGEST,
    STUCK,
    VISITED,
    Proof,
    Rules,
    Track,
    is_free_kernel,
    keep_kernel,
)

#: U at a configuration (n,) [J], and -grad U, shape (n,).
Value: TypeAlias = Callable[[Array], tuple[float, Array]]


@dataclass(frozen=True, slots=True, eq=False)
class PythonDescent:
    """Steps down a potential.

    Args:
        value: The potential and its force.
        goal: Where it leads, shape (n,).
        proof: What every step is proved against.
        rules: How steps are taken.
    """

    value: Value
    goal: Array
    proof: Proof
    rules: Rules

    def run(self, track: Track, until: int, across: Array, walk: int) -> int:
        """Go on until ``until`` steps were taken: ARRIVED, STUCK or GOING.

        Args:
            track: Where it has been; written to.
            until: Steps, those of earlier calls counted.
            across: Direction of a walk to begin with, shape (n,), its largest entry 1.
            walk: Longest steps of that walk, which ends before one that is not proved.
        """
        rules, counts, gauges = self.rules, track.counts, track.gauges
        work = workspace(self.proof.model)
        if walk > 0:
            gauges[STEP], gauges[LOWEST], counts[STALE] = rules.longest, np.inf, 0
        for _ in range(walk):
            if self._move(work, track, across, rules.longest, np.inf) == 0.0:
                break
        while True:
            if self._reaches_goal(work, track):
                return ARRIVED
            if counts[ITERATIONS] >= until:
                return GOING
            potential = track.potentials[counts[VISITED] - 1]
            progress = potential < (1.0 - PROGRESS) * gauges[LOWEST]
            counts[STALE] = 0 if progress else counts[STALE] + 1
            gauges[LOWEST] = min(gauges[LOWEST], potential)
            if counts[STALE] >= rules.patience or not self._take_step(work, track):
                return STUCK

    def _reaches_goal(self, work: Workspace, track: Track) -> bool:
        """Whether the goal is near enough, or in reach of a proved straight motion."""
        q, goal = track.visited[track.counts[VISITED] - 1].copy(), self.goal
        away = float(((goal - q) ** 2).sum())
        if not (self.rules.connect or math.sqrt(away) < self.rules.tolerance):
            return False
        share = float(track.gauges[BLOCKED])
        if share >= 0.0:
            # Where it was blocked from the step before it mostly still is.
            blocked = goal + share * (q - goal)
            if not is_free_kernel(self.proof, work, blocked, blocked, np.empty(4)):
                return False
        where = np.array([1.0, 0.0, 0.0, 0.0])
        if not is_free_kernel(self.proof, work, q, goal, where):
            track.gauges[BLOCKED] = 1.0 - where[0]
            return False
        if track.counts[VISITED] == 1 or away > 0.0:
            keep_kernel(track, goal.copy(), *self.value(goal))
        return True

    def _take_step(self, work: Workspace, track: Track) -> bool:
        """Take one step along the force; False where there is none, or none that is proved."""
        rules, gauges, counts = self.rules, track.gauges, track.counts
        force = track.force.copy()
        strength = float(np.abs(force).max())
        gauges[STRONGEST] = max(gauges[STRONGEST], strength)
        if strength <= NO_FORCE * gauges[STRONGEST]:
            counts[FLAT] = 1
            return False
        direction = force / strength
        if len(rules.sizes):
            size = rules.sizes[min(counts[ITERATIONS], len(rules.sizes) - 1)]
            reach = min(float(size) * strength, rules.longest)
            return self._move(work, track, direction, reach, np.inf) > 0.0
        reach, highest = float(gauges[STEP]), float(track.potentials[counts[VISITED] - 1])
        step = self._move(work, track, direction, reach, highest)
        gauges[STEP] = min(GROWTH * (step if step > 0.0 else reach), rules.longest)
        return step > 0.0

    def _move(
        self, work: Workspace, track: Track, direction: Array, reach: float, highest: float
    ) -> float:
        """Move by ``reach`` at most, halved until that is proved and lower than ``highest``.

        Returns:
            How far it moved, 0 for not at all.
        """
        q = track.visited[track.counts[VISITED] - 1].copy()
        for _ in range(self.rules.halvings + 1):
            moved = np.minimum(
                np.maximum(q + reach * direction, self.rules.lower), self.rules.upper
            )
            is_moving = bool((moved != q).any())
            if is_moving and is_free_kernel(self.proof, work, q, moved, np.empty(4)):
                potential, force = self.value(moved)
                if potential < highest:
                    keep_kernel(track, moved, potential, force)
                    track.counts[ITERATIONS] += 1
                    return reach
            reach /= 2.0
        return 0.0
