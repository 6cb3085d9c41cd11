"""Plans along seams in one branch: the search, the calmer way, approach and retreat, transit."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.pose import transform
from planning.clearance.time_shortcut import quicken
from planning.options import CartesianOptions
from planning.planner import Query
from planning.result import Attempt, Failure
from planning.search.rrt_connect import rrt_connect, straight_line
from planning.search.shortcut import shortcut
from planning.tool_motions.tool_motion import line
from planning.tool_motions.tool_path import (
    PartName,
    Stop,
    Tolerances,
    ToolPath,
    ToolRun,
    ToolSegment,
)
from planning.tool_motions.tool_tolerance import SeamOptions, StraightOffset
from planning.tool_paths.seams.failure import explain_bend, explain_search, explain_stop
from planning.tool_paths.seams.following import refine, segments, with_fewer_ranges
from planning.tool_paths.seams.nodes import COARSE, DENSE, FINE, Density
from planning.tool_paths.seams.path import seam_places, seam_runs, through_spline
from planning.tool_paths.seams.search import SeamJoints, SeamSearch
from planning.tool_paths.tool_following import follow, free_part

#: Reasons for which another branch may go on.
_OTHER_BRANCH = {"branch", "limit", "singularity", "collision", "unreachable"}
#: Name of the planner.
NAME = "cartesian"


#: Straight motions before or after a seam, and their joint paths.
_Ends = tuple[tuple[ToolRun, ...], tuple[ToolSegment, ...]]


@dataclass(frozen=True, slots=True, eq=False)
class SeamPart:
    """A part of a seam that is followed in one branch, with the ways there, before and after.

    Args:
        motions: Motions of the tool.
        segments: The joint path of each.
        transit: Waypoints of the free motion to where the first one begins, shape (k, n); None
            where the robot is there.
        detail: Account how it was found, for a person.
    """

    motions: tuple[ToolRun, ...]
    segments: tuple[ToolSegment, ...]
    transit: Array | None
    detail: str


def plan_in_one_branch(
    query: Query, start: Array, options: CartesianOptions, tolerances: Tolerances
) -> SeamPart | Failure:
    """Find a joint path along a seam in one branch, from where the arm is.

    Args:
        query: The robot in its scene; goals are not checked.
        start: Configuration of the arm, shape (n,).
        options: Options with a seam.
        tolerances: Deviations that are added to the tolerances of the seam.

    Raises:
        InvalidGoal: Two waypoints at one place, or an arc that names no circle.
    """
    seam = options.seam
    assert seam is not None
    places = seam_places(seam_runs(seam, options.blend))
    search = SeamSearch(query.checker, places, start, seam.speeds, query.deadline)
    found, followed = _search(query, search, tolerances, advise=seam.branch_changes is None)
    if isinstance(followed, Failure):
        return followed
    before = _beside(query, seam.approach, followed[0].start, "approach", tolerances)
    if isinstance(before, Failure):
        return before
    after = _beside(query, seam.retreat, followed[-1].end, "retreat", tolerances)
    if isinstance(after, Failure):
        return after
    parts = (*before[1], *followed, *after[1])
    transit = _transit(query, start, parts[0].start)
    if isinstance(transit, Failure):
        return transit
    detail = (
        f"{len(seam.waypoints)} waypoints, {len(found.graph.nodes.joints)} configurations in "
        f"{len(found.graph.layers)} layers, {found.tries} way(s)."
    )
    return SeamPart((*before[0], *places.runs, *after[0]), parts, transit, detail)


def _search(
    query: Query, search: SeamSearch, tolerances: Tolerances, *, advise: bool
) -> tuple[SeamJoints, tuple[ToolSegment, ...] | Failure]:
    """A way along a seam with the joint paths of its runs: of few configurations, or of more."""
    looks: list[tuple[bool, Density]] = [(False, COARSE), (False, DENSE)]
    # Places of a seam up to which all of them are searched where a few have no way.
    if len(search.places.s) <= 600:
        looks += [(True, COARSE), (True, FINE)]
    unfound: list[SeamJoints] = []
    failure: tuple[SeamJoints, Failure] | None = None
    for every, density in looks:
        if query.deadline.passed and (unfound or failure):
            break
        for places in with_fewer_ranges(search.places, tolerances.position):
            narrower = replace(search, places=places)
            found = narrower.run(every, density)
            if found.joints is None:
                unfound.append(found)
                break
            found, followed = _follow_one(query, narrower, found, tolerances)
            if not isinstance(followed, Failure):
                return found, followed
            failure = failure or (found, followed)
            if followed.details.get("reason") != "deviation":
                break
    if failure is not None:
        return failure
    return unfound[-1], explain_search(search, [found.graph for found in unfound], advise=advise)


def _follow_one(
    query: Query, search: SeamSearch, found: SeamJoints, tolerances: Tolerances
) -> tuple[SeamJoints, tuple[ToolSegment, ...] | Failure]:
    """Joint paths of the way that was found, or of another where its spline meets something."""
    # Ways that are tried.
    for _ in range(6):
        assert found.joints is not None
        followed = _follow(query, search, found.joints, tolerances)
        if not isinstance(followed, Failure) or followed.details["reason"] != "collision":
            break
        other = search.around(found, followed.details["fraction"])
        if other.joints is None:
            break
        found = other
    return found, followed


def _follow(
    query: Query, search: SeamSearch, joints: Array, tolerances: Tolerances
) -> tuple[ToolSegment, ...] | Failure:
    """Joint paths of the runs, proved free: of the calmer way, or of the one that was found."""
    number, stop = 0, None
    for way in (refine(search, joints), joints):
        paths = segments(search.checker, search.places, way, tolerances, query.deadline)
        if paths is None:
            continue
        free = [free_part(query.checker, path) for path in paths]
        stops = [(k, path.stop) for k, path in enumerate(free) if path.stop is not None]
        if not stops:
            return tuple(free)
        number, stop = stops[0]
    if query.deadline.passed:
        stop = Stop(0.0 if stop is None else stop.at, "time", "time was up", {})
    return (
        explain_bend(search.places) if stop is None else explain_stop(search.places, number, stop)
    )


def _beside(
    query: Query, offset: StraightOffset | None, q: Array, name: PartName, tolerances: Tolerances
) -> _Ends | Failure:
    """The straight motion to the start of a seam, or from its end, at q (n,), in its branch."""
    if offset is None:
        return (), ()
    chain, T = query.checker.model.robot.chain, forward(query.checker.model.robot.chain, q)
    way = offset.distance * offset.direction / np.linalg.norm(offset.direction)
    way = T[:3, :3] @ way if offset.frame == "tool" else way
    way = -way if name == "approach" else way
    motion = line(T, transform(T[:3, :3], T[:3, 3] + way))
    segment = follow(chain, ToolRun.of(motion), q, tolerances, query.deadline)
    segment = free_part(query.checker, segment)
    if segment.stop is not None:
        return _end_failure(name, segment, segment.stop)
    if name == "approach":
        motion, segment = line(motion.T_end, motion.T_start), segment.reverse()
    return (replace(ToolRun.of(motion), name=name),), (segment,)


def _end_failure(name: str, segment: ToolSegment, stop: Stop) -> Failure:
    details: dict[str, Any] = {"part": name, "reason": stop.reason, "reached": segment.reached}
    return Failure(
        "TIMED_OUT" if stop.reason == "time" else "PLANNING_FAILED",
        f"the {name} can't be carried out beyond {100.0 * segment.reached:.4g} % of it: "
        f"{stop.message}",
        f"Give the {name} another direction, or a smaller distance.",
        NAME,
        details=details | stop.details,
    )


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


def plan_seam(query: Query, options: CartesianOptions, tolerances: Tolerances) -> Attempt:
    """Find a joint path along a seam, from where the arm starts.

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
    if isinstance(found, Failure):
        failure = _with_advice(found, seam)
        if seam.branch_changes is not None:
            # Parts are searched for without advice; where they do not help it is given after all.
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
        # Waypoints are counted from the first of the whole seam.
        motions += [replace(run, asked=tuple(k + first for k in run.asked)) for run in part.motions]
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
    if changes:
        places = ", ".join(f"waypoints[{k}]" for k in changes)
        change = f"The arm goes on in another branch from {places}, with a retreat before."
        notes = (*notes, change)
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
    # Waypoints before the last one reached at which a change is tried too.
    steps_back = (0, 1, 2, 4, 8)
    for step in steps_back:
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


def _with_advice(failure: Failure, seam: SeamOptions) -> Failure:
    """A failure of one branch that tells of branch changes, where they may help."""
    reached = _last_reached(failure.details)
    if failure.stage != NAME or reached is None or reached < 1 or seam.branch_changes is not None:
        return failure
    return replace(
        failure,
        hint=f"{failure.hint} Or allow branch_changes: the arm may go on in another branch.",
    )
