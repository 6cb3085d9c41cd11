"""Steps: stages with the world and the configurations they begin and end with, before any proof."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from kinematics.arrays import Array
from kinematics.trajectory.trajectory import REST
from obstacles.scenes.scene import AllowedContact
from planning.result import Failure
from planning.sequence.estimate import passing_time, travel_times
from planning.sequence.motion import Line, plan_free, plan_line, stand_still
from planning.sequence.result import StagePlan
from planning.sequence.stage import (
    Gripper,
    Pair,
    Stage,
    Wait,
    passing_distance,
    stage_kind,
)
from planning.sequence.world import Cell, Cells, World
from planning.values.deadline import Deadline


@dataclass(slots=True, eq=False)
class Step:
    """One stage under the choices made so far.

    Args:
        index: Number of the stage.
        stage: The stage.
        motion: Whether the arm moves freely, straight or not at all.
        world: The world during it.
        after: The world after it.
        allowed: Pairs that may touch during it, beside those of its world.
        start: Configuration before it, shape (n,).
        end: Configuration after it, shape (n,).
        line: Its straight motion.
        target: Number of the alternative that was chosen.
        bound: Least time that it takes [s].
        plan: Its plan from rest to rest, once there is one.
        passes: Whether it may begin or end without rest, and be quicker than its plan.
    """

    index: int
    stage: Stage
    motion: Literal["free", "straight", "none"]
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
    if isinstance(stage, Wait | Gripper):
        return max(stage.duration or REST, REST)
    return REST


def least_travel(world: World, stage: Stage, start: Array, end: Array) -> float:
    """Least time between two configurations (n,) with the limits of a stage [s]."""
    ends = np.atleast_2d(end)
    return float(travel_times(world.robot.chain, start, ends, stage.settings.options)[0])


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
    return passing_time(world.robot.chain, *ends, stages[k].settings.options, slack)


def plan_step(
    cells: Cells, step: Step, max_edges: int, deadline: Deadline, seed: int
) -> StagePlan | Failure:
    """The proved motion of a step.

    Args:
        cells: Cells that were put together.
        step: The stage with its ends.
        max_edges: Edges that each planner of a free motion may look at.
        deadline: The end of everything.
        seed: Of everything random.
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
    if step.motion == "straight":
        assert step.line is not None
        plan = plan_line(cell, settings, step.line, deadline, seed)
    else:
        plan = plan_free(cell, settings, (step.start, step.end), max_edges, deadline, seed)
    if isinstance(plan, Failure):
        return plan
    return StagePlan(
        index=step.index,
        kind=stage_kind(step.stage),
        name=settings.name,
        trajectory=plan.trajectory,
        certificate=plan.certificate,
        after=step.after,
        allowed=tuple(sorted(cell.scene.allowed_collisions)),
        target=step.target,
        plan=plan,
        milliseconds=1e3 * (time.perf_counter() - began),
    )


def _plan_still(step: Step, cell: Cell, deadline: Deadline, began: float) -> StagePlan | Failure:
    stage = step.stage
    fingers = stage.motion if isinstance(stage, Gripper) else None
    still = (step.start, still_time(stage), fingers)
    motion, certificate = stand_still(cell, stage.settings, still, deadline)
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
    return StagePlan(
        index=step.index,
        kind=stage_kind(stage),
        name=stage.settings.name,
        trajectory=motion,
        certificate=certificate,
        after=step.after,
        allowed=tuple(sorted(cell.scene.allowed_collisions)),
        target=step.target,
        plan=None,
        milliseconds=1e3 * (time.perf_counter() - began),
        fingers=fingers,
    )
