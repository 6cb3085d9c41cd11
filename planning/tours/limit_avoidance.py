"""Visits at a joint limit, led to other configurations where that makes their legs little longer.

The search counts legs of such visits as a fifth longer, by the times that it knows. Where the best
tour visits a pose at a limit all the same, the other configurations of that goal are planned to:
the visits before and after stay as they are, and the first configuration with which the two legs
take at most 1.2 times as long takes its place.
"""

from typing import TYPE_CHECKING

import numpy as np

from kinematics.arrays import Array
from kinematics.forward import forward
from planning.goal_choice.goal_order import MAX_LONGER, is_at_limit
from planning.preflight.goals import configurations_off_limits
from planning.result import Failure

if TYPE_CHECKING:
    from planning.tours.search import TourSearch

#: Configurations at most that legs are planned to in place of one at a limit.
_MAX_PLANNED = 6
#: Edges that the search for a leg to another configuration may look at.
_MAX_EDGES = 2000


def lead_off_limits(search: "TourSearch") -> bool:
    """Take the configurations away from limits in the tour that was found; whether there were any.

    Args:
        search: Its state is the best tour; it is changed, and so is what was replaced.
    """
    costs, any_changed, changed = search.legs.costs, False, True
    if costs is None:
        return False
    # Each replacement leaves one visit fewer at a limit: this ends.
    while changed and not search.deadline.passed:
        stops = [k for k in search.visited() if costs.at_limit[search.configuration(k)]]
        changed = sum(_replace(search, stop) for stop in stops) > 0
        any_changed |= changed
    return any_changed


def _replace(search: "TourSearch", stop: int) -> bool:
    legs, visited = search.legs, search.visited()
    place, now = visited.index(stop), search.configuration(stop)
    before = [search.configuration(k) for k in visited[max(place - 1, 0) : place]]
    after = [search.configuration(k) for k in visited[place + 1 : place + 2]]
    around = [legs.joints[k] for k in (*before, *after)]
    pairs = [*((a, now) for a in before), *((now, b) for b in after)]
    took = sum(legs.legs[pair].trajectory.duration for pair in pairs)
    others = _others(search, stop, around)
    times = [sum(legs.straight_time(q, end) for end in around) for _, q in others]
    worth = [k for k in np.argsort(times, kind="stable") if times[k] <= MAX_LONGER * took]
    for k in worth[:_MAX_PLANNED]:
        if search.deadline.passed:
            return False
        row, q = others[k]
        ways = [*((legs.joints[a], q) for a in before), *((q, legs.joints[b]) for b in after)]
        until = search.deadline.at_most(search.options.leg_timeout)
        planned = [legs.plan_motion(*way, until, _MAX_EDGES) for way in ways]
        found = [leg for leg in planned if not isinstance(leg, Failure)]
        takes = sum(leg.trajectory.duration for leg in found)
        if len(found) == len(planned) and takes <= MAX_LONGER * took:
            legs.replace_configuration(row, q)
            search.state.choice[stop] = row
            pairs = [*((a, row) for a in before), *((row, b) for b in after)]
            for pair, leg in zip(pairs, found, strict=True):
                legs.note(pair, leg)
            search.replaced[stop] = (took, takes)
            return True
    return False


def _others(search: "TourSearch", stop: int, around: list[Array]) -> list[tuple[int, Array]]:
    """Configurations of a stop away from limits, each with the row of the table to put it into.

    Those in the table, and those that plans from the visits beside it would find at this pose.
    """
    legs, now = search.legs, search.configuration(stop)
    first, chain = search.stops.first, search.problem.robot.chain
    rows = np.arange(int(first[stop]), int(first[stop + 1]))
    inside = rows[~is_at_limit(chain, legs.joints[rows])]
    planning, T = search.options.planning, forward(chain, legs.joints[now])
    more = [
        q
        for end in around
        for q in configurations_off_limits(
            chain, legs.checker, T, end, planning.seed, planning.goal_costs
        )
    ]
    return [*((int(k), legs.joints[k].copy()) for k in inside), *((now, q) for q in more)]
