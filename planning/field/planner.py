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
from planning.field.gradient_descent import Descent, Outcome, Proof
from planning.field.options import FieldOptions
from planning.field.potential import Field
from planning.field.stop import explain_stop
from planning.field.weights import FieldWeights
from planning.planner import Query
from planning.result import Attempt, Explanation
from planning.result import Descent as DescentReport
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
    limits = robot.chain.limits
    rows = checker.rows if isinstance(checker, ConstrainedChecker) else np.zeros((0, WIDTH))
    proof = Proof(checker.model.arrays, float(checker.slack), np.array(rows))
    rules = options.rules(limits.lower, limits.upper)
    for goal in goals:
        field, where = potential_of(robot, scene, goal, options)
        descent = Descent(field, proof, rules, start)
        outcome = _descend(descent, options, seed, deadline)
        detail = _describe(descent, outcome, options)
        at_goal = bool((descent.visited[-1] == goal).all())
        if at_goal or deadline.passed:
            break
    if not at_goal and len(goals) > 1:
        detail = f"{detail} None of {len(goals)} goals was reached; this is the last."
    visited, ending, explain = np.array(descent.visited), _ENDINGS[outcome], None
    if not at_goal:
        last = (field, where, checker, visited[-1], ending, options)
        explain = partial(explain_stop, robot.chain, scene.ids, *last)
    return FieldResult(
        waypoints=visited if at_goal else None,
        visited=visited,
        potentials=np.array(descent.potentials),
        iterations=descent.iterations,
        joint_force=descent.slope.joint_force,
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
        descent = DescentReport(result.visited, result.potentials, result.iterations)
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


def _descend(
    descent: Descent, options: FieldOptions, seed: int, deadline: Deadline
) -> Outcome | None:
    """Descend until it arrives or has to give up; the outcome, None where the time was up."""
    escapes, across, walk, random = 0, None, 0, np.random.default_rng(seed)
    while True:
        outcome = descent.run(options.max_iterations, deadline, across, walk)
        if outcome == Outcome.GOING and descent.is_at_minimum:
            outcome = Outcome.MINIMUM
        if outcome in (None, Outcome.ARRIVED, Outcome.GOING) or escapes == options.escapes:
            return outcome
        escapes += 1
        across = _direction_across(descent.slope.joint_force, random)
        walk = 0 if across is None else options.escape_steps


def _direction_across(force: Array, random: np.random.Generator) -> Array | None:
    """A random direction across the force, shape (n,); None where there is none."""
    across = random.normal(size=len(force))
    along = force / max(float(np.linalg.norm(force)), 1e-300)
    across -= (across @ along) * along
    widest = float(np.abs(across).max())
    # A direction across the force whose largest entry is below this is none: a single joint has
    # nowhere to step aside.
    return None if widest < 1e-9 else across / widest


def _describe(descent: Descent, outcome: Outcome | None, options: FieldOptions) -> str:
    """Describe the end of a descent for a person."""
    if outcome == Outcome.ARRIVED:
        return f"Reached the goal in {descent.iterations} steps."
    if outcome is None:
        return "The time was up."
    strength = float(np.abs(descent.slope.joint_force).max())
    by = f" by {100.0 * options.progress:g} %" if options.progress > 0.0 else ""
    tolerance = f"tolerance {options.force_tolerance:g}"
    reasons: dict[int, str] = {
        Outcome.BLOCKED: "Blocked: no step along the force is proved free inside the joint limits",
        Outcome.GOING: f"The {options.max_iterations} steps were used up",
        Outcome.MINIMUM: f"A local minimum: the force vanishes ({tolerance})",
        Outcome.STALLED: f"{options.patience} steps in a row did not lower the potential{by}",
        Outcome.KINK: "A kink of the potential: every proved step along the force leads higher",
    }
    left = float(np.linalg.norm(descent.visited[-1] - descent.field.goal))
    text = (
        f"{reasons[outcome]}. This is after {descent.iterations} steps, at potential "
        f"{descent.potentials[-1]:.4g}, {left:.3g} from the goal in joint space, with a largest "
        f"joint force of {strength:.3g}."
    )
    return text if outcome == Outcome.MINIMUM else f"{text} It is no local minimum."
