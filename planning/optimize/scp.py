"""Optimisation of a motion that is known: what it offers is better, or it offers nothing.

Sequential convex optimisation of a motion.

Around the last iterate the limits are replaced by linear rows on their safe side, distances, loads
and constraints by their linear parts, the objective by a convex quadratic; a trust region keeps the
next iterate near. All linearised rows share one slack that costs more than it can gain. Where an
iterate violates more than it did before by much, it is dropped and the trust region shrinks.
Iterates that violate nothing in the places looked at are looked at for every instant; where that
finds a collision, its place is looked at too from then on, with a little more to spare.

Source: "Motion planning with sequential convex optimization and convex collision checking",
International Journal of Robotics Research, 2014.
"""

import time
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from scipy import sparse

from kinematics.arrays import Array
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory
from planning.optimize import objective, program
from planning.optimize.iterate import Candidate, Iterate, blocked_places, fit_spline, least_duration
from planning.optimize.linearization import (
    Checkpoints,
    Linearization,
    Rows,
    end_rows,
    least_factor,
    limit_rows,
    linearize,
    stack_rows,
)
from planning.optimize.objective import value
from planning.optimize.quadratic import Quadratic
from planning.optimize.spline import SplineSpace
from planning.optimize.task import Obstruction, Task
from planning.timing.options import TimingFailed
from planning.timing.parametrization import TimeParametrization
from planning.timing.path.path import JointPath
from planning.timing.speed.effort_limits import estimate_uses, slow_down
from planning.timing.time_scaling import ScaledTime, dilate, fitting_factor, peak_ratios
from planning.values.deadline import Deadline
from planning.values.limits import JERK_JUMP
from planning.values.optimize_options import CONTROL_POINTS, RefineOptions

#: Half width of the trust region in the first round: control points move at most this far
#: [rad or m].
_REACH = 0.3
#: Distance kept at checkpoints beyond the margins, since there is motion between them [m].
_SPARE = 1e-3
#: The first round takes about so many times as long as the look before it.
_FIRST = 3.0
#: Ratios to limits that are equal to 1 but for rounding.
_ROUNDING = 1e-9


_QUANTITIES = ("velocity", "acceleration", "jerk")
_LIMITS = "Raise the limits, or lower the velocities at the ends."
_BETWEEN = Obstruction(
    "the motion is not free between its checkpoints",
    "Use more control_points or rounds, or lower the margin.",
)


@dataclass(slots=True)
class Descent:
    """The rounds of one optimisation.

    Args:
        task: Requirements on the motion.
        options: Objective and solver.
        iterate: Current iterate.
        longest: The longest the motion may take [s].
        deadline: Instant at which it stops; it may be put off by ``run``.
    """

    task: Task
    options: RefineOptions
    iterate: Iterate
    longest: float
    deadline: Deadline
    rounds: int = 0
    most_rounds: int = field(init=False)
    best: Candidate | None = None
    reach: float = _REACH
    places: Checkpoints = field(init=False)
    look_time: float = field(init=False)
    linearization: Linearization = field(init=False)
    obstruction: Obstruction | None = None

    def __post_init__(self) -> None:
        self.most_rounds = self.options.rounds
        space = self.iterate.space
        # About 64 checkpoints in all, three in each piece at most.
        each = int(np.clip(np.ceil(64 / space.pieces), 1, 3))
        self.places = Checkpoints.uniform(space.breaks, each, _SPARE)
        began = time.monotonic()
        if self.task.still:
            self.iterate = self._slow_or_speed_up(self.iterate)
        self.linearization = self._linearize(self.iterate)
        self._keep_if_better(self.iterate)
        self.look_time = time.monotonic() - began

    def run(self, deadline: Deadline) -> None:
        """Go on until rounds no longer gain, or the rounds or the time are used up."""
        self.deadline = deadline
        longest = _FIRST * self.look_time
        while self.rounds < self.most_rounds and not deadline.sooner_than(longest):
            self.rounds += 1
            began = time.monotonic()
            if not self._run_round():
                return
            longest = max(longest, time.monotonic() - began)

    def add_rounds(self, rounds: int) -> None:
        """Let so many rounds follow those that there have been."""
        self.most_rounds = self.rounds + rounds

    def reject(self, place: float) -> None:
        """The best motion could not be proved free at this place: it is out."""
        self.best = None
        self._add([place])

    def _run_round(self) -> bool:
        """One convex problem and what comes of it; whether another may gain."""
        problem, z = self._solve_round()
        if z is None:
            self.obstruction = Obstruction("no motion near the last one keeps all limits", _LIMITS)
            return self._shrink()
        excess = self._duration_excess(self.iterate)
        here = np.append(self.iterate.points.ravel(), [self.iterate.duration, excess])
        # A round that gains less than this part of the objective is the last [-].
        gain = 2e-3
        if self.linearization.violation == 0.0 and problem.value(here) - problem.value(z) < gain:
            return False
        following = self._next_iterate(z)
        linearized = self._linearize(following)
        before, after = self._value(self.iterate), self._value(following)
        # A violation may double from round to round, and more up to 1, which is much.
        worse = linearized.violation > max(2.0 * self.linearization.violation, 1.0)
        shortened = excess - self._duration_excess(following)
        no_better = linearized.violation >= self.linearization.violation and shortened <= 0.0
        if worse or (after > before * (1.0 + gain) and no_better):
            return self._shrink()
        self.iterate, self.linearization = following, linearized
        if linearized.violation > 0.0:
            self.obstruction = linearized.obstruction
            return True
        places = self._keep_if_better(following)
        return bool(places) or shortened > gain or before - after > gain * abs(before)

    def _duration_excess(self, iterate: Iterate) -> float:
        """Share of the longest duration by which a motion exceeds it; 0 where it does not."""
        return max(iterate.duration / self.longest - 1.0, 0.0)

    def _linearize(self, iterate: Iterate) -> Linearization:
        return linearize(self.task, iterate, self.places, self.reach, self.deadline)

    def _shrink(self) -> bool:
        self.reach *= 0.4
        # With a narrower trust region another round is not worth its time [rad or m].
        return self.reach >= 0.002

    def _solve_round(self) -> tuple[Quadratic, Array | None]:
        """The problem of a round, and the unknowns that solve it if any were found."""
        task, iterate = self.task, self.iterate
        H, g = objective.model(task, self.options.weights, iterate)
        scale = max(self._value(iterate), np.finfo(float).tiny)
        g = g / scale
        # The slack costs 20 times the objective.
        g[-1] = 20.0
        # Motions that are not at rest at an end can't be slowed down: limits are aimed at from
        # below.
        hair = 0.0 if task.still else 1e-5
        others = [
            *end_rows(iterate, task.start, task.end),
            *self._time_row(),
            *self.linearization.rows,
        ]
        rows = stack_rows([*limit_rows(task, iterate, hair), *others])
        problem = Quadratic(H / scale, g, rows.A, rows.lower, rows.upper, *self._bounds())
        if self.options.solver == "piqp":
            return problem, problem.solve()
        start = np.append(iterate.points.ravel(), [iterate.duration, 0.0])
        limits = {order: (1.0 - hair) * value for order, value in task.orders.items()}
        none = Rows.below(sparse.csr_matrix((0, len(g))), np.zeros(0))
        return problem, program.solve(
            iterate.space, limits, stack_rows([none, *others]), problem, start
        )

    def _time_row(self) -> list[Rows]:
        """The duration's bound, which may be violated while no motion that short is known."""
        if not np.isfinite(self.longest):
            return []
        row = np.zeros((1, self.iterate.points.size + 2))
        row[0, -2:] = 1.0 / self.longest, -1.0
        return [Rows.below(row, np.ones(1))]

    def _bounds(self) -> tuple[Array, Array]:
        """The trust region within the joints' ranges; control points at ends at rest are fixed."""
        points, task = self.iterate.points, self.task
        limits = task.chain.limits
        least = np.maximum(points - self.reach, limits.lower)
        most = np.minimum(points + self.reach, limits.upper)
        # The end itself may lie on a limit, or past it by what is tolerated.
        for given, own in ((task.start, slice(None)), (task.end, slice(None, None, -1))):
            fixed = given.order + 1 if given.still else 1
            least[own][:fixed] = most[own][:fixed] = given.position
        T = self.iterate.duration
        # The duration stays within 0.3 and 3 times the last one.
        return (
            np.append(np.minimum(least, most).ravel(), [0.3 * T, 0.0]),
            np.append(np.maximum(least, most).ravel(), [3.0 * T, np.inf]),
        )

    def _next_iterate(self, z: Array) -> Iterate:
        """The next iterate: ends made exact, and as slow as the exact extrema ask for."""
        points = z[:-2].reshape(self.iterate.points.shape)
        limits = self.task.chain.limits
        points = np.clip(points, limits.lower, limits.upper)
        space, T = self.iterate.space, float(z[-2])
        ended = Iterate(space, points, T).with_ends(self.task.start, self.task.end)
        return self._slow_or_speed_up(ended) if self.task.still else ended

    def _slow_or_speed_up(self, iterate: Iterate) -> Iterate:
        """As slow as the exact extrema and the loads ask for; as fast, where only time counts."""
        loaded = iterate.duration * least_factor(self.task, iterate, self.places)
        least = max(least_duration(self.task, iterate.space, iterate.points), loaded)
        T = least if self.options.fastest else max(iterate.duration, least)
        return Iterate(iterate.space, iterate.points, T)

    def _value(self, iterate: Iterate) -> float:
        return self._objective(iterate.trajectory(self.task.chain.joint_names))

    def _objective(self, motion: Trajectory) -> float:
        return value(motion, self.options.weights, self._loaded_chain, self.task.soft)

    @property
    def _loaded_chain(self) -> Chain:
        return self.task.loaded_chain or self.task.chain

    def _keep_if_better(self, iterate: Iterate) -> list[float]:
        """Keep an iterate that violates nothing if it is the best; places where it is not free."""
        if self.linearization.violation > 0.0:
            return []
        places = blocked_places(self.task.checker, iterate)
        if places:
            self._add(places)
            self.obstruction = _BETWEEN
            return places
        found = self._candidate(iterate)
        if found is not None and (self.best is None or found.value < self.best.value):
            self.best = found
        return []

    def _candidate(self, iterate: Iterate) -> Candidate | None:
        motion = iterate.trajectory(self.task.chain.joint_names)
        loads = self.task.loads
        factor = fitting_factor(motion, **self.task.bounds)
        if self.task.still:
            motion = motion.dilate(max(factor, 1.0) * (1.0 + 1e-12))
            try:
                motion = (
                    motion
                    if loads is None
                    else slow_down(loads, ScaledTime(motion, 1.0)).trajectory
                )
            except TimingFailed as failure:
                self.obstruction = Obstruction(failure.message, failure.hint or _LIMITS)
                return None
        elif factor > 1.0 + _ROUNDING or self._exceeds_effort_limits(motion):
            self.obstruction = self._worst_limit(motion)
            return None
        if motion.duration > self.longest * (1.0 + _ROUNDING):
            message = f"the shortest motion that was found takes {motion.duration:.4g} s"
            self.obstruction = Obstruction(message, "Allow a longer duration, or raise the limits.")
            return None
        return Candidate(iterate, motion, self._objective(motion))

    def _worst_limit(self, motion: Trajectory) -> Obstruction:
        """Limit that a motion exceeds the most, with the ratio."""
        names = self.task.chain.joint_names
        ratios = {
            f"the {_QUANTITIES[order - 1]} of joint {names[joint]!r}": float(value)
            for order, limits in self.task.orders.items()
            for joint, value in enumerate(peak_ratios(motion, limits, order))
        }
        uses = {} if self.task.loads is None else estimate_uses(self.task.loads, motion)
        if "torque" in uses:
            ratios[f"the torque of joint {names[uses['torque'].joint]!r}"] = uses["torque"].ratio
        if "tool_speed" in uses:
            ratios["the tool's speed"] = uses["tool_speed"].ratio
        worst, ratio = max(ratios.items(), key=lambda entry: entry[1])
        return Obstruction(f"{worst} is {ratio:.4g} times its limit", _LIMITS)

    def _exceeds_effort_limits(self, motion: Trajectory) -> bool:
        loads = self.task.loads
        uses = {} if loads is None else estimate_uses(loads, motion)
        return any(use.ratio > 1.0 + _ROUNDING for use in uses.values())

    def _add(self, places: list[float]) -> None:
        about = 0.5 / self.iterate.space.pieces
        self.places = self.places.with_more(places, about, _SPARE)
        self.linearization = self._linearize(self.iterate)


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
