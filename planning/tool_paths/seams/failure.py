"""Reasons why a seam can't be followed: where, by how much, and which tolerance would help."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from kinematics.arrays import Array
from kinematics.ik.numeric import numeric
from planning.result import Failure
from planning.tool_motions.tool_path import Reason, Stop, ToolPath
from planning.tool_motions.tool_tolerance import RX, RZ, ToolTolerance
from planning.tool_paths.blending import corner_angle
from planning.tool_paths.projection import REACHED
from planning.tool_paths.seams.path import SeamPlaces
from planning.tool_paths.seams.search import SeamGraph, SeamSearch
from planning.tool_paths.tool_following import (
    HINTS,
    TIME,
    at_limit,
    no_way_on,
    out_of_reach,
    stop_failure,
)

#: Columns of deviations that may be widened.
_POSITION, _TILT, _SPIN = slice(RX), slice(RX, RZ), slice(RZ, None)
_BEND_HINT = (
    "Allow a larger max_deviation, give the waypoints a blend, or lead the path through arcs (via) "
    "where it is a curve."
)
_RANGE_HINT = (
    "Where the path bends, ranges of position that leave out 0 can be kept across it only: let "
    "them hold 0, or turn their axes with the path."
)


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
        return stop_failure(TIME, "no way along the seam was found")
    for one in graphs:
        search.check_all(one)
        search.solve(one)
    graph = max(graphs, key=lambda one: int(one.layers[max(_first_unreached(one) - 1, 0)]))
    places, layers = search.places, graph.layers
    failing = _first_unreached(graph)
    reason = _reason(search, graph, failing)
    first, last = graph.longest()
    place = layers[failing]
    before = layers[max(failing - 1, 0)]
    waypoint = int(places.waypoint[place])
    details = {
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
        "would_help": list(_helpful_tolerances(search)) if advise else [],
    }  # fmt: skip
    message = f"the seam can't be followed beyond waypoints[{waypoint}]"
    return stop_failure(reason, message, _hint(reason.reason, details), **details)


def _hint(reason: Reason, details: dict[str, Any]) -> str:
    """Advice with the parts of the seam that can be followed by themselves."""
    hint = HINTS[reason]
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


def explain_path(places: SeamPlaces, path: ToolPath) -> Failure:
    """Failure of a joint path that stops on one of the runs of a seam.

    Args:
        places: Places of the seam.
        path: The path.
    """
    run, segment, stop = path.runs[-1], path.segments[-1], path.stop
    assert stop is not None
    part = run.parts_until(max(segment.reached, 1e-9))[-1]
    done = sum(other.length for other in path.runs[:-1]) + segment.reached * run.length
    waypoint = part.asked + 1
    return stop_failure(
        stop,
        f"the seam can't be followed to waypoints[{waypoint}]",
        waypoint=waypoint,
        fraction=done / places.length,
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
    text = (
        "the joints would have to turn too sharply to keep the tool within its tolerance; the path "
        f"bends most at waypoints[{waypoint}], by {math.degrees(angle):.3g} degrees"
    )
    return stop_failure(
        Stop("deviation", text, {}),
        "the seam can't be followed",
        f"{_BEND_HINT} {_RANGE_HINT}" if ranged else _BEND_HINT,
        waypoint=waypoint,
        bend=angle,
    )


def _first_unreached(graph: SeamGraph) -> int:
    """The first layer that no way from the first layer leads to."""
    last = len(graph.layers) - 1
    return next((layer for layer in range(last) if not graph.reached(layer).size), last)


def _reason(search: SeamSearch, graph: SeamGraph, layer: int) -> Stop:
    """Reason why no way leads to a layer."""
    mine = graph.of_layer(layer)
    reached = graph.nodes.joints[graph.reached(layer - 1)] if layer > 0 else search.start[None]
    if not mine.size:
        return _beyond(search, reached, int(graph.layers[layer]))
    colliding = mine[graph.collided[mine]]
    if np.isfinite(graph.costs[mine]).any():
        met = _met_on_the_way(search, graph, layer)
        if len(met):
            return _collision(search, met, "all ways there collide")
        # Configurations that are checked for being singular: some 60 of them.
        return no_way_on(search.chain, reached[:: max(1, len(reached) // 60)])
    if not colliding.size:
        return Stop("limit", "all configurations there are at a joint limit", {})
    return _collision(search, graph.nodes.joints[colliding], "all configurations collide")


def _met_on_the_way(search: SeamSearch, graph: SeamGraph, layer: int) -> Array:
    """Colliding configurations without which there would be a way to a layer, shape (k, n)."""
    joints, free = graph.nodes.joints, search.without_collisions(graph)
    way, reached = free.cheapest(layer), free.reached(layer)
    if way is None:
        return np.empty((0, joints.shape[1]))
    if graph.collided[reached].any():
        return np.asarray(joints[reached[graph.collided[reached]]])
    hits = [graph.hits[step] for step in pairwise(way) if step in graph.hits]
    return np.array([joints[node] for node in way if graph.collided[node]] + hits)


def _collision(search: SeamSearch, colliding: Array, words: str) -> Stop:
    """The least deep of some collisions, of configurations (k, n)."""
    depth, pair = search.checker.least_overlap(colliding) or (0.0, ("", ""))
    text = f"{words}, at best {pair[0]!r} with {pair[1]!r} by {depth:.4g} m"
    return Stop("collision", text, {"pair": list(pair), "depth": depth})


def _beyond(search: SeamSearch, reached: Array, place: int) -> Stop:
    """Reason why inverse kinematics has nothing at a place that follows configurations (k, n)."""
    chain, q = search.chain, reached.copy()
    lower, upper = chain.limits.lower, chain.limits.upper
    none = np.full((2, chain.n), np.inf) * [[-1.0], [1.0]]
    errors = search.project_at(q, np.full(len(q), place), none)
    q = q[errors.max(axis=1) <= REACHED]
    excess = np.maximum(lower - q, q - upper).max(axis=1)
    if (excess > 0.0).any():
        return at_limit(chain, q[np.argmin(np.where(excess > 0.0, excess, np.inf))])
    # Starts of the search for the nearest pose.
    options = numeric.SearchOptions(starts=60)
    stop, _ = out_of_reach(chain, search.places.nominal[place], options, search.start)
    return stop or Stop("limit", "the closed form has no solution inside the limits there", {})


def least_that(suffices: Callable[[float], bool], most: float, least: float) -> float | None:
    """The least of some sizes that suffices, to a fifth; None where the largest does not.

    Args:
        suffices: Whether a size does; larger ones do if it does.
        most: Largest size.
        least: Least size that is told.
    """
    if not suffices(most):
        return None
    while most > 1.2 * least:
        middle = math.sqrt(most * least)
        most, least = (middle, least) if suffices(middle) else (most, middle)
    # Rounded up, so that it suffices as it is told.
    digits = 2 - math.floor(math.log10(most))
    return math.ceil(most * 10.0**digits) / 10.0**digits


def _helpful_tolerances(search: SeamSearch) -> Iterator[dict[str, Any]]:
    """Wider tolerances with which the seam has a way, the least of each kind, about."""
    # Share of the time that is left which is spent on tolerances that would help.
    # Time that is spent on that at most [s].
    deadline = search.deadline.within(min(0.5 * search.deadline.remaining, 3.0))

    def suffices(columns: slice, size: float) -> bool:
        wide = {t: _widened(t, columns, size) for t in set(search.places.tolerances)}
        if deadline.passed or all(wide[t] is t for t in wide):
            return False
        places = replace(search.places, tolerances=tuple(wide[t] for t in search.places.tolerances))
        return replace(search, places=places, deadline=deadline).run().joints is not None

    # Sizes that are tried: half a turn, 45 degrees and 50 mm to either side at most.
    spin = least_that(partial(suffices, _SPIN), math.pi, 0.05)
    if spin is not None:
        yield {"free": ["rz"]} if spin >= math.pi else {"rz": [-spin, spin]}
    tilt = least_that(partial(suffices, _TILT), math.radians(45.0), 0.02)
    if tilt is not None:
        yield {"tilt": tilt}
    position = least_that(partial(suffices, _POSITION), 0.05, 0.001)
    if position is not None:
        yield {"position": position}


def _widened(tolerance: ToolTolerance, columns: slice, size: float) -> ToolTolerance:
    """The tolerance with ranges of some deviations to a size either way; itself if one is as wide.

    Of half a turn on any angle will do.
    """
    lower, upper = tolerance.lower.copy(), tolerance.upper.copy()
    if not np.abs([lower[columns], upper[columns]]).max() < size:
        return tolerance
    reach = size if size < math.pi else np.inf
    lower[columns], upper[columns] = -reach, reach
    tilt = size if columns == _TILT else tolerance.tilt
    return replace(tolerance, lower=lower, upper=upper, tilt=tilt)
