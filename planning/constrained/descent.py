"""Descents of constrained inverse kinematics that end at a deadline, in the midst of a step."""

import time
from dataclasses import dataclass, field

import numpy as np

from kinematics.arrays import Array
from obstacles.collision.model.model_arrays import ModelArrays
from planning.constraints.solvers.active_set import COURSE, OVER, STAGE, go_on
from planning.constraints.solvers.active_set_program import (
    GAIN,
    LEFT,
    Goal,
    Work,
    linearise,
    make_work,
)
from planning.values.deadline import Deadline


@dataclass(slots=True, eq=False)
class Descents:
    """Descents towards one goal, before one deadline.

    Args:
        goal: Constraints and objective, for the kernels.
        deadline: Instant at which descents stop; None for never.
        longest: The longest that a linearisation took on the average of some steps [s of a
            processor]: how busy the machine is would make the count, and so the result, another.
    """

    goal: Goal
    deadline: Deadline | None
    longest: float = 0.0
    work: dict[bool, Work] = field(default_factory=dict)

    def descend(self, model: ModelArrays | None, start: Array, gain: float) -> Array:
        """The configuration (n,) that a descent from ``start`` (n,) comes to in time.

        Args:
            model: Solids to keep apart; None where there are none.
            start: Inside the joint limits.
            gain: Weight of the objective.
        """
        q, course = np.array(start), np.zeros(COURSE)
        work = self._work(model)
        work.pace[GAIN] = gain
        # Steps between two checks of the clock: those without solids take microseconds.
        steps = 40 if model is None else 2
        while course[STAGE] != OVER:
            allowed = self._allowed(model, q, work)
            if allowed <= 0.0:
                break
            work.pace[LEFT], began = allowed, time.thread_time()
            try:
                go_on(model, self.goal, q, steps, work, course)
            except np.linalg.LinAlgError:  # rounding hides what a step does: the arm is too large
                break
            if np.isfinite(allowed):
                taken = time.thread_time() - began
                self.longest = max(self.longest, taken / max(allowed - work.pace[LEFT], 1.0))
                self._note_cut(work)
        return q

    def _work(self, model: ModelArrays | None) -> Work:
        """Room for a descent, made once."""
        alone = model is None
        if alone not in self.work:
            self.work[alone] = make_work(model, self.goal)
        return self.work[alone]

    def _note_cut(self, work: Work) -> None:
        """Say so where a step ended for want of linearisations: it may have been another one."""
        if self.deadline is not None and work.pace[LEFT] <= 0.0:
            self.deadline.interruptions.occurred = True

    def _allowed(self, model: ModelArrays | None, q: Array, work: Work) -> float:
        """Linearisations that the time left is enough for; 0 where it is up."""
        if self.deadline is None or model is None:
            return 0.0 if self.deadline is not None and self.deadline.passed else np.inf
        if self.longest == 0.0:
            began = time.thread_time()
            linearise(model, self.goal, q, work)
            self.longest = time.thread_time() - began
        if self.deadline.passed:
            return 0.0
        # The dearest linearisation that was seen may be exceeded by this factor.
        return max(float(np.ceil(self.deadline.remaining / (2.0 * self.longest))), 2.0)
