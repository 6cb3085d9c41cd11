"""Optimisation of a motion that is known: what it offers is better, or it offers nothing."""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array
from kinematics.trajectory.trajectory import Trajectory
from planning.optimize.iterate import Candidate, fit_spline
from planning.optimize.objective import value
from planning.optimize.scp import Descent
from planning.optimize.spline import SplineSpace
from planning.optimize.task import Obstruction, Task
from planning.timing.options import TimingFailed
from planning.timing.parametrization import TimeParametrization
from planning.timing.path.path import JointPath
from planning.timing.time_scaling import dilate
from planning.values.deadline import Deadline
from planning.values.limits import JERK_JUMP
from planning.values.optimize_options import CONTROL_POINTS, RefineOptions


class RefinedMotion(NamedTuple):
    """Motion that refinement found better than the known one.

    Args:
        trajectory: Trajectory in time.
        waypoints: Waypoints on the motion's path, shape (k, n).
        value: Value of the objective.
    """

    trajectory: Trajectory
    waypoints: Array
    value: float


@dataclass(slots=True)
class Refinement:
    """One motion being optimised.

    Args:
        task: Requirements on the motion.
        options: Objective and solver.
        parametrization: How paths are timed.
        known: The motion to start from.
        deadline: Instant at which optimising stops.
        binding: Whether the motion may be kept; else anything within the limits is better.
    """

    task: Task
    options: RefineOptions
    parametrization: TimeParametrization
    known: Trajectory
    deadline: Deadline
    binding: bool = True
    value: float = field(init=False)
    _descent: Descent = field(init=False)

    def __post_init__(self) -> None:
        if not self.retimes:
            self.task = self._with_jerk()
        self.value = self._objective(self.known)
        space = SplineSpace.uniform(self.options.least_degree, self._count())
        start = fit_spline(self.task, space, self.known)
        self._descent = Descent(self.task, self.options, start, self._longest(), self.deadline)

    def _with_jerk(self) -> Task:
        """The task with the robot's own jerk limits: a spline's acceleration does not jump."""
        jerk = self.task.chain.limits.jerk
        if "jerk" in self.task.bounds or not np.isfinite(jerk).any():
            return self.task
        bounds = dict(self.task.bounds) | {"jerk": np.where(np.isnan(jerk), np.inf, jerk)}
        return replace(self.task, bounds=bounds)

    def _count(self) -> int:
        least = self.options.least_degree + 5
        # Control points where nobody says how many: 16 are enough for a dozen corners.
        return int(np.clip(self.options.control_points or 16, least, CONTROL_POINTS[1]))

    def _longest(self) -> float:
        if self.options.duration is not None:
            return self.options.duration
        fast = "time" in self.options.weights
        # A motion for which little time counts not at all may take so many times what it took.
        return np.inf if fast else 1.25 * self.known.duration

    @property
    def retimes(self) -> bool:
        """Whether the path of a spline is timed anew in the end."""
        return (
            self.options.fastest
            and self.task.still
            and self.parametrization.method.follows_path
            and self.options.least_degree <= 3
        )

    @property
    def rounds(self) -> int:
        """Convex problems solved so far."""
        return self._descent.rounds

    @property
    def obstruction(self) -> Obstruction:
        """Why nothing better was found."""
        if self._descent.best is not None:
            which = "shorter" if self.options.fastest else "better"
            return Obstruction(f"nothing {which} was found", "Use more control_points.")
        found = self._descent.obstruction
        late = Obstruction("time was up before a motion was found", "Allow more time.")
        return found or late

    def offer(self, deadline: Deadline) -> RefinedMotion | None:
        """Optimise; the best motion if it is better than the known one."""
        self._descent.run(deadline)
        best = self._descent.best
        if best is None:
            return None
        motion, worth = self._faster(best)
        # What gains less than this part of the objective is left as it was.
        if self.binding and not worth < self.value * (1.0 - 1e-6):
            return None
        iterate = best.iterate
        return RefinedMotion(motion, iterate.sample(np.asarray(iterate.space.breaks)), worth)

    def reject(self, offer: RefinedMotion, time: float) -> None:
        """An offer could not be proved free at a time [s]: keep away from there, and go on."""
        best = self._descent.best
        if best is not None:
            self._descent.reject(_place(best, offer.trajectory.sample([time])[0]))
        # Rounds that follow when a motion could not be proved.
        self._descent.add_rounds(4)

    def _faster(self, best: Candidate) -> tuple[Trajectory, float]:
        """The spline as it is, or its path timed by the parametrization where that is faster."""
        if not self.retimes:
            return best.trajectory, best.value
        lengths = np.diff(best.iterate.space.breaks) * best.iterate.duration
        motion = best.iterate.trajectory(self.task.chain.joint_names)
        try:
            timed = self.parametrization.time(
                JointPath(motion.coefficients, lengths), motion.joint_names
            )
        except TimingFailed:
            motion = self._within_jerk(best.trajectory)
            return motion, self._objective(motion)
        motions = [self._within_jerk(found) for found in (timed.trajectory, best.trajectory)]
        return min(((m, self._objective(m)) for m in motions), key=lambda pair: pair[1])

    def _objective(self, motion: Trajectory) -> float:
        loaded_chain = self.task.loaded_chain or self.task.chain
        return value(motion, self.options.weights, loaded_chain, self.task.soft)

    def _within_jerk(self, motion: Trajectory) -> Trajectory:
        """The motion; where its acceleration does not jump, within the robot's jerk limits too."""
        limits = self.task.chain.limits.jerk
        if motion.continuity().acceleration > JERK_JUMP or not np.isfinite(limits).any():
            return motion
        return dilate(motion, jerk=np.where(np.isfinite(limits), limits, np.inf)).trajectory


def _place(candidate: Candidate, q: Array) -> float:
    """The place u of a spline that is nearest to a configuration on its path."""
    # A place of a motion is found among so many of its spline.
    u = np.linspace(0.0, 1.0, 1001)
    return float(u[np.argmin(np.square(candidate.iterate.sample(u) - q).sum(axis=1))])
