"""Steps: stages with the world and the configurations they begin and end with, before any proof."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import REST, Trajectory, stay
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import AllowedContact
from planning.constraints.constraint_set import ConstraintSet
from planning.options import Options
from planning.pipeline import pipeline
from planning.planner import Planner, Query
from planning.problem import Goal, JointGoal, PoseGoal, Problem
from planning.proof.certificate import Certificate, certify, certify_gripper
from planning.result import Attempt, Failure, Plan
from planning.sequence.result import StagePlan
from planning.sequence.stage import (
    Gripper,
    Pair,
    Signal,
    Stage,
    StageSettings,
    Straight,
    Wait,
    passing_distance,
    stage_kind,
)
from planning.sequence.world import Cell, Cells, World
from planning.timing.rest_to_rest import motion_times, passing_time
from planning.tool_motions.tool_path import Stop, Tolerances, ToolPath, ToolRun
from planning.tool_motions.tool_tolerance import ToolTolerance
from planning.tool_paths.seams.following import follow_seam
from planning.tool_paths.seams.nodes import COARSE, Density
from planning.tool_paths.seams.path import seam_places
from planning.tool_paths.seams.search import SeamSearch
from planning.tool_paths.tool_following import lead_tool
from planning.values.deadline import Deadline

#: Configurations of each place of a straight way that an arm may find round something.
_FINELY = Density(1000, 64, 5)


class Line(NamedTuple):
    """A straight motion of the tool as a joint path, before it is timed.

    Args:
        path: Path from its start to its end.
        start: Shape (n,).
        end: Shape (n,).
        distance: How far the tool goes [m].
    """

    path: ToolPath
    start: Array
    end: Array
    distance: float


class LineStopped(NamedTuple):
    """A straight motion that is shorter than it has to be.

    Args:
        distance: How far the tool comes [m].
        stop: The reason.
        way: The shortest way that would do.
        start: Configuration that it begins at, shape (n,).
        checker: The robot in its surroundings.
        tolerances: Deviations that the tool may have.
    """

    distance: float
    stop: Stop
    way: ToolRun
    start: Array
    checker: Checker
    tolerances: Tolerances

    def found_round(
        self, starts: Sequence[Array], deadline: Deadline, *, any_start: bool = False
    ) -> ToolPath | None:
        """The way from one of some configurations, the arm moving round what is in its way.

        An arm with more than six joints can do so while its tool goes straight. Where an arm begins
        in a singular configuration, others of these have another way.

        Args:
            starts: Configurations (n,) with the tool where the way begins, best near to the first.
            deadline: Time at which to give up.
            any_start: Whether it may also begin in other configurations.
        """
        exact = ToolTolerance(np.zeros(6), np.zeros(6))
        places = seam_places((replace(self.way, tolerances=(exact,)),))
        search = SeamSearch(self.checker, places, starts[0], (), deadline)
        more = search.beginnings(_FINELY) if any_start else ()
        search = replace(search, first=np.array([*starts, *more]))
        path = follow_seam(search, self.tolerances, ((False, COARSE), (True, _FINELY))).path
        return None if path is None else replace(path, runs=(self.way,))


@dataclass(frozen=True, slots=True)
class KnownLine:
    """Planner that answers a tool path which was found before.

    Args:
        path: The line.
    """

    path: ToolPath
    name: ClassVar[str] = "cartesian"
    needs_goals: ClassVar[bool] = False

    def plan(self, query: Query) -> Attempt:  # noqa: ARG002
        """The line."""
        detail = f"{self.path.runs[0].length:.4g} m, {len(self.path.waypoints)} configurations."
        return Attempt(self.path.waypoints, detail, tool_path=self.path)


def lead_straight(
    cell: Cell, world: World, stage: Straight, q: Array, deadline: Deadline, *, around: bool = False
) -> Line | LineStopped:
    """The longest straight motion that a stage allows, proved free.

    Args:
        cell: The robot in its surroundings.
        world: The same before pairs and margins were put in.
        stage: The direction and the distances.
        q: Beginning of the motion; where it ends, of an approach. Shape (n,).
        deadline: Time at which to give up.
        around: Whether to search for a way round something where the shortest joint motion meets
            it.
    """
    T = forward(cell.robot.chain, q)
    along = world.direction(np.asarray(stage.direction), stage.frame, stage.of, T)
    backwards = stage.kind == "approach"
    if backwards:
        along = -along
    options = stage.settings.options.cartesian
    free = options.orientation == "free"
    orientation = None if free else options.max_orientation_deviation
    tolerances = Tolerances(options.max_deviation, orientation)
    # Slack of straight motions where their end has twice as much to spare [m].
    slack = min(1e-4, 0.5 * max(cell.checker.clearance(q)[0], 0.0))
    checker = Checker(cell.checker.model, slack)
    path = lead_tool(checker, q, [ToolRun.straight(T, stage.most * along)], tolerances, deadline)
    if path.stop is not None:
        reached = path.segments[0].reached * stage.most
        least = ToolRun.straight(T, stage.least * along)
        stopped = LineStopped(reached, path.stop, least, q, checker, tolerances)
        if reached >= stage.least:
            # A straight motion that meets something ends this much earlier, if it may [m].
            shorter = ToolRun.straight(T, max(stage.least, reached - 0.005) * along)
            path = lead_tool(checker, q, [shorter], tolerances, deadline)
        if path.stop is not None:
            found = stopped.found_round([q], deadline) if around else None
            if found is None:
                return stopped
            path = found
    if backwards:
        path = path.reverse()
    segment = path.segments[0]
    return Line(path, segment.start, segment.end, path.runs[0].length)


def constraint_set(cell: Cell, settings: StageSettings) -> ConstraintSet | None:
    """The constraints of a stage for its robot; None where it has none."""
    if not settings.constraints:
        return None
    return ConstraintSet(cell.chain, settings.constraints)


@dataclass(slots=True, eq=False)
class Step:
    """One stage under the choices made so far.

    Args:
        index: Number of the stage.
        stage: The stage.
        motion: Whether the arm moves freely, straight, as its stage says, or not at all.
        world: The world during it.
        after: The world after it.
        allowed: Pairs that may touch during it, beside those of its world.
        start: Configuration before it, shape (n,).
        end: Configuration after it, shape (n,).
        line: Straight motion of the step.
        target: Number of the alternative that was chosen.
        bound: Least time that it takes [s].
        plan: Plan from rest to rest, once there is one.
        passes: Whether the step may begin or end without rest, and be quicker than its plan.
    """

    index: int
    stage: Stage
    motion: Literal["free", "straight", "follow", "none"]
    world: World
    after: World
    allowed: Mapping[Pair, AllowedContact]
    start: Array
    end: Array
    line: Line | None = None
    target: int | None = None
    bound: float = 0.0
    plan: StagePlan | None = None
    passes: bool = False

    @property
    def least_time(self) -> float:
        """Time that it takes, or at least takes where it has no plan [s]."""
        if self.plan is None or self.passes:
            return self.bound
        return self.plan.trajectory.duration


def still_time(stage: Stage) -> float:
    """Duration of a stage in which the arm stands still [s]."""
    if isinstance(stage, Wait | Gripper | Signal):
        return max(stage.duration or REST, REST)
    return REST


def least_travel(world: World, stage: Stage, start: Array, end: Array) -> float:
    """Least time between two configurations (n,) with the limits of a stage [s]."""
    chain = world.robot.chain
    limits = scaled_limits(chain, stage.settings.options)
    return float(motion_times(chain, start, end[None], limits)[0])


def scaled_limits(chain: Chain, options: Options) -> tuple[Array, Array]:
    """Limits of velocity and acceleration that a motion may use, each of shape (n,)."""
    limits, given, timing = chain.limits, options.limits, options.timing
    velocity = np.asarray(given.get("velocity", limits.velocity), dtype=np.float64)
    acceleration = np.asarray(given.get("acceleration", limits.acceleration), dtype=np.float64)
    return velocity * timing.velocity_scaling, acceleration * timing.acceleration_scaling


def least_passing(
    world: World, stages: Sequence[Stage], k: int, ends: tuple[Array, Array]
) -> float | None:
    """Least time of a free motion that begins or ends without rest [s]; None where it does not.

    Args:
        world: The world during it.
        stages: All stages.
        k: Number of the stage.
        ends: Configurations before and after it, each of shape (n,).
    """
    around = [passing_distance(stage) for stage in stages[max(k - 1, 0) : k + 1]]
    if all(blend is None for blend in around):
        return None
    slack = sum(blend or 0.0 for blend in around)
    velocity, _ = scaled_limits(world.robot.chain, stages[k].settings.options)
    return passing_time(*ends, velocity, slack)


def plan_step(
    cells: Cells, step: Step, max_edges: int, deadline: Deadline, seed: int
) -> StagePlan | Failure:
    """The proved motion of a step.

    Args:
        cells: Cells that were put together.
        step: The stage with its ends.
        max_edges: Edges that each planner of a free motion may check.
        deadline: The end of everything.
        seed: Seed of everything random.
    """
    began = time.perf_counter()
    if deadline.passed:
        return Failure(
            "TIMED_OUT",
            f"time was up before stage {step.index} was planned",
            "Raise timeout.",
            "preflight",
        )
    settings = step.stage.settings
    cell = cells.cell(step.world, step.allowed, settings.margin)
    if step.motion == "none":
        return _plan_still(step, cell, deadline, began)
    plan = _plan_moving(step, cell, max_edges, deadline, seed)
    if isinstance(plan, Failure):
        return plan
    made = _stage_plan(step, cell, plan.trajectory, plan.certificate, began)
    return replace(made, plan=plan)


def _plan_moving(
    step: Step, cell: Cell, max_edges: int, deadline: Deadline, seed: int
) -> Plan | Failure:
    """The motion of a step in which the arm moves, in time and proved."""
    settings, start = step.stage.settings, step.start
    goals: tuple[Goal, ...] = (JointGoal(step.end),)
    # Least time for one plan [s].
    longest = min(settings.options.timeout, max(deadline.remaining, 1e-3))
    options = replace(settings.options, timeout=longest, seed=seed)
    planners: tuple[Planner, ...] | None = None
    if step.line is not None:
        start, goals = step.line.start, (JointGoal(step.line.end),)
        planners = (KnownLine(step.line.path),)
    elif step.motion == "free":
        options = replace(options, max_edges=max_edges)
    else:
        options = replace(options, planner="cartesian")
        seam = options.cartesian.seam
        ends = options.cartesian.motions if seam is None else seam.waypoints
        goals = (PoseGoal(ends[-1].T_base_tip),)
    constraints = constraint_set(cell, settings)
    problem = Problem(
        cell.robot, cell.scene, start, goals, settings.margin, constraints=constraints
    )
    return pipeline.plan(problem, options, planners, deadline)


def _plan_still(step: Step, cell: Cell, deadline: Deadline, began: float) -> StagePlan | Failure:
    """The arm standing still, with the proof that it may."""
    stage, q, settings = step.stage, step.start, step.stage.settings
    fingers = stage.motion if isinstance(stage, Gripper) else None
    motion = stay(cell.robot.chain.joint_names, q, still_time(stage))
    held: dict[str, Any] = {
        "margin": settings.margin,
        "constraints": constraint_set(cell, settings),
        "deadline": deadline,
    }
    if fingers is not None:
        certificate = certify_gripper(fingers, cell.robot, cell.scene, q, **held)
    else:
        certificate = certify(motion, cell.robot, cell.scene, **held)
    if certificate.violation is not None:
        violation = certificate.violation
        return Failure(
            "TIMED_OUT" if violation.kind == "time" else "INVALID_MOTION_PLAN",
            violation.message,
            "Raise touch_depth if so deep a contact is meant (null for any depth)."
            if "touch_depth" in violation.details
            else "Name the pairs that may touch in touch_links, support or allowed_collisions.",
            "certificate",
            details={"kind": violation.kind, **violation.details},
        )
    made = _stage_plan(step, cell, motion, certificate, began)
    return replace(made, fingers=fingers, event=stage if isinstance(stage, Signal) else None)


def _stage_plan(
    step: Step, cell: Cell, motion: Trajectory, certificate: Certificate, began: float
) -> StagePlan:
    """The plan of a step that was begun at a time [s]."""
    return StagePlan(
        index=step.index,
        kind=stage_kind(step.stage),
        name=step.stage.settings.name,
        trajectory=motion,
        certificate=certificate,
        after=step.after,
        allowed=tuple(sorted(cell.scene.allowed_collisions)),
        target=step.target,
        plan=None,
        milliseconds=1e3 * (time.perf_counter() - began),
    )
