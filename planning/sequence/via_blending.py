"""Stages that pass their ends without resting: free motions in a row, timed as one.

The paths are those that were found and proved one by one. They are joined to one polyline, whose
corner between two stages is rounded like any other, within the distance that the stage allows. The
motion is cut where it crosses the plane that halves this corner, and each part is proved as the
motion of its stage. Where that can't be done, or a stop is quicker, the arm rests, and the answer
says so.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array, Indices
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.checker import Checker
from planning.clearance.levels import clearance_levels
from planning.clearance_report import clearance_report
from planning.options import Options, with_limits
from planning.proof.certificate import certify
from planning.result import Path, Plan
from planning.sequence.result import StagePlan, total_duration
from planning.sequence.stage import passing_distance
from planning.sequence.step import Step, constraint_set
from planning.sequence.world import Cell, Cells
from planning.timing.choice import chosen_parametrization
from planning.timing.options import TimingFailed
from planning.timing.parametrization import TimeParametrization
from planning.timing.path.blend import (
    certified_reaches,
    corner_indices,
    largest_reaches,
    merge,
    reach_for_deviation,
)
from planning.tool_motions.passing_times import first_approach, instants, times_of_passing
from planning.values.deadline import Deadline

#: The motion may be farther from a corner than asked by what rounding leaves.
_ROUNDING = 1e-9
_RESTS = (
    "The arm rests at the end of this stage: a motion that passes it within its blend takes longer "
    "or could not be proved."
)


class _Part(NamedTuple):
    """One stage of a run.

    Args:
        step: The stage under the choices made.
        plan: Motion from rest to rest.
        cell: The robot in its surroundings.
        points: Polyline of the path, merged, shape (k, n).
        blend: How far from its end it may pass it; None for the last one.
    """

    step: Step
    plan: Plan
    cell: Cell
    points: Array
    blend: float | None


def pass_ends(cells: Cells, steps: Sequence[Step], deadline: Deadline) -> tuple[StagePlan, ...]:
    """The plans of all steps, stages that ask for it passing their ends without rest.

    Args:
        cells: Cells that were put together.
        steps: Steps of a combination, in order, each with its plan from rest to rest.
        deadline: Time at which to leave the arm resting.
    """
    plans = [step.plan for step in steps if step.plan is not None]
    for first, last in _runs(steps):
        plans[first:last] = _pass_run(cells, steps[first:last], deadline)
    return tuple(plans)


def _runs(steps: Sequence[Step]) -> list[tuple[int, int]]:
    """First step and the one after the last of each row of stages that pass their ends."""
    runs, first = [], None
    for k, step in enumerate(steps):
        if passing_distance(step.stage) is not None:
            first = k if first is None else first
        elif first is not None:
            runs.append((first, k + 1))
            first = None
    return runs


def _pass_run(cells: Cells, steps: Sequence[Step], deadline: Deadline) -> list[StagePlan]:
    parts = [_part(cells, step) for step in steps]
    known = [step.plan for step in steps if step.plan is not None]
    proved = None if deadline.passed else _time_and_prove(parts, known, deadline)
    direct = None if deadline.passed else _direct_at_ends(parts)
    if direct is not None:
        # Also where all pass: through a short leg they do so next to the end, and slowly.
        other = _time_and_prove(direct, known, deadline)
        if other is not None and (proved is None or total_duration(other) < total_duration(proved)):
            proved = other
    if proved is not None:
        return proved
    return [_with_note(plan) for plan in known[:-1]] + known[-1:]


def _part(cells: Cells, step: Step) -> _Part:
    assert step.plan is not None
    assert step.plan.plan is not None
    plan = step.plan.plan
    cell = cells.cell(step.world, step.allowed, step.stage.settings.margin)
    points = merge(plan.path.waypoints)
    return _Part(step, plan, cell, points, passing_distance(step.stage))


def _direct_at_ends(parts: list[_Part]) -> list[_Part] | None:
    """The stages without the waypoints next to ends that are passed; None where all are needed.

    An end that is nearer to something than preferred is met and left by a short leg to where there
    is room. Both are too short to round their corner, and where they are the same one there is
    nothing to round.
    """
    direct: list[_Part] = []
    for k, one in enumerate(parts):
        part = one
        points, checker = part.points, part.cell.checker
        before = parts[k - 1].blend if k else None
        if part.blend is not None:
            points = _without_short_leg(points[::-1], checker, part.blend)[::-1]
        if before is not None:
            points = _without_short_leg(points, checker, before)
        if len(points) < len(part.points):
            points = np.ascontiguousarray(points)
            plan = replace(part.plan, path=Path(points))
            part = part._replace(points=points, plan=plan)
        direct.append(part)
    same = all(one is part for one, part in zip(direct, parts, strict=True))
    return None if same else direct


def _without_short_leg(points: Array, checker: Checker, blend: float) -> Array:
    """Waypoints (k, n) without the second, where the first leg ends within ``blend`` of the first.

    And where the way that is left is free.
    """
    if len(points) < 3 or np.linalg.norm(points[1] - points[0]) > blend:
        return points
    return np.delete(points, 1, axis=0) if checker.free(points[0], points[2]) else points


def _with_note(plan: StagePlan) -> StagePlan:
    assert plan.plan is not None
    return replace(plan, plan=replace(plan.plan, notes=(*plan.plan.notes, _RESTS)))


def _time_and_prove(
    parts: list[_Part], known: list[StagePlan], deadline: Deadline
) -> list[StagePlan] | None:
    """The stages of one motion, each proved; None where one is not."""
    parametrization = _parametrization(parts)
    lengths = [len(part.points) for part in parts]
    if min(lengths) < 2:
        return None
    points = np.concatenate([parts[0].points, *(part.points[1:] for part in parts[1:])])
    joins = np.cumsum(lengths)[:-1] - np.arange(1, len(parts))
    reaches = _reaches(parts, points, joins, parametrization, deadline)
    kept = np.flatnonzero(~_is_straight(points))
    names = parts[0].cell.robot.chain.joint_names
    try:
        motion = parametrization.time_polyline(points[kept], reaches[kept[1:-1] - 1], names)
    except TimingFailed:
        return None
    if motion.trajectory.duration >= total_duration(known):
        return None
    pieces = _cut(motion.trajectory, points, joins, [part.blend or 0.0 for part in parts])
    if pieces is None:
        return None
    stages: list[StagePlan] = []
    for part, plan, piece in zip(parts, known, pieces, strict=True):
        stage = _proved(part, plan, piece, parametrization, deadline)
        if stage is None:
            return None
        stages.append(stage)
    return stages


def _parametrization(parts: list[_Part]) -> TimeParametrization:
    """Method and limits of a run; those of constraints of all its stages."""
    chain = parts[0].cell.robot.chain
    options: Options = parts[0].step.stage.settings.options
    for part in parts:
        options = with_limits(options, constraint_set(part.cell, part.step.stage.settings))
    return chosen_parametrization(
        options.timing, chain.joint_names, chain.limits, options.limits, chain
    )


def _is_straight(points: Array) -> NDArray[np.bool_]:
    """Whether each waypoint lies on a straight leg and is no corner, shape (k,)."""
    straight = np.ones(len(points), dtype=np.bool_)
    straight[corner_indices(points)] = False
    return straight


def _reaches(
    parts: list[_Part],
    points: Array,
    joins: Indices,
    parametrization: TimeParametrization,
    deadline: Deadline,
) -> Array:
    """Reaches of all inner waypoints whose curves are proved free, shape (k - 2,)."""
    smooth = parametrization.smooth
    tolerance = parts[0].step.stage.settings.options.timing.blend_tolerance
    most = largest_reaches(points)
    if tolerance is not None:
        most = reach_for_deviation(points, tolerance, smooth)
    for part, join in zip(parts, joins, strict=False):
        assert part.blend is not None
        most[join - 1] = reach_for_deviation(points, part.blend, smooth)[join - 1]
    first = 0
    for k, part in enumerate(parts):
        last = first + len(part.points) - 1
        own = (points[first : last + 1], deadline)
        if last - first > 1:
            most[first : last - 1] = certified_reaches(
                part.cell.checker, *own, smooth=smooth, most=most[first : last - 1],
                preferred=_preferred(part),
            )  # fmt: skip
        if k + 1 < len(parts):
            # Both stages have to be free all along the corner: it is not known where it is cut.
            corner = (points[last - 1 : last + 2], deadline)
            allowed = most[last - 1 : last]
            for one in (part, parts[k + 1]):
                allowed = certified_reaches(
                    one.cell.checker, *corner, smooth=smooth, most=allowed,
                    preferred=_preferred(one),
                )  # fmt: skip
            most[last - 1 : last] = allowed
        first = last
    return most


def _preferred(part: _Part) -> Sequence[Checker]:
    return clearance_levels(part.cell.checker, part.step.stage.settings.options.clearance)[:-1]


def _cut(
    motion: Trajectory, points: Array, joins: Indices, blends: list[float]
) -> list[Trajectory] | None:
    """The parts of a motion between corners; None where it passes one too far away."""
    # Samples of each piece of a motion for the instant at which it passes a corner.
    grid = instants(motion, 8)
    joints, now = motion.sample(grid), 0
    times: list[float] = []
    for k in range(1, len(points) - 1):
        now = first_approach(joints, points[k], now)
        if k in joins:
            low, high = grid[max(now - 1, 0)], grid[min(now + 1, len(grid) - 1)]
            times.append(_crossing(motion, points[k - 1 : k + 2], float(low), float(high)))
    parts, began = [], 0.0
    for time, join, blend in zip(times, joins, blends, strict=False):
        if not 0.0 < time - began < motion.duration:
            return None
        part, motion = motion.split(time - began)
        began = time
        if np.linalg.norm(part.end - points[join]) > blend + _ROUNDING:
            return None
        parts.append(part)
    return [*parts, motion]


def _crossing(motion: Trajectory, legs: Array, low: float, high: float) -> float:
    """Time at which a motion crosses the plane that halves a corner, given as (3, n) [s]."""
    breaks = motion.breaks[(motion.breaks >= low) & (motion.breaks <= high)]
    at_corner = np.abs(motion.sample(breaks) - legs[1]).max(axis=1, initial=0.0) < _ROUNDING
    if at_corner.any():
        return float(breaks[at_corner][0])
    ways = np.diff(legs, axis=0)
    along = (ways / np.linalg.norm(ways, axis=1, keepdims=True)).sum(axis=0)
    ends = np.array([low]), np.array([high])
    return times_of_passing(lambda times: (motion.sample(times) - legs[1]) @ along, *ends)[0]


def _proved(
    part: _Part,
    known: StagePlan,
    motion: Trajectory,
    parametrization: TimeParametrization,
    deadline: Deadline,
) -> StagePlan | None:
    settings, cell = part.step.stage.settings, part.cell
    certificate = certify(
        motion, cell.robot, cell.scene,
        margin=settings.margin,
        constraints=constraint_set(cell, settings),
        limits=parametrization.motion_limits,
        deadline=deadline,
    )  # fmt: skip
    if not certificate.verified:
        return None
    speed = motion.sample([motion.duration], 1)
    # Slower than this at its end the arm counts as resting there [rad/s or m/s].
    passes = part.blend is not None and float(np.abs(speed).max()) > 1e-6
    notes = part.plan.notes if passes or part.blend is None else (*part.plan.notes, _RESTS)
    plan = replace(
        part.plan, trajectory=motion, certificate=certificate, notes=notes,
        clearance=clearance_report(
            [cell.checker], motion, settings.options.clearance, settings.margin,
            (certificate.min_obstacle_clearance, certificate.min_self_clearance),
        ),
    )  # fmt: skip
    return replace(known, trajectory=motion, certificate=certificate, plan=plan, passes=passes)
