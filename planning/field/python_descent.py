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
from obstacles.collision.model.kernel_work import Workspace, workspace
from planning.field.gradient_descent import (
    GROWTH,
    SHORTEST,
    UPHILL,
    Count,
    Gauge,
    Outcome,
    Proof,
    Rules,
    Track,
    free_force_kernel,
    is_free_kernel,
    keep_kernel,
)

#: U at a configuration (n,) [J], and -grad U, shape (n,).
Value: TypeAlias = Callable[[Array], tuple[float, Array]]
#: The joint force at a configuration (n,) that counts as none, for a share of its terms.
VanishingForce: TypeAlias = Callable[[Array, float], float]


@dataclass(frozen=True, slots=True, eq=False)
class PythonDescent:
    """Steps down a potential.

    Args:
        value: The potential and its force.
        vanishing_force: The joint force that counts as none.
        goal: Where it leads, shape (n,).
        proof: What every step is proved against.
        rules: How steps are taken.
    """

    value: Value
    vanishing_force: VanishingForce
    goal: Array
    proof: Proof
    rules: Rules

    def run(self, track: Track, until: int, across: Array, walk: int) -> int:
        """Go on until ``until`` steps were taken; the outcome.

        Args:
            track: Where it has been; written to.
            until: Steps, those of earlier calls counted.
            across: Direction of a walk to begin with, shape (n,), its largest entry 1.
            walk: Longest steps of that walk, which ends before one that is not proved.
        """
        rules, counts, gauges = self.rules, track.counts, track.gauges
        work = workspace(self.proof.model)
        if walk > 0:
            gauges[Gauge.STEP], gauges[Gauge.LOWEST], counts[Count.STALE] = rules.longest, np.inf, 0
        for _ in range(walk):
            if self._move(work, track, across, rules.longest, np.inf) == 0.0:
                break
        while True:
            if self._reaches_goal(work, track):
                return Outcome.ARRIVED
            if counts[Count.ITERATIONS] >= until:
                return Outcome.GOING
            potential = track.potentials[counts[Count.VISITED] - 1]
            is_progress = potential < (1.0 - rules.progress) * gauges[Gauge.LOWEST]
            counts[Count.STALE] = 0 if is_progress else counts[Count.STALE] + 1
            gauges[Gauge.LOWEST] = min(gauges[Gauge.LOWEST], potential)
            outcome = self._take_step(work, track)
            if outcome != Outcome.GOING:
                return outcome

    def _reaches_goal(self, work: Workspace, track: Track) -> bool:
        """Whether the goal is near enough, or in reach of a proved straight motion."""
        q, goal = track.visited[track.counts[Count.VISITED] - 1].copy(), self.goal
        away = float(((goal - q) ** 2).sum())
        if not (self.rules.connect or math.sqrt(away) < self.rules.tolerance):
            return False
        share = float(track.gauges[Gauge.LINE_BLOCKED])
        if share >= 0.0:
            # Where it was blocked from the step before it mostly still is.
            blocked = goal + share * (q - goal)
            if not is_free_kernel(self.proof, work, blocked, blocked, np.empty(4)):
                return False
        where = np.array([1.0, 0.0, 0.0, 0.0])
        if not is_free_kernel(self.proof, work, q, goal, where):
            track.gauges[Gauge.LINE_BLOCKED] = 1.0 - where[0]
            return False
        if track.counts[Count.VISITED] == 1 or away > 0.0:
            keep_kernel(track, goal.copy(), *self.value(goal))
        return True

    def _take_step(self, work: Workspace, track: Track) -> int:
        """Take one step along the force: GOING, or why there is none."""
        rules, gauges, counts = self.rules, track.gauges, track.counts
        q = track.visited[counts[Count.VISITED] - 1].copy()
        force = free_force_kernel(track.force, q, rules)
        strength = float(np.abs(force).max())
        if strength <= self.vanishing_force(q, rules.force_tolerance):
            return Outcome.MINIMUM
        if counts[Count.STALE] >= rules.patience:
            return Outcome.STALLED
        direction = force / strength
        if len(rules.sizes):
            size = rules.sizes[min(counts[Count.ITERATIONS], len(rules.sizes) - 1)]
            reach = min(float(size) * strength, rules.longest)
            is_taken = self._move(work, track, direction, reach, np.inf) > 0.0
            return Outcome.GOING if is_taken else Outcome.BLOCKED
        reach, highest = (
            float(gauges[Gauge.STEP]),
            float(track.potentials[counts[Count.VISITED] - 1]),
        )
        step = self._move(work, track, direction, reach, highest)
        gauges[Gauge.STEP] = min(GROWTH * (step if step > 0.0 else reach), rules.longest)
        if step == UPHILL:
            return Outcome.KINK
        return Outcome.GOING if step > 0.0 else Outcome.BLOCKED

    def _move(
        self, work: Workspace, track: Track, direction: Array, reach: float, highest: float
    ) -> float:
        """Move by ``reach`` at most, halved until that is proved and lower than ``highest``.

        Returns:
            Length of the move of the joint that moves most [rad or m]; 0 where none is proved,
            UPHILL where all that are proved lead higher.
        """
        q = track.visited[track.counts[Count.VISITED] - 1].copy()
        unproved, missed = 0, 0.0
        while unproved <= self.rules.halvings:
            moved = np.minimum(
                np.maximum(q + reach * direction, self.rules.lower), self.rules.upper
            )
            is_moving = bool((moved != q).any())
            if is_moving and is_free_kernel(self.proof, work, q, moved, np.empty(4)):
                potential, force = self.value(moved)
                if potential < highest:
                    keep_kernel(track, moved, potential, force)
                    track.counts[Count.ITERATIONS] += 1
                    return reach
                if reach < SHORTEST:
                    return UPHILL
                missed = UPHILL
            else:
                unproved += 1
            reach /= 2.0
        return missed
