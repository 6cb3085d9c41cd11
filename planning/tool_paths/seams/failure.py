"""Reasons why a seam can't be followed: where, by how much, and which tolerance would help."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array
from kinematics.ik.numeric import numeric
from kinematics.jacobian import geometric
from kinematics.model.chain import Chain
from planning.result import Failure
from planning.tool_motions.tool_path import Reason, Stop
from planning.tool_motions.tool_tolerance import RX, RZ, ToolTolerance
from planning.tool_paths.seams.path import SeamPlaces, corner_angle, pack_tolerance
from planning.tool_paths.seams.search import SeamGraph, SeamSearch

#: Name of the planner.
_NAME = "cartesian"
#: Tilts that are tried [rad].
_TILTS = tuple(math.radians(angle) for angle in (5.0, 15.0, 30.0, 45.0))

#: What to try, by the reason.
_HINTS: dict[Reason, str] = {
    "limit": "Move the work or the robot's base.",
    "singularity": "Move the work off the singularity.",
    "unreachable": "Bring the waypoint nearer.",
    "branch": "Split the seam where the longest part ends.",
    "collision": "Move what is in the way.",
    "deviation": "Allow a larger max_deviation, or waypoints farther apart.",
    "time": "Allow more time.",
}


_BEND_HINT = (
    "Allow a larger max_deviation, give the waypoints a blend, or lead the path through arcs (via) "
    "where it is a curve."
)
_RANGE_HINT = (
    "Where the path bends, ranges of position that leave out 0 can be kept across it only: let "
    "them hold 0, or turn their axes with the path."
)


@dataclass(frozen=True, slots=True)
class _Reason:
    """Reason why no way leads to a layer.

    Args:
        reason: Reason in a word.
        message: One sentence.
        details: Numbers for the reason.
    """

    reason: Reason
    message: str
    details: dict[str, Any]


def explain_search(
    search: SeamSearch, graphs: Sequence[SeamGraph], *, advise: bool = True
) -> Failure:
    """Reason why the layers of a seam have no continuous way that is free.

    Args:
        search: Search that found none.
        graphs: Layers of each search; those of the one that came farthest explain the failure.
        advise: Whether tolerances are searched for that would help, which takes its time.
    """
    if search.deadline.passed:
        return Failure("TIMED_OUT", "time was up before a way along the seam was found",
                       _HINTS["time"], _NAME)  # fmt: skip
    for one in graphs:
        search.check_all(one)
        search.solve(one)
    graph = max(graphs, key=lambda one: int(one.layers[max(_first_unreached(one) - 1, 0)]))
    places, layers = search.places, graph.layers
    failing = _first_unreached(graph)
    reason = _reason(search, graph, failing)
    first, last, _ = graph.longest()
    place = layers[failing]
    before = layers[max(failing - 1, 0)]
    waypoint = int(places.waypoint[place])
    details = {
        "reason": reason.reason,
        "waypoint": waypoint,
        "reached_waypoint": int(places.waypoint[before]),
        "fraction": float(places.along[before] / places.length),
        "longest": {
            "from_waypoint": int(places.waypoint[layers[first]]),
            "to_waypoint": int(places.waypoint[layers[last]]),
            "fraction": float((places.along[layers[last]] - places.along[layers[first]])
                              / places.length),
        },
        "followable": _followable(places, graph),
        "other_branches": bool(np.isfinite(graph.costs[graph.of_layer(failing)]).any()),
        **reason.details,
        "would_help": list(_helpful_tolerances(search)) if advise else [],
    }  # fmt: skip
    message = f"the seam can't be followed beyond waypoints[{waypoint}]: {reason.message}"
    return Failure(
        "PLANNING_FAILED", message, _hint(reason.reason, details), _NAME, details=details
    )


def _hint(reason: Reason, details: dict[str, Any]) -> str:
    """Advice with the parts of the seam that can be followed by themselves."""
    hint = _HINTS[reason]
    if details["would_help"]:
        hint += " Or widen the tolerance as would_help says."
    parts = [f"{p['from_waypoint']} to {p['to_waypoint']}" for p in details["followable"]]
    return f"{hint} Waypoints {' and '.join(parts)} can be followed." if parts else hint


def _followable(places: SeamPlaces, graph: SeamGraph) -> list[dict[str, int]]:
    """The parts of a seam that can be followed by themselves, from waypoint to waypoint."""
    layer = np.repeat(np.arange(len(graph.layers)), np.diff(graph.nodes.firsts))
    reached = np.isfinite(graph.best)
    parts: list[dict[str, int]] = []
    end = -1
    for first in np.unique(graph.origin[reached]):
        last = int(layer[reached & (graph.origin == first)].max())
        if last <= end:
            continue
        end, place = last, graph.layers[first]
        begin, to = int(places.waypoint[place]), int(places.waypoint[graph.layers[last]])
        if place > 0 and places.waypoint[place - 1] == begin:
            begin += 1  # the part begins behind that waypoint
        if to > begin:
            parts.append({"from_waypoint": begin, "to_waypoint": to})
    return parts


def explain_stop(places: SeamPlaces, number: int, stop: Stop) -> Failure:
    """Failure of a joint path that stops on one of the runs of a seam.

    Args:
        places: Places of the seam.
        number: Index of the run.
        stop: Place and reason of the stop.
    """
    run = places.runs[number]
    part = run.parts_until(max(stop.at, 1e-9))[-1]
    before = sum(other.length for other in places.runs[:number])
    fraction = (before + stop.at * run.length) / places.length
    waypoint = part.asked + 1
    return Failure(
        "TIMED_OUT" if stop.reason == "time" else "PLANNING_FAILED",
        f"the seam can't be followed to waypoints[{waypoint}]: {stop.message}",
        _HINTS[stop.reason],
        _NAME,
        details={"reason": stop.reason, "waypoint": waypoint, "fraction": fraction, **stop.details},
    )


def explain_bend(places: SeamPlaces) -> Failure:
    """Failure of a seam that bends more sharply than a spline of the joints can follow.

    Args:
        places: Places of the seam.
    """
    bends = [
        (corner_angle(first.motion, second.motion), first.asked + 1)
        for run in places.runs
        for first, second in pairwise(run.parts)
    ]
    angle, waypoint = max(bends, default=(0.0, 1))
    ranged = any((t.upper > t.lower)[:RX].any() for t in places.tolerances)
    return Failure(
        "PLANNING_FAILED",
        "the joints would have to turn too sharply to keep the tool within its tolerance; the path "
        f"bends most at waypoints[{waypoint}], by {math.degrees(angle):.3g} degrees",
        f"{_BEND_HINT} {_RANGE_HINT}" if ranged else _BEND_HINT,
        _NAME,
        details={"reason": "deviation", "waypoint": waypoint, "bend": angle},
    )


def _first_unreached(graph: SeamGraph) -> int:
    """The first layer that no way from the first layer leads to."""
    for layer in range(len(graph.layers)):
        mine = graph.of_layer(layer)
        if not (np.isfinite(graph.best[mine]) & (graph.origin[mine] == 0)).any():
            return layer
    return len(graph.layers) - 1


def _reason(search: SeamSearch, graph: SeamGraph, layer: int) -> _Reason:
    """Reason why no way leads to a layer."""
    mine = graph.of_layer(layer)
    if not mine.size:
        return _out_of_reach(search, graph, layer)
    colliding = mine[graph.collided[mine]]
    if np.isfinite(graph.costs[mine]).any():
        met = _met_on_the_way(search, graph, mine)
        if not len(met):
            return _discontinuous(search, graph, layer)
        return _collision(search, met, "all ways there collide")
    if not colliding.size:
        return _Reason("limit", "all configurations there are at a joint limit", {})
    return _collision(search, graph.nodes.joints[colliding], "all configurations collide")


def _met_on_the_way(search: SeamSearch, graph: SeamGraph, mine: NDArray[np.int64]) -> Array:
    """Colliding configurations without which there would be a way to a layer, shape (k, n)."""
    joints, free = graph.nodes.joints, search.without_collisions(graph)
    reached = mine[np.isfinite(free.best[mine]) & (free.origin[mine] == 0)]
    if not reached.size:
        return np.empty((0, joints.shape[1]))
    colliding = reached[graph.collided[reached]]
    if colliding.size:
        return np.asarray(joints[colliding])
    way = free.way_to(int(reached[np.argmin(free.best[reached])]))
    hits = [graph.hits[step] for step in pairwise(way) if step in graph.hits]
    return np.array([joints[node] for node in way if graph.collided[node]] + hits)


def _collision(search: SeamSearch, colliding: Array, words: str) -> _Reason:
    """The least deep of some collisions, of configurations (k, n)."""
    depth, pair = search.checker.least_overlap(colliding) or (0.0, ("", ""))
    text = f"{words}, at best {pair[0]!r} with {pair[1]!r} by {depth:.4g} m"
    return _Reason("collision", text, {"pair": list(pair), "depth": depth})


def _out_of_reach(search: SeamSearch, graph: SeamGraph, layer: int) -> _Reason:
    """Reason why inverse kinematics has nothing for a layer."""
    chain, target = search.chain, search.places.nominal[graph.layers[layer]]
    # Starts of the search for the nearest pose.
    options = numeric.SearchOptions(starts=60)
    found = numeric.solve(chain, target, options, seed_joints=search.start)
    if graph.nodes.outside[layer]:
        n, limits = chain.n, chain.limits
        endless = replace(limits, lower=np.full(n, -np.inf), upper=np.full(n, np.inf))
        free = numeric.solve(replace(chain, limits=endless), target, options,
                             seed_joints=search.start)  # fmt: skip
        if free.solutions:
            return _limit_reason(chain, free.solutions[0].joints)
    if found.solutions:
        return _Reason("limit", "the closed form has no solution inside the limits there", {})
    nearest = found.nearest
    text = (
        f"the arm comes no nearer than {nearest.position_error:.4g} m and "
        f"{nearest.orientation_error:.4g} rad"
    )
    details = {
        "position_error": nearest.position_error,
        "orientation_error": nearest.orientation_error,
    }
    return _Reason("unreachable", text, details)


def _limit_reason(chain: Chain, q: np.ndarray) -> _Reason:
    """The joint that is farthest beyond its limits at a configuration."""
    limits = chain.limits
    turns = np.where(chain.joint_types == 0, 2.0 * np.pi, np.inf)
    middle = (
        np.where(np.isfinite(limits.lower + limits.upper), limits.lower + limits.upper, 0.0) / 2
    )
    q = np.where(np.isfinite(turns), q - 2.0 * np.pi * np.round((q - middle) / (2.0 * np.pi)), q)
    beyond = np.maximum(limits.lower - q, q - limits.upper)
    j = int(np.argmax(beyond))
    limit = float(limits.lower[j] if limits.lower[j] > q[j] else limits.upper[j])
    name, excess = chain.joint_names[j], max(float(beyond[j]), 0.0)
    text = f"joint {name!r} would have to go {excess:.4g} beyond its limit {limit:.6g}"
    details = {"joint": name, "limit": limit, "value": float(q[j]), "excess": excess}
    return _Reason("limit", text, details)


def _discontinuous(search: SeamSearch, graph: SeamGraph, layer: int) -> _Reason:
    """Reason why configurations of a layer can't be reached from those before."""
    firsts = graph.nodes.firsts
    before = np.arange(firsts[max(layer - 1, 0)], firsts[max(layer, 1)])
    reached = before[np.isfinite(graph.best[before]) & (graph.origin[before] == 0)]
    sharpest = 0.0
    # Configurations whose depth in obstacles is checked.
    for node in reached[:: max(1, len(reached) // 60)]:
        J = geometric(search.chain, graph.nodes.joints[node])
        values = np.linalg.svd(J[np.linalg.norm(J, axis=1) > 1e-9], compute_uv=False)
        sharpest = max(sharpest, float(values[-1] / values[0]))
    details = {"smallest_singular_value": sharpest}
    # Least singular value, as part of the largest, below which an arm counts as singular.
    if reached.size and sharpest < 2e-2:
        return _Reason("singularity", "all ways there come to a singularity", details)
    return _Reason(
        "branch", "the arm could only go on in another branch of its inverse kinematics", details
    )


def _helpful_tolerances(search: SeamSearch) -> Iterator[dict[str, Any]]:
    """Wider tolerances with which the seam has a way, the least of each kind."""
    # Share of the time that is left which is spent on tolerances that would help.
    # Time that is spent on that at most [s].
    deadline = search.deadline.within(min(0.5 * search.deadline.remaining, 3.0))
    # Ranges of position that are tried, on either side [m].
    positions = (0.005, 0.02)
    kinds = (
        [({"free": ["rz"]}, _with_free_spin)],
        [({"tilt": tilt}, lambda t, tilt=tilt: _with_tilt(t, tilt)) for tilt in _TILTS],
        [({"position": size}, lambda t, size=size: _with_position(t, size)) for size in positions],
    )
    for kind in kinds:
        for change, widen in kind:
            if deadline.passed:
                return
            wide = {id(t): widen(t) for t in set(search.places.tolerances)}
            if all(wide[id(t)] is t for t in search.places.tolerances):
                continue
            tolerances = tuple(wide[id(t)] for t in search.places.tolerances)
            boxes = np.array([pack_tolerance(tolerance) for tolerance in tolerances])
            places = replace(search.places, tolerances=tolerances, boxes=boxes)
            if replace(search, places=places, deadline=deadline).run().joints is not None:
                yield change
                break


def _with_free_spin(tolerance: ToolTolerance) -> ToolTolerance:
    lower, upper = tolerance.lower.copy(), tolerance.upper.copy()
    if not np.isfinite(lower[RZ]):
        return tolerance
    lower[RZ], upper[RZ] = -np.inf, np.inf
    return replace(tolerance, lower=lower, upper=upper)


def _with_tilt(tolerance: ToolTolerance, tilt: float) -> ToolTolerance:
    lower, upper = tolerance.lower.copy(), tolerance.upper.copy()
    if not (np.isfinite(lower[RX:RZ]).all() and np.abs([lower[RX:RZ], upper[RX:RZ]]).max() < tilt):
        return tolerance
    lower[RX:RZ], upper[RX:RZ] = -tilt, tilt
    return replace(tolerance, lower=lower, upper=upper, tilt=tilt)


def _with_position(tolerance: ToolTolerance, size: float) -> ToolTolerance:
    lower, upper = tolerance.lower.copy(), tolerance.upper.copy()
    lower[:RX], upper[:RX] = np.minimum(lower[:RX], -size), np.maximum(upper[:RX], size)
    return replace(tolerance, lower=lower, upper=upper)
