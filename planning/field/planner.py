"""Planning by descent on an artificial potential.

    q^{k+1} = q^k + alpha_k sum_i J_i^T (F_att,i + F_rep,i)

from the start until |q - q_goal| < epsilon, with a cap on the steps. Every step is proved free
before it is taken, with a smaller alpha_k where it has to be; unless given, alpha_k is also small
enough for the potential to get lower. A potential has local minima; the
descent notices that it no longer gets lower and gives up, or, where escapes are allowed, walks some
random steps across the force and goes on from there. Source: "Real-time obstacle avoidance for
manipulators and mobile robots", International Journal of Robotics Research, 1986; random walks out
of minima: "Robot motion planning: a distributed representation approach", International Journal of
Robotics Research, 1991.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np

from kinematics.arrays import Array
from kinematics.caches.bounded_cache import array_bytes, bounded_cache
from obstacles.collision.checker import Checker
from obstacles.projection.fcl_projection import FclProjector
from obstacles.projection.projection import Projector
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.constrained.checker import ConstrainedChecker
from planning.constraints.row import WIDTH
from planning.field.control_points import (
    ControlPoints,
    along_links,
    named_points,
    origin_points,
)
from planning.field.field_kernels import value_kernel, vanishing_force_kernel
from planning.field.gradient_descent import (
    Count,
    Outcome,
    Proof,
    Track,
    descend_kernel,
    free_force_kernel,
    keep_kernel,
)
from planning.field.options import FieldOptions
from planning.field.potential import Field
from planning.field.python_descent import PythonDescent
from planning.field.stop import explain_stop
from planning.field.weights import FieldWeights
from planning.planner import Query
from planning.result import Attempt, Descent, Explanation
from planning.values.deadline import Deadline

#: Names of the outcomes of a descent on the wire.
_ENDINGS: dict[int | None, str] = {
    None: "timed_out",
    Outcome.ARRIVED: "arrived",
    Outcome.BLOCKED: "blocked",
    Outcome.GOING: "steps_used_up",
    Outcome.MINIMUM: "local_minimum",
    Outcome.STALLED: "no_progress",
    Outcome.KINK: "kink",
}


@dataclass(frozen=True, slots=True, eq=False)
class FieldResult:
    """Result of a descent.

    Args:
        waypoints: Shape (k, n), every leg proved free; None where it got stuck.
        visited: Configurations it was in, shape (k, n), whether it arrived or not.
        potentials: U at each of them, shape (k,) [J].
        iterations: Steps taken.
        joint_force: -grad U at the last of them, shape (n,) [N m or N].
        ending: "arrived", "local_minimum", "no_progress", "kink", "blocked", "steps_used_up" or
            "timed_out".
        detail: How it ended, for a person.
        explain: Finds what stopped it; None where it arrived.
    """

    waypoints: Array | None
    visited: Array
    potentials: Array
    iterations: int
    joint_force: Array
    ending: str
    detail: str
    explain: Callable[[], Explanation] | None = None


def potential_field(
    robot: RobotGeometry,
    checker: Checker,
    scene: Scene,
    start: Array,
    goals: Sequence[Array],
    options: FieldOptions,
    seed: int,
    deadline: Deadline,
) -> FieldResult:
    """Descend on the potential from ``start`` (n,) to the first goal (n,) that can be reached so.

    Raises:
        InvalidOption: Weights are given for another number of control points.
    """
    for goal in goals:
        field, where = potential_of(robot, scene, goal, options)
        descent = _Descent(field, robot, checker, start, goal, options, seed)
        outcome = descent.run(deadline)
        detail = descent.describe(outcome)
        if descent.at_goal or deadline.passed:
            break
    if not descent.at_goal and len(goals) > 1:
        detail = f"{detail} None of {len(goals)} goals was reached; this is the last."
    ending, explain = _ENDINGS[outcome], None
    if not descent.at_goal:
        last = (field, where, checker, descent.visited[-1], ending, options)
        explain = partial(explain_stop, robot.chain, scene.ids, *last)
    return FieldResult(
        waypoints=descent.visited if descent.at_goal else None,
        visited=descent.visited,
        potentials=descent.potentials,
        iterations=descent.iterations,
        joint_force=descent.joint_force,
        ending=ending,
        detail=detail,
        explain=explain,
    )


@dataclass(frozen=True, slots=True)
class PotentialField:
    """The planner "potential_field".

    Args:
        options: Parameters of the field and of the descent.
    """

    options: FieldOptions
    name: ClassVar[str] = "potential_field"
    needs_goals: ClassVar[bool] = True

    def plan(self, query: Query) -> Attempt:
        """Descend to the first goal that can be reached so."""
        problem, ready = query.problem, query.ready
        robot, scene = problem.field_cell or (problem.robot, problem.scene)
        options = self.options
        if problem.field_cell is not None:
            # No straight motion is refused where no body is looked at: the way is the field's own.
            options = replace(options, keep_path=True)
        result = potential_field(
            robot,
            query.checker,
            scene,
            ready.start,
            ready.goals,
            options,
            query.seed,
            query.deadline,
        )
        descent = Descent(result.visited, result.potentials, result.iterations)
        if result.waypoints is not None:
            return Attempt(
                result.waypoints,
                result.detail,
                descent=descent,
                keep_path=options.keep_path,
            )
        details = {
            "joints": result.visited[-1].tolist(),
            "potential": float(result.potentials[-1]),
            "iterations": result.iterations,
            "joint_force": result.joint_force.tolist(),
            "ending": result.ending,
            "potential_field": {
                "joints": result.visited.tolist(),
                "potentials": result.potentials.tolist(),
                "iterations": result.iterations,
            },
        }
        return Attempt(None, result.detail, details=details, explain=result.explain)


def potential_of(
    robot: RobotGeometry, scene: Scene, goal: Array, options: FieldOptions
) -> tuple[Field, ControlPoints]:
    """The potential that the options ask for, and its control points.

    Raises:
        InvalidOption: Weights or radii are given for another number of control points.
    """
    where, weights = _weighted_points(robot, options)
    obstacles = FclProjector(scene) if options.engine == "fcl" else _projector(scene)
    return Field(robot.chain, where, obstacles, goal, weights, options.joint_weight), where


@bounded_cache(maxsize=16)
def _weighted_points(
    robot: RobotGeometry, options: FieldOptions
) -> tuple[ControlPoints, FieldWeights]:
    """The control points that the options ask for, and their weights."""
    if options.control_points == "links":
        where = along_links(robot)
        return where, options.weights.with_share(1.0 / len(where))
    radii = 0.0 if options.point_radii is None else options.point_radii
    if options.control_points == "origins":
        return origin_points(robot.chain, radii), options.weights
    return named_points(robot.chain, options.named_points, radii), options.weights


@bounded_cache(maxsize=16, weigh=lambda projector: array_bytes(projector.arrays))
def _projector(scene: Scene) -> Projector:
    return Projector(scene)


class _Descent:
    """One descent, from its first step to its last."""

    def __init__(
        self,
        field: Field,
        robot: RobotGeometry,
        checker: Checker,
        start: Array,
        goal: Array,
        options: FieldOptions,
        seed: int,
    ) -> None:
        limits, n = robot.chain.limits, len(start)
        rows = checker.rows if isinstance(checker, ConstrainedChecker) else np.zeros((0, WIDTH))
        self._proof = Proof(checker.model.arrays, float(checker.slack), np.array(rows))
        self._field = field
        self._model = None if options.engine == "fcl" else field.model
        self._goal = goal
        self._options = options
        self._rules = options.rules(limits.lower, limits.upper)
        self._random = np.random.default_rng(seed)
        # Configurations that a track has room for at first.
        capacity = 64
        self._track = Track(
            visited=np.empty((capacity, n)),
            potentials=np.empty(capacity),
            force=np.empty(n),
            gauges=np.array([options.longest_step, np.inf, -1.0, -1.0]),
            counts=np.zeros(3, dtype=np.int64),
        )
        potential, force = self._value(np.array(start, dtype=np.float64))
        keep_kernel(self._track, np.array(start, dtype=np.float64), potential, force)

    def _value(self, q: Array) -> tuple[float, Array]:
        """U at q, shape (n,), and -grad U, shape (n,)."""
        if self._model is None:
            return self._field.value(q)
        force = np.empty(len(q))
        return value_kernel(self._model, q, force), force

    def _descend(self, until: int, across: Array, walk: int) -> int:
        """Descend until ``until`` steps were taken, after ``walk`` steps across the force."""
        if self._model is None:
            field, goal = self._field, np.array(self._goal, float)
            descent = PythonDescent(
                field.value, field.vanishing_force, goal, self._proof, self._rules
            )
            return descent.run(self._track, until, across, walk)
        return int(
            descend_kernel(self._proof, self._rules, self._model, self._track, until, across, walk)
        )

    @property
    def visited(self) -> Array:
        """Configurations that were visited, shape (k, n) [rad or m]."""
        return np.array(self._track.visited[: self._track.counts[Count.VISITED]])

    @property
    def potentials(self) -> Array:
        """U at each of them, shape (k,) [J]."""
        return np.array(self._track.potentials[: self._track.counts[Count.VISITED]])

    @property
    def iterations(self) -> int:
        """Steps that were taken."""
        return int(self._track.counts[Count.ITERATIONS])

    @property
    def at_goal(self) -> bool:
        """Whether it ended at the goal."""
        last = self._track.visited[self._track.counts[Count.VISITED] - 1]
        return bool((last == self._goal).all())

    @property
    def joint_force(self) -> Array:
        """-grad U at the last configuration, shape (n,) [N m or N]."""
        return np.array(self._track.force)

    def run(self, deadline: Deadline) -> int | None:
        """Descend until it arrives or has to give up; the outcome, None where the time was up."""
        escapes, across, walk = 0, np.zeros(len(self._goal)), 0
        while True:
            outcome = self._descend_until(deadline, across, walk)
            if outcome == Outcome.GOING and self._is_at_minimum():
                outcome = Outcome.MINIMUM
            if (
                outcome in (None, Outcome.ARRIVED, Outcome.GOING)
                or escapes == self._options.escapes
            ):
                return outcome
            escapes += 1
            across, walk = self._direction_across()

    def _descend_until(self, deadline: Deadline, across: Array, walk: int) -> int | None:
        """Walk, then descend until that ends; None where the time does."""
        max_iterations = self._options.max_iterations
        # Steps between two looks at the clock.
        steps_a_look = 8
        while not deadline.passed:
            self._reserve(steps_a_look + walk)
            until = min(self.iterations + steps_a_look, max_iterations)
            outcome = self._descend(until, across, walk)
            if outcome != Outcome.GOING or self.iterations >= max_iterations:
                return outcome
            walk = 0
        return None

    def _reserve(self, steps: int) -> None:
        """Make room for so many steps, and the goal."""
        track = self._track
        capacity, needed = len(track.potentials), int(track.counts[Count.VISITED]) + steps + 1
        if needed > capacity:
            larger = max(needed, 2 * capacity)
            visited, potentials = np.empty((larger, len(track.force))), np.empty(larger)
            visited[:capacity], potentials[:capacity] = track.visited, track.potentials
            self._track = track._replace(visited=visited, potentials=potentials)

    def describe(self, outcome: int | None) -> str:
        """Describe the end of a descent for a person."""
        if outcome == Outcome.ARRIVED:
            return f"Reached the goal in {self.iterations} steps."
        if outcome is None:
            return "The time was up."
        options, strength = self._options, float(np.abs(self.joint_force).max())
        by = f" by {100.0 * options.progress:g} %" if options.progress > 0.0 else ""
        tolerance = f"tolerance {options.force_tolerance:g}"
        reasons: dict[int, str] = {
            Outcome.BLOCKED: "Blocked: no step along the force is proved free inside the "
            "joint limits",
            Outcome.GOING: f"The {options.max_iterations} steps were used up",
            Outcome.MINIMUM: f"A local minimum: the force vanishes ({tolerance})",
            Outcome.STALLED: f"{options.patience} steps in a row did not lower the potential{by}",
            Outcome.KINK: "A kink of the potential: every proved step along the force leads higher",
        }
        left = float(np.linalg.norm(self.visited[-1] - self._goal))
        text = (
            f"{reasons[outcome]}. This is after {self.iterations} steps, at potential "
            f"{self.potentials[-1]:.4g}, {left:.3g} from the goal in joint space, with a largest "
            f"joint force of {strength:.3g}."
        )
        return text if outcome == Outcome.MINIMUM else f"{text} It is no local minimum."

    def _is_at_minimum(self) -> bool:
        """Whether the force vanishes at the last configuration, but for joints at their limits."""
        q, tolerance = self.visited[-1], self._options.force_tolerance
        if self._model is None:
            force = self._field.vanishing_force(q, tolerance)
        else:
            force = vanishing_force_kernel(self._model, q, tolerance)
        return float(np.abs(free_force_kernel(self.joint_force, q, self._rules)).max()) <= force

    def _direction_across(self) -> tuple[Array, int]:
        """A random direction across the force, and how many steps to take in it."""
        force = self._track.force
        across = self._random.normal(size=len(force))
        along = force / max(float(np.linalg.norm(force)), 1e-300)
        across -= (across @ along) * along
        widest = float(np.abs(across).max())
        # A direction across the force whose largest entry is below this is none.
        if widest < 1e-9:
            return across, 0  # a single joint has nowhere to step aside
        return across / widest, self._options.escape_steps
