"""Legs between configurations: times that are known so far, checks of straight motions, proofs."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array, Indices
from kinematics.forward import forward
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.checker import Checker
from planning.constrained.checker import ConstrainedChecker
from planning.goal_choice.goal_order import (
    MAX_LONGER,
    configuration_costs,
    is_at_limit,
    turn_counts,
)
from planning.options import Options
from planning.pipeline import pipeline
from planning.problem import JointGoal, Problem
from planning.proof.certificate import certify
from planning.result import Failure
from planning.timing.parametrization import TimeParametrization
from planning.timing.rest_to_rest import Times, rest_to_rest_kernel
from planning.tours.configurations import Configurations
from planning.tours.problem import TourProblem
from planning.tours.result import Leg
from planning.values.deadline import Deadline
from planning.values.preferences import GoalCosts, time_weight


class VisitCosts(NamedTuple):
    """Costs of configurations in a tour beside the times of its legs.

    Args:
        own: Costs as seconds, shape (m,); 0 where the goal has no pose.
        at_limit: Whether each of them, of a pose, is at a joint limit, shape (m,).
        turn: Cost of each joint that turns by more than half a turn, as seconds.
        posed: Whether each of them is of a goal with a pose, shape (m,).
    """

    own: Array
    at_limit: NDArray[np.bool_]
    turn: float
    posed: NDArray[np.bool_]

    def factor(self, a: int, b: int) -> float:
        """Times by which the leg between two configurations counts as longer."""
        return float(MAX_LONGER ** (int(self.at_limit[a]) + int(self.at_limit[b])))

    def extra(self, chain: Chain, joints: Array, a: int, b: int) -> float:
        """Seconds that count beside the time of the leg between two of ``joints`` (m, n)."""
        extra = 0.5 * (self.own[a] + self.own[b])
        if self.turn and (self.posed[a] or self.posed[b]):
            extra += self.turn * turn_counts(chain, joints[a], joints[b][None])[0]
        return float(extra)

    def put_into(self, times: Times, chain: Chain, joints: Array, real: Array) -> None:
        """Add what configurations cost to a table of times, shape (m, m), in place.

        Args:
            times: Times of the legs, 0 to and from a free end.
            chain: The robot.
            joints: The configurations, shape (m, n).
            real: Whether each of them is one, shape (m,).
        """
        if not self.posed.any():
            return
        weights, half = np.where(self.at_limit, MAX_LONGER, 1.0), 0.5 * self.own
        for a in range(len(joints)):
            row = times[a] * (weights[a] * weights) + half[a] + half
            if self.turn and real[a]:
                turned = self.posed | self.posed[a]
                row += self.turn * turned * real * turn_counts(chain, joints[a], joints)
            times[a] = row


def visit_costs(chain: Chain, costs: GoalCosts, stops: Sequence[Configurations]) -> VisitCosts:
    """Costs of configurations of stops, those of one stop after those of another.

    What is asked for as joints alone costs nothing.

    Args:
        chain: The robot.
        costs: The weights.
        stops: Stops in order.
    """
    scale = 1.0 / time_weight(costs)
    own, at_limit, posed = [], [], []
    for stop in stops:
        weigh, cost = bool(stop.posed.any()), np.zeros(len(stop.joints))
        if weigh:
            cost = scale * configuration_costs(chain, stop.joints, costs, stop.clearances)
        own.append(cost)
        at_limit.append(stop.posed & is_at_limit(chain, stop.joints))
        posed.append(np.full(len(stop.joints), weigh))
    return VisitCosts(
        np.concatenate(own), np.concatenate(at_limit), scale * costs.turns, np.concatenate(posed)
    )


#: Time added between groups, so that a tour leaves each group only once: more than moves of the
#: search can save [s].
_BETWEEN_GROUPS = 500.0
#: Times that differ by less are equal [s].
SAME_TIME = 1e-5

#: Edges that a planner of one leg may check: seconds. Counted in edges, not in time, the tour
#: depends on the seed alone.
_MAX_EDGES = 200_000

Pair = tuple[int, int]


def least_times(
    limits: TimeParametrization, joints: Array, real: Array, deadline: Deadline, *, straight: bool
) -> Times | None:
    """Times of straight motions, or bounds of those of all motions, shape (m, m) [s].

    Args:
        limits: Limits of the motions.
        joints: Configurations, shape (m, n) [rad or m].
        real: Whether each of them is one; times from and to others are 0, shape (m,).
        deadline: Time at which to give up.
        straight: True for the straight joint motion, False for the bound of every motion.

    Returns:
        The times, or None where time is up before they are known.
    """
    jerk = np.full(len(limits.velocity), np.inf) if limits.jerk is None else limits.jerk
    m = len(joints)
    times: Times = np.empty((m, m), dtype=np.float32)
    velocity, acceleration = np.array(limits.velocity), np.array(limits.acceleration)
    # Rows of a table between two checks the clock: milliseconds.
    rows_at_once = 32
    for begin in range(0, m, rows_at_once):
        if deadline.passed:
            return None
        rows = np.array([begin, min(begin + rows_at_once, m)])
        rest_to_rest_kernel(joints, velocity, acceleration, np.array(jerk), straight, rows, times)
    loads = limits.loads
    if loads is not None and loads.tool_speed is not None:
        points = np.array([forward(loads.chain, q)[:3, 3] for q in joints])
        for k, point in enumerate(points):
            ways = np.linalg.norm(points - point, axis=1)
            times[k] = np.maximum(times[k], ways / loads.tool_speed)
    times[~real.astype(bool)] = 0.0
    times[:, ~real.astype(bool)] = 0.0
    return times


@dataclass(slots=True, eq=False)
class LegTable:
    """Legs between the configurations of all stops.

    Args:
        problem: The tour.
        options: Options of planning, for each leg.
        parametrization: The limits and the method of timing.
        checker: The exact robot in the scene with its margins.
        joints: Configurations of all stops, shape (m, n) [rad or m].
        group: Number of the group of each configuration, shape (m,).
        grouped: Whether goals are in groups.
        costs: Costs of configurations beside the times of legs.
        real: Whether each of them is one; a free end has a row of zeros, shape (m,).
        times: Times of straight motions at first, then as known so far, with what configurations
            cost and those between groups, shape (m, m) [s].
        free: Straight motions that are free, the smaller number first.
        blocked: Pairs that something is in the way of.
        legs: Proved legs.
        failures: Legs that were planned in vain.
        clearances: Clearances of configurations that were asked for, margins taken off [m].
    """

    problem: TourProblem
    options: Options
    parametrization: TimeParametrization
    checker: Checker
    joints: Array
    group: Indices
    real: Array
    grouped: bool
    times: Times
    costs: VisitCosts
    free: set[Pair] = field(default_factory=set)
    blocked: set[Pair] = field(default_factory=set)
    legs: dict[Pair, Leg] = field(default_factory=dict)
    failures: dict[Pair, Failure] = field(default_factory=dict)
    clearances: dict[int, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.options = replace(self.options, observer=None)
        self.costs.put_into(self.times, self.problem.robot.chain, self.joints, self.real)
        if self.grouped:
            self.times += np.float32(_BETWEEN_GROUPS) * (self.group[:, None] != self.group[None])

    def bounds(self, deadline: Deadline) -> Times | None:
        """Bounds of the times of all motions, shape (m, m) [s]; None where time is up before."""
        return least_times(self.parametrization, self.joints, self.real, deadline, straight=False)

    def time(self, a: int, b: int) -> float:
        """Time of the leg between two configurations, as known so far [s]."""
        return (float(self.times[a, b]) - self._extra_seconds(a, b)) / self.costs.factor(a, b)

    def straight_time(self, start: Array, end: Array) -> float:
        """Time of the straight motion between configurations (n,), whether free or not [s]."""
        times = least_times(
            self.parametrization, np.array([start, end]), np.ones(2), Deadline.after(np.inf),
            straight=True,
        )  # fmt: skip
        assert times is not None
        return float(times[0, 1])

    def set_time(self, a: int, b: int, seconds: float) -> None:
        """Note the time of the leg between two configurations, either way [s]."""
        counts = self.costs.factor(a, b) * seconds + self._extra_seconds(a, b)
        self.times[a, b] = self.times[b, a] = counts

    def cost(self, a: int, b: int) -> float:
        """Time of a leg with what its ends cost, as known so far, those between groups left out."""
        return float(self.times[a, b]) - self._between(a, b)

    def _extra_seconds(self, a: int, b: int) -> float:
        """Seconds that count beside the time of the leg between two configurations."""
        own = self.costs.extra(self.problem.robot.chain, self.joints, a, b)
        return self._between(a, b) + own

    def _between(self, a: int, b: int) -> float:
        return _BETWEEN_GROUPS if self.grouped and self.group[a] != self.group[b] else 0.0

    def check(self, a: int, b: int) -> bool:
        """Whether the straight motion is free; checked once, its time made longer if not."""
        pair = (min(a, b), max(a, b))
        if pair in self.free or (a, b) in self.legs:
            return True
        if pair in self.blocked:
            return False
        if self._checker(a, b).free(self.joints[a], self.joints[b]):
            self.free.add(pair)
            return True
        self.blocked.add(pair)
        # A straight motion that is blocked is expected to take this many times as long, and so much
        # more [s], until it is planned.
        detour, detour_time = 1.5, 0.1
        self.set_time(a, b, detour * self.time(a, b) + detour_time)
        return False

    def _checker(self, a: int, b: int) -> Checker:
        """The checker of straight motions between two configurations, as plans have it."""
        model = self.checker.model
        # Straight motions keep this much more than the margin, where their ends do: as plans do
        # [m].
        slack = min(1e-3, 0.5 * min(self.clearance(a), self.clearance(b)))
        constraints = self.problem.constraints
        if constraints is None or not constraints.hard.rows:
            return Checker(model, slack)
        hard = constraints.hard
        spare = -np.max([hard.residuals(self.joints[k]) for k in (a, b)], axis=0)
        return ConstrainedChecker(model, slack, constraints=hard, spare=spare)

    def clearance(self, k: int) -> float:
        """Clearance of a configuration, margins taken off [m]."""
        if k not in self.clearances:
            self.clearances[k] = float(self.checker.clearance(self.joints[k])[0])
        return self.clearances[k]

    def plan(self, a: int, b: int, deadline: Deadline) -> Leg | Failure:
        """The proved leg from one configuration to another; its time is known then.

        Args:
            a: Number of the first configuration.
            b: Number of the second.
            deadline: Time at which to give up.
        """
        known = self.legs.get((a, b)) or self.failures.get((a, b))
        if known is not None:
            return known
        back = self.legs.get((b, a))
        if back is not None:
            leg = self._reverse(back, deadline)
            if leg is not None:
                self.legs[a, b] = leg
                return leg
        found = self.plan_motion(self.joints[a], self.joints[b], deadline)
        # Time of a leg that was planned in vain: no tour takes it that has another choice [s].
        impossible = 2e4
        if isinstance(found, Failure):
            self.failures[a, b] = found
            self.set_time(a, b, impossible)
            return found
        self.note((a, b), found)
        return found

    def note(self, pair: Pair, leg: Leg) -> None:
        """Note a proved leg."""
        self.legs[pair] = leg
        self.set_time(*pair, leg.trajectory.duration)

    def plan_motion(
        self, start: Array, end: Array, deadline: Deadline, max_edges: int = _MAX_EDGES
    ) -> Leg | Failure:
        """A proved motion between configurations (n,), of the table or not.

        Args:
            start: Beginning of the motion.
            end: End of the motion.
            deadline: Time at which to give up.
            max_edges: Edges that each planner may check.
        """
        problem = Problem(
            self.problem.robot, self.problem.scene, start, (JointGoal(end),), self.problem.margin,
            constraints=self.problem.constraints,
        )  # fmt: skip
        # A leg that is planned at all is planned for so long [s].
        timeout = min(max(deadline.remaining, 1e-3), self.options.timeout)
        options = replace(self.options, timeout=timeout, max_edges=max_edges)
        plan = pipeline.plan(problem, options, within=deadline)
        if isinstance(plan, Failure):
            return plan
        return Leg(plan.planner, plan.path.waypoints, plan.trajectory, plan.certificate, plan.stops)

    def replace_configuration(self, k: int, q: Array) -> None:
        """Put a configuration (n,) away from limits in the place of another one of its goal.

        What is known of the other is forgotten; times to it stay, and are no longer searched by.
        """
        if np.array_equal(self.joints[k], q):
            return
        self.joints[k] = q
        self.clearances.pop(k, None)
        for known in (self.legs, self.failures, self.free, self.blocked):
            for pair in [pair for pair in known if k in pair]:
                known.pop(pair) if isinstance(known, dict) else known.discard(pair)
        self.costs.at_limit[k] = False

    def _reverse(self, leg: Leg, deadline: Deadline) -> Leg | None:
        """A leg run backwards, proved anew; None where it is not proved, nor are its stops."""
        if self.options.stops != "none":
            return None
        motion: Trajectory = leg.trajectory.reverse()
        certificate = certify(
            motion,
            self.problem.robot,
            self.problem.scene,
            margin=self.problem.margin,
            constraints=self.problem.constraints,
            limits=self.parametrization.motion_limits,
            deadline=deadline,
        )
        if not certificate.verified:
            return None
        return Leg(leg.planner, leg.waypoints[::-1], motion, certificate)
