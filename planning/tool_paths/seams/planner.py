"""Plans along seams: the path in one branch, approach and retreat, transit, changes of branch."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from kinematics.arrays import Array
from kinematics.forward import forward
from planning.clearance.time_shortcut import quicken
from planning.options import CartesianOptions
from planning.planner import Query
from planning.result import Failure
from planning.search.rrt_connect import rrt_connect, straight_line
from planning.search.shortcut import shortcut
from planning.tool_motions.tool_path import PartName, Tolerances, ToolPath, ToolRun
from planning.tool_motions.tool_tolerance import StraightOffset
from planning.tool_paths.seams.failure import explain_search
from planning.tool_paths.seams.following import follow_seam
from planning.tool_paths.seams.path import seam_places, seam_runs, through_spline
from planning.tool_paths.seams.search import SeamSearch
from planning.tool_paths.tool_following import NAME, lead_tool, stop_failure

#: Reasons for which another branch may go on.
_OTHER_BRANCH = {"branch", "limit", "singularity", "collision", "unreachable"}


def _plan_in_one_branch(
    query: Query, start: Array, options: CartesianOptions, tolerances: Tolerances
) -> ToolPath | Failure:
    """A joint path along a seam in one branch, from a start (n,), with approach and retreat."""
    seam = options.seam
    assert seam is not None
    places = seam_places(seam_runs(seam, options.blend))
    search = SeamSearch(query.checker, places, start, seam.speeds, query.deadline)
    path, failure, unfound = follow_seam(search, tolerances)
    if path is None:
        return failure or explain_search(search, unfound, advise=seam.branch_changes is None)
    parts = [path]
    if seam.approach is not None:
        first = path.segments[0].start
        parts.insert(0, _lead_beside(query, seam.approach, first, "approach", tolerances))
    if seam.retreat is not None:
        last = path.segments[-1].end
        parts.append(_lead_beside(query, seam.retreat, last, "retreat", tolerances))
    for part in parts:
        if part.stop is not None:
            name, reached = part.runs[0].name, part.segments[0].reached
            return stop_failure(
                part.stop,
                f"the {name} can't be carried out beyond {100.0 * reached:.4g} % of it",
                f"Give the {name} another direction, or a smaller distance.",
                part=name,
                reached=reached,
            )
    whole = ToolPath.joined(parts)
    transit = _transit(query, start, whole.segments[0].start)
    if isinstance(transit, Failure):
        return transit
    return whole if transit is None else replace(whole, transits=((0, transit),))


def _lead_beside(
    query: Query, offset: StraightOffset, q: Array, name: PartName, tolerances: Tolerances
) -> ToolPath:
    """The straight motion to the start of a seam, or from its end, at q (n,), in its branch."""
    T = forward(query.checker.model.robot.chain, q)
    way = offset.distance * offset.direction / np.linalg.norm(offset.direction)
    way = T[:3, :3] @ way if offset.frame == "tool" else way
    run = replace(ToolRun.straight(T, -way if name == "approach" else way), name=name)
    path = lead_tool(query.checker, q, [run], tolerances, query.deadline)
    return path.reverse() if name == "approach" and path.stop is None else path


def _transit(query: Query, start: Array, goal: Array) -> Array | Failure | None:
    """Waypoints of the free motion to the start of a seam; None where the arm is there."""
    # Motions of the joints below this are none [rad or m].
    if np.abs(start - goal).max() <= 1e-9:
        return None
    waypoints, _ = straight_line(query.checker, start, [goal])
    if waypoints is None:
        deadline = query.deadline
        # Edges of the trees that search for the way to a seam at most.
        waypoints = rrt_connect(
            query.checker, start, [goal], query.seed, deadline, 200_000
        ).waypoints
        if waypoints is None:
            return Failure(
                "TIMED_OUT" if deadline.passed else "PLANNING_FAILED",
                "the seam can be followed, but no free motion to its start was found",
                "Start nearer to it, or allow more time.",
                NAME,
                details={"part": "transit", "seam_start": goal.tolist()},
            )
        short = shortcut(query.checker, waypoints)
        waypoints = quicken((query.checker,), short, query.limits)
    return waypoints


def plan_seam(
    query: Query, options: CartesianOptions, tolerances: Tolerances
) -> tuple[ToolPath, tuple[str, ...]] | Failure:
    """Find a joint path along a seam, from where the arm starts, with notes on it.

    Args:
        query: The robot in its scene; goals are not checked.
        options: Options with a seam.
        tolerances: Deviations that are added to the tolerances of the seam.

    Raises:
        InvalidGoal: Two waypoints at one place, or an arc that names no circle.
    """
    seam = options.seam
    assert seam is not None
    notes: tuple[str, ...] = ()
    if seam.through == "spline":
        seam, away = through_spline(seam)
        options = replace(options, seam=seam)
        notes = (f"The spline through the waypoints leaves the lines by {away:.3g} m at most.",)
    # Parts of a seam at most.
    found = _plan_parts(query, query.ready.start, options, tolerances, 12)
    if isinstance(found, Failure) and seam.branch_changes is not None:
        # Parts are searched for without advice; where they do not help it is given after all.
        one = replace(options, seam=replace(seam, branch_changes=None))
        again = _plan_in_one_branch(query, query.ready.start, one, tolerances)
        return again if isinstance(again, Failure) else found
    if isinstance(found, Failure):
        return _with_advice(found)
    # Waypoints are counted from the first of the whole seam.
    parts = [
        replace(
            part,
            runs=tuple(replace(r, asked=tuple(k + first for k in r.asked)) for r in part.runs),
        )
        for first, part in found
    ]
    if len(parts) > 1:
        places = ", ".join(f"waypoints[{first}]" for first, _ in found[1:])
        change = f"The arm goes on in another branch from {places}, with a retreat before."
        notes = (*notes, change)
    band = seam.speed_band if seam.speeds else None
    return replace(ToolPath.joined(parts), speed_band=band), notes


def _plan_parts(
    query: Query, start: Array, options: CartesianOptions, tolerances: Tolerances, most: int
) -> list[tuple[int, ToolPath]] | Failure:
    """Parts of a seam, each with the waypoint that it begins at."""
    whole = _plan_in_one_branch(query, start, options, tolerances)
    if isinstance(whole, ToolPath):
        return [(0, whole)]
    seam = options.seam
    assert seam is not None
    offset, last = seam.branch_changes, _last_reached(whole.details)
    if offset is None or most <= 1 or last is None:
        return whole
    back = replace(offset, direction=-offset.direction)
    # Waypoints before the last one reached at which a change is tried too.
    steps_back = (0, 1, 2, 4, 8)
    for step in steps_back:
        cut = min(last, len(seam.waypoints) - 2) - step
        if cut < 1 or query.deadline.passed:
            break
        before = replace(seam, waypoints=seam.waypoints[: cut + 1], retreat=offset)
        first = _plan_in_one_branch(query, start, replace(options, seam=before), tolerances)
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


def _with_advice(failure: Failure) -> Failure:
    """A failure of one branch that names branch changes, where they may help."""
    reached = _last_reached(failure.details)
    if reached is None or reached < 1:
        return failure
    return replace(
        failure,
        hint=f"{failure.hint} Or allow branch_changes: the arm may go on in another branch.",
    )
