"""Plans along seams, in one branch of inverse kinematics or in several with rests between them.

A seam that no single branch follows is cut at the last waypoint that one does. There the tool
retreats at rest, the arm moves freely to another branch, and the tool comes back the same way.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from kinematics.arrays import Array
from planning.options import CartesianOptions
from planning.planner import Query
from planning.result import Attempt, Failure
from planning.tool_motions.seam_options import SeamOptions
from planning.tool_motions.tool_path import Tolerances, ToolPath, ToolSegment
from planning.tool_motions.tool_run import ToolRun
from planning.tool_paths.seams.planner import NAME, SeamPart, plan_in_one_branch

#: Parts of a seam at most.
_MAX_PARTS = 12
#: Waypoints before the last one reached at which a change is tried too.
_STEPS_BACK = (0, 1, 2, 4, 8)
#: Reasons for which another branch may go on.
_OTHER_BRANCH = {"branch", "limit", "singularity", "collision", "unreachable"}


def plan_seam(query: Query, options: CartesianOptions, tolerances: Tolerances) -> Attempt:
    """Find a joint path along a seam, from where the arm starts.

    Args:
        query: The robot in its scene; goals are not looked at.
        options: With a seam.
        tolerances: Deviations that are added to the tolerances of the seam.

    Raises:
        InvalidGoal: Two waypoints at one place, or an arc that names no circle.
    """
    seam = options.seam
    assert seam is not None
    found = _plan_parts(query, query.ready.start, options, tolerances, _MAX_PARTS)
    if isinstance(found, Failure):
        failure = _with_advice(found, seam)
        if seam.branch_changes is not None:
            # Parts are looked for without advice; where they do not help it is given after all.
            one = replace(options, seam=replace(seam, branch_changes=None))
            again = plan_in_one_branch(query, query.ready.start, one, tolerances)
            failure = again if isinstance(again, Failure) else failure
        return Attempt(None, f"{failure.message}.", failure=failure)
    motions: list[ToolRun] = []
    segments: list[ToolSegment] = []
    transits: list[tuple[int, Array]] = []
    changes: list[int] = []
    for first, part in found:
        if part.transit is not None:
            transits.append((len(motions), part.transit))
        if first > 0:
            changes.append(first)
        motions += [_renumber(run, first) for run in part.motions]
        segments += part.segments
    path = ToolPath(
        tuple(motions),
        tuple(segments),
        1.0,
        None,
        tolerances,
        tuple(transits),
        seam.speed_band if seam.speeds else None,
    )
    notes: tuple[str, ...] = ()
    if changes:
        places = ", ".join(f"waypoints[{k}]" for k in changes)
        notes = (f"The arm goes on in another branch from {places}, with a retreat before.",)
    return Attempt(path.waypoints, found[0][1].detail, notes=notes, tool_path=path)


def _plan_parts(
    query: Query, start: Array, options: CartesianOptions, tolerances: Tolerances, most: int
) -> list[tuple[int, SeamPart]] | Failure:
    """Parts of a seam, each with the waypoint that it begins at."""
    whole = plan_in_one_branch(query, start, options, tolerances)
    if isinstance(whole, SeamPart):
        return [(0, whole)]
    seam = options.seam
    assert seam is not None
    offset, last = seam.branch_changes, _last_reached(whole.details)
    if offset is None or most <= 1 or last is None:
        return whole
    back = replace(offset, direction=-offset.direction)
    for step in _STEPS_BACK:
        cut = min(last, len(seam.waypoints) - 2) - step
        if cut < 1 or query.deadline.passed:
            break
        before = replace(seam, waypoints=seam.waypoints[: cut + 1], retreat=offset)
        first = plan_in_one_branch(query, start, replace(options, seam=before), tolerances)
        if isinstance(first, Failure):
            continue
        after = replace(seam, waypoints=seam.waypoints[cut:], approach=back)
        there = first.segments[-1].end
        rest = _plan_parts(query, there, replace(options, seam=after), tolerances, most - 1)
        if isinstance(rest, list):
            return [(0, first), *((cut + k, part) for k, part in rest)]
    return whole


def _last_reached(details: Mapping[str, Any]) -> int | None:
    """The last waypoint that one branch reaches; None where no other branch would help."""
    if details.get("reason") not in _OTHER_BRANCH or not details.get("other_branches", True):
        return None
    reached = details.get("reached_waypoint", int(details.get("waypoint", 0)) - 1)
    return int(reached)


def _renumber(run: ToolRun, first: int) -> ToolRun:
    """A run whose waypoints are counted from the first of the whole seam."""
    return replace(run, asked=tuple(asked + first for asked in run.asked))


def _with_advice(failure: Failure, seam: SeamOptions) -> Failure:
    """A failure of one branch that tells of branch changes, where they may help."""
    reached = _last_reached(failure.details)
    if failure.stage != NAME or reached is None or reached < 1 or seam.branch_changes is not None:
        return failure
    return replace(
        failure,
        hint=f"{failure.hint} Or allow branch_changes: the arm may go on in another branch.",
    )
