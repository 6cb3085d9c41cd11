"""Inverse kinematics under constraints: configurations that hold them all and collide with nothing.

Starts are drawn at random; from each an active-set method (``constraints.active_set``) goes to the
nearest configuration that holds everything and then to the best one around. Every answer is checked
by the kernels of the constraints and by the exact collision checker.

Configurations of goal poses under constraints, clear of obstacles.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidGoal, InvalidOption
from kinematics.ik.ranking import margin as limit_use
from kinematics.jacobian import geometric, manipulability
from kinematics.model.chain import Chain
from obstacles.collision.checker import Checker
from obstacles.collision.edge_check import FREE
from obstacles.collision.model.model_arrays import ModelArrays
from obstacles.collision.state_check import verdict_on
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import (
    ClearanceConstraint,
    Constraint,
    RelativePoseConstraint,
)
from planning.constraints.solvers.active_set import COURSE, OVER, STAGE, go_on
from planning.constraints.solvers.active_set_program import (
    GAIN,
    LEAST_GAIN,
    LEFT,
    Goal,
    Work,
    linearise,
    make_goal,
    make_work,
    search_arrays,
    without_surfaces,
)
from planning.problem import PoseGoal, Problem
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


Objective = Literal["nearest", "limits", "manipulability"]
OBJECTIVES: tuple[Objective, ...] = get_args(Objective)

#: A configuration holds its constraints where no residual exceeds this [m or rad].
HELD = 1e-6
#: Kept beyond the margins, so that a configuration driven to them does not touch them [m].
_HEADROOM = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class IkOptions:
    """Options of constrained inverse kinematics.

    Args:
        objective: Measure of a configuration: "nearest" to the posture, in the middle of
            the "limits", or "manipulability".
        posture: Shape (n,); the seed where None.
        seed_joints: Configuration to search from, shape (n,); the posture, or the middle of the
            limits.
        most: How many to answer at most.
        starts: Starts to spend at most.
        seed: Seed of the random starts.
        deadline: Instant at which the search is given up.

    Raises:
        InvalidOption: An unknown objective, or no number of starts.
    """

    objective: Objective = "nearest"
    posture: Array | None = None
    seed_joints: Array | None = None
    most: int = 1
    starts: int = 100
    seed: int = 0
    deadline: Deadline | None = None

    def __post_init__(self) -> None:
        if self.objective not in OBJECTIVES:
            raise InvalidOption(
                f"there is no objective {self.objective!r}",
                hint=f"One of: {', '.join(OBJECTIVES)}.",
            )
        if self.most < 1 or self.starts < 1:
            raise InvalidOption("most and starts must be 1 at least")


@dataclass(frozen=True, slots=True, eq=False)
class ConstrainedSolution:
    """A configuration with its residuals and its clearance.

    Args:
        joints: Shape (n,) [rad or m].
        residuals: Residuals of the rows, positive where violated, shape (m,) [m or rad].
        clearance: Distance of the closest pair, margins taken off [m]; infinite where nothing can
            collide.
        pair: The closest pair; None where nothing can collide.
        cost: Value of the objective.
    """

    joints: Array
    residuals: Array
    clearance: float
    pair: tuple[str, str] | None
    cost: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "joints", frozen(self.joints))
        object.__setattr__(self, "residuals", frozen(self.residuals))


@dataclass(frozen=True, slots=True, eq=False)
class ConstrainedIk:
    """Result of constrained inverse kinematics.

    Args:
        solutions: Best first; empty where there is none.
        nearest: The attempt with the least violation.
        starts: Starts that were spent.
        deterministic: Whether the same search gives the same result again: time did not end it.
    """

    solutions: tuple[ConstrainedSolution, ...]
    nearest: ConstrainedSolution
    starts: int
    deterministic: bool = True


def constrained_ik(
    robot: RobotGeometry,
    constraints: ConstraintSet,
    scene: Scene | None = None,
    options: IkOptions | None = None,
) -> ConstrainedIk:
    """Find configurations that hold all hard constraints, best first.

    Args:
        robot: The arm with its geometry.
        constraints: Constraints on the robot's chain; hard ones hold within 1e-6, soft ones cost
            their weight times half the square of what is violated.
        scene: The obstacles; without one only the robot's own links are kept apart.
        options: How to search.

    Raises:
        InvalidGoal: A constraint bounds a motion, not a configuration.
        InvalidRobotState: Posture or seed have the wrong length or are not finite.
    """
    how = options or IkOptions()
    if constraints.tool_speed is not None or constraints.torque is not None:
        name = "tool_speed" if constraints.tool_speed is not None else "torque"
        raise InvalidGoal(
            f"a constraint {name} bounds a motion; one configuration has none",
            hint="Leave it out here and give it to a plan.",
        )
    return _Search(robot, constraints, scene, how).run()


def _by_cost(solution: ConstrainedSolution) -> float:
    """The cost as far as it counts in an order."""
    return round(solution.cost, 9)


@dataclass(slots=True)
class _Search:
    """One search: its target as the kernel reads it, and the configurations so far."""

    robot: RobotGeometry
    constraints: ConstraintSet
    scene: Scene | None
    how: IkOptions
    chain: Chain = field(init=False)
    goal: Goal = field(init=False)
    descents: Descents = field(init=False)
    checker: Checker | None = field(init=False)
    exact: ModelArrays | None = field(init=False)
    covers: ModelArrays | None = field(init=False)
    first: Array = field(init=False)
    hard: NDArray[np.bool_] = field(init=False)
    found: list[ConstrainedSolution] = field(init=False)
    attempts: list[ConstrainedSolution] = field(init=False)

    def __post_init__(self) -> None:
        self.chain = self.robot.chain
        n = self.chain.n
        low, high = self.chain.sampling_bounds()
        middle = 0.5 * (low + high)
        seed, posture = self.how.seed_joints, self.how.posture
        preferred = posture if posture is not None else seed if seed is not None else middle
        near = self.chain.state(preferred, "posture")
        self.first = near
        if seed is not None:
            self.first = self.chain.state(seed, "seed_joints")
        metric = np.ones(n)
        if self.how.objective == "limits":
            near, metric = middle, (2.0 / np.maximum(high - low, 1e-9)) ** 2
            metric /= metric.max()
        elif self.how.objective == "manipulability":
            metric = np.zeros(n)
        link = -1 if self.how.objective == "manipulability" else -2
        hard, soft = self.constraints.hard, self.constraints.soft
        self.goal = make_goal(hard, near, metric, soft=soft, link=link)
        self.descents = Descents(self.goal, self.how.deadline)
        self.hard = np.isinf(self.constraints.weights)
        self.checker, self.exact, self.covers = None, None, None
        if self.scene is not None or len(self.robot.self_pairs):
            # Own links may not touch whatever stands around.
            around = Scene(()) if self.scene is None else self.scene
            self.checker = Checker.of(self.robot, around, self.constraints.margin)
            self.exact = search_arrays(self.checker.model, _HEADROOM)
            self.covers = without_surfaces(self.exact)
        self.found, self.attempts = [], []

    def run(self) -> ConstrainedIk:
        """Search until enough is found, or starts or time are spent."""
        # Starts spent on a better configuration once as many as were asked for are found.
        starts, spare, since = 0, 2, 0
        # Gain of the objective, times 1 and the objective, that ends the descents of which one is
        # chosen in the end. Only that one is followed to its very end.
        gain = 1e-5 if self.how.most == 1 else LEAST_GAIN
        for q in self._starts():
            model = self._solids_for(q, starts)
            starts, count = starts + 1, len(self.found)
            self._judge(self.descents.descend(model, q, gain))
            since = since + 1 if self.found and len(self.found) == count else 0
            spare -= len(self.found) >= self.how.most
            # Starts in a row without another solution after which no more are expected.
            if spare < 0 or since == 16 or self._time_up():
                break
        self.found.sort(key=_by_cost)
        if self.found and gain > LEAST_GAIN:
            self._finish(self.found[0])
        nearest = min([*self.found, *self.attempts], key=self.violation)
        deadline = self.how.deadline
        return ConstrainedIk(
            tuple(self.found[: self.how.most]),
            nearest,
            starts,
            deterministic=deadline is None or not deadline.interruptions.occurred,
        )

    def _time_up(self) -> bool:
        return self.how.deadline is not None and self.how.deadline.passed

    def _starts(self) -> Iterator[Array]:
        low, high = self.chain.sampling_bounds()
        random = np.random.default_rng(self.how.seed)
        yield np.clip(self.first, self.chain.limits.lower, self.chain.limits.upper)
        for _ in range(self.how.starts - 1):
            yield random.uniform(low, high)

    def _solids_for(self, start: Array, number: int) -> ModelArrays | None:
        """Solids that start ``number`` keeps apart: covers, or triangles where those do not do."""
        if self.checker is None or self.covers is self.exact:
            return self.exact
        # Every fourth start keeps triangles apart; the others keep what covers them apart, which
        # costs a tenth of the time and leaves out what lies in hollows.
        in_turn = number % 4 == 3
        return self.exact if in_turn or (number == 0 and self._in_hollow(start)) else self.covers

    def _in_hollow(self, q: Array) -> bool:
        """Whether a configuration is free that covers collide in: it is not to be led out."""
        if self.checker is None or self.covers is None:
            return False
        return verdict_on(self.covers, q, 0.0) != FREE and self.checker.valid(q)

    def _finish(self, best: ConstrainedSolution) -> None:
        """Follow the descent of the best solution to its very end."""
        q = best.joints
        model = self.exact if self._in_hollow(q) else self.covers
        others, self.found = self.found, []
        self._judge(self.descents.descend(model, np.array(q), LEAST_GAIN))
        self.found = sorted([*self.found, *others], key=_by_cost)

    def _judge(self, q: Array) -> None:
        """Judge a configuration and keep it among the solutions or the attempts."""
        clearance, pair = np.inf, None
        residuals = self.constraints.residuals(q)
        if self.checker is not None and self._worst(residuals) <= HELD:
            clearance, pair = self.checker.clearance(q)
        elif self.checker is not None:
            clearance = 0.0
        solution = ConstrainedSolution(q, residuals, clearance, pair, self._cost(q))
        # Solutions nearer than this in every joint [rad or m] are one.
        same = 1e-3
        if self.violation(solution) > 0.0:
            self.attempts.append(solution)
        elif all(float(np.abs(q - other.joints).max()) > same for other in self.found):
            self.found.append(solution)

    def _worst(self, residuals: Array) -> float:
        return float(residuals[self.hard].max(initial=-np.inf))

    def violation(self, solution: ConstrainedSolution) -> float:
        """Violation of the hard constraints, 0 where they hold within their tolerance."""
        worst = self._worst(solution.residuals)
        depth = -solution.clearance if solution.clearance <= 0.0 else 0.0
        touching = 1e-9 if solution.clearance <= 0.0 else 0.0
        return (worst if worst > HELD else 0.0) + depth + touching

    def _cost(self, q: Array) -> float:
        soft = self.constraints.weights[~self.hard]
        violated = np.maximum(self.constraints.residuals(q)[~self.hard], 0.0)
        penalty = 0.5 * float(soft @ violated**2)
        if self.how.objective == "limits":
            return penalty + float(limit_use(self.chain, q[None])[0])
        if self.how.objective == "manipulability":
            values = np.asarray(np.linalg.svd(geometric(self.chain, q), compute_uv=False))
            return penalty - float(np.log(max(manipulability(values), 1e-300)))
        return penalty + 0.5 * float(np.sum((q - self.goal.posture) ** 2))


#: Share of a goal's tolerance for each of three axes; a thousandth is kept for rounding.
_SHARE = 0.999 / np.sqrt(3.0)


def pose_constraint(goal: PoseGoal) -> RelativePoseConstraint:
    """A goal's pose as a constraint: the largest box inside the goal's tolerances."""
    return RelativePoseConstraint(
        goal.T_base_tip,
        position_tolerances=_SHARE * goal.position_tolerance,
        orientation_tolerances=_SHARE * goal.orientation_tolerance,
    )


def goal_configurations(
    problem: Problem,
    goal: PoseGoal,
    start: Array,
    seed: int,
    constraints: tuple[Constraint, ...] = (),
    deadline: Deadline | None = None,
) -> tuple[ConstrainedSolution, ...]:
    """Find configurations of a pose that hold constraints and keep clear, nearest to start first.

    Args:
        problem: The problem; its robot, scene and margin count.
        goal: The pose.
        start: Configuration to search from, shape (n,) [rad or m].
        seed: Seed of the random starts.
        constraints: Constraints that hold along the path.
        deadline: Instant from which what was found will do.
    """
    clear = ClearanceConstraint(problem.margin)
    wanted = ConstraintSet(problem.robot.chain, (*constraints, pose_constraint(goal), clear))
    # At most eight configurations, from sixty starts of inverse kinematics.
    options = IkOptions(seed_joints=start, most=8, seed=seed, starts=60, deadline=deadline)
    return constrained_ik(problem.robot, wanted, problem.scene, options).solutions
