"""Legs between configurations: times that are known so far, checks of straight motions, proofs.

Configurations of the goals of a tour: every branch that is free, or why there is none.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array, Indices
from kinematics.forward import forward
from kinematics.ik.closed_form.analytic import branches
from kinematics.ik.closed_form.structure import structure
from kinematics.ik.numeric import numeric
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.checker import Checker
from planning.constrained.checker import ConstrainedChecker
from planning.constrained.path_constraints import end_violation
from planning.goal_choice.goal_order import (
    MAX_LONGER,
    configuration_costs,
    is_at_limit,
    turn_counts,
)
from planning.options import Options
from planning.pipeline import pipeline
from planning.planner import TOUCHING
from planning.preflight.goals import find_goals
from planning.preflight.limits import goal_onto_limits
from planning.preflight.pose_configurations import inner_turns, with_inner_limits
from planning.problem import JointGoal, PoseGoal, Problem
from planning.proof.certificate import certify
from planning.reach.evaluation import parameter_values
from planning.result import Failure
from planning.timing.parametrization import TimeParametrization
from planning.timing.rest_to_rest import Times, rest_to_rest_kernel
from planning.tours.problem import MAX_CONFIGURATIONS, TourGoal, TourProblem
from planning.tours.result import Leg
from planning.values.deadline import Deadline
from planning.values.preferences import GoalCosts, time_weight


class Configurations(NamedTuple):
    """Free configurations of one stop of a tour.

    Args:
        joints: Shape (k, n) [rad or m].
        alternatives: Number of the alternative each of them reaches, k numbers.
        clearances: Clearances of each of them, margins taken off, shape (k,) [m].
        posed: Whether each of them is of a pose, not asked for as joints, shape (k,).
    """

    joints: Array
    alternatives: tuple[int, ...]
    clearances: Array
    posed: NDArray[np.bool_]


class _Found(NamedTuple):
    """A free configuration (n,), the number of its alternative, and its clearance [m]."""

    joints: Array
    alternative: int
    clearance: float


def _together(goal: TourGoal, found: Sequence[_Found]) -> Configurations:
    """Configurations of a goal as arrays."""
    joints, alternatives, clearances = zip(*found, strict=True)
    posed = [isinstance(goal.alternatives[number], PoseGoal) for number in alternatives]
    return Configurations(
        np.array(joints), alternatives, np.array(clearances), np.array(posed, dtype=np.bool_)
    )


def find_configurations(
    problem: TourProblem, goal: TourGoal, checker: Checker, near: Array, seed: int,
    deadline: Deadline,
) -> Configurations | Failure:  # fmt: skip
    """Free configurations of a goal, or why there is none.

    Args:
        problem: The tour.
        goal: One of its goals.
        checker: The exact robot in the scene with its margins.
        near: Configuration that whole turns are to be near, shape (n,).
        seed: Seed of inverse kinematics.
        deadline: Time at which to check no more alternatives.
    """
    found: list[_Found] = []
    for number, alternative in enumerate(goal.alternatives):
        if isinstance(alternative, JointGoal):
            q, violation = goal_onto_limits(
                problem.robot.chain, alternative.joints, problem.start_state_tolerance
            )
            candidates = [q] if violation is None else []
        else:
            candidates = _of_pose(problem, goal, alternative, near, seed)
        for q in candidates:
            if end_violation(problem.constraints, "goal", q) is not None:
                continue
            # Configurations nearer than this in every joint are the same [rad or m].
            if any(np.abs(q - other.joints).max() <= 1e-6 for other in found):
                continue
            clearance = checker.clearance(q)[0]
            if clearance > TOUCHING:
                found.append(_Found(q, number, clearance))
    # Configurations of one goal: more hardly shorten a tour.
    most = max(min(32, MAX_CONFIGURATIONS // len(problem.goals)), 1)
    if found:
        joints = np.array([one.joints for one in found])
        chosen = _inside_first(problem.robot.chain, joints, near, most)
        return _together(goal, [found[k] for k in chosen])
    return _search_around_obstacles(problem, goal, checker, near, seed, deadline)


def _search_around_obstacles(
    problem: TourProblem, goal: TourGoal, checker: Checker, near: Array, seed: int,
    deadline: Deadline,
) -> Configurations | Failure:  # fmt: skip
    """Configurations of a goal found with the obstacles in sight, or why there is none."""
    found: list[_Found] = []
    failures: list[Failure] = []
    for number, alternative in enumerate(goal.alternatives):
        single = Problem(
            problem.robot, problem.scene, near, (alternative,), problem.margin,
            problem.start_state_tolerance,
        )  # fmt: skip
        answer = find_goals(single, checker, near, seed, deadline)
        if isinstance(answer, Failure):
            failures.append(answer)
            continue
        # Configurations taken of those that are found with the obstacles in sight.
        for candidate in answer[:4]:
            violation = end_violation(problem.constraints, "goal", candidate.joints)
            if violation is not None:
                failures.append(violation)
            else:
                found.append(_Found(candidate.joints, number, candidate.clearance))
    return _together(goal, found) if found else failures[0]


def _of_pose(
    problem: TourProblem, goal: TourGoal, pose: PoseGoal, near: Array, seed: int
) -> list[Array]:
    """Configurations of a pose with all its deviations, inside the limits."""
    chain = problem.robot.chain
    targets = pose.T_base_tip @ goal.tolerance.deviations()
    form = structure(chain)
    if form is not None:
        values = parameter_values(chain, form) if form.redundant else None
        answer = branches(chain, targets, seed_joints=near, parameters=values, threads=1)
        assert answer.counts is not None
        rows = [
            np.array(answer.joints[i, k])
            for i, count in enumerate(answer.counts)
            for k in range(count)
            if answer.within_limits[i, k]
        ]
        return [*rows, *_turned_inwards(chain, rows)]
    # Starts of inverse kinematics spent on them.
    options = numeric.SearchOptions(seed=seed, starts=60)
    # Deviations from a pose that such arms try: each takes milliseconds.
    searched_deviations = 4
    step = max(len(targets) // searched_deviations, 1)
    rows = []
    for T in targets[::step][:searched_deviations]:
        found = _searched(chain, T, options, near)
        if found and is_at_limit(chain, np.array(found)).any():
            found += _searched(with_inner_limits(chain), T, options, near)
        rows += found
    return [*rows, *_turned_inwards(chain, rows)]


def _searched(chain: Chain, T: Array, options: numeric.SearchOptions, near: Array) -> list[Array]:
    # Configurations searched for at each deviation from a pose, of arms without a closed form.
    found = numeric.solve(chain, T, options, seed_joints=near, solutions=8).solutions
    return [np.array(solution.joints) for solution in found]


def _turned_inwards(chain: Chain, rows: list[Array]) -> list[Array]:
    """Copies of configurations that a whole turn takes away from a limit."""
    return list(inner_turns(chain, np.array(rows))) if rows else []


def _inside_first(chain: Chain, joints: Array, near: Array, most: int) -> list[int]:
    """Numbers of configurations that stand for all of them, those away from limits first."""
    at_limit = is_at_limit(chain, joints)
    inside, outside = np.flatnonzero(~at_limit), np.flatnonzero(at_limit)
    chosen: list[int] = []
    for rows in (inside, outside):
        if len(rows) and len(chosen) < most:
            chosen += [int(rows[k]) for k in _spread(joints[rows], near, most - len(chosen))]
    return sorted(chosen)


def _spread(joints: Array, near: Array, most: int) -> list[int]:
    """Numbers of configurations that stand for all of them, the nearest one to ``near`` first.

    Each next one is the farthest from those chosen already.

    Args:
        joints: Shape (k, n).
        near: Shape (n,).
        most: How many at most.
    """
    if len(joints) <= most:
        return list(range(len(joints)))
    chosen = [int(np.abs(joints - near).max(axis=1).argmin())]
    distance = np.abs(joints - joints[chosen[0]]).max(axis=1)
    while len(chosen) < most:
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.abs(joints - joints[chosen[-1]]).max(axis=1))
    return sorted(chosen)


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
