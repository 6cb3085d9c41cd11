"""Rounds of search and proof: an order by known times, its legs checked and planned, again.

Lower bound of the time of tours, by Lagrangian relaxation of spanning trees.

A tour is a spanning tree of its stops in which the start and the end have one leg, all others
two, and both legs of a stop meet in one configuration. Prices on the configurations replace these
rules: for any prices the cheapest tree is a bound (Held and Karp, The traveling-salesman problem
and minimum spanning trees, 1971; with a price for each configuration in place of each stop).
Order constraints are left out, which only lowers the bound.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from kinematics.forward import forward
from planning.goal_choice.goal_order import (
    MAX_EDGES,
    MAX_LONGER,
    MAX_PLANNED,
    chosen_configuration,
    is_at_limit,
)
from planning.preflight.goals import configurations_off_limits
from planning.result import ChosenConfiguration, Failure
from planning.timing.rest_to_rest import Times
from planning.tours.legs import SAME_TIME, LegTable, Pair
from planning.tours.local_search import (
    Network,
    SearchWork,
    TourState,
    enqueue,
    make_network,
    nearest_neighbour_tour,
    search_kernel,
    search_work,
    set_state,
)
from planning.tours.problem import (
    TourOptions,
    TourProblem,
    goal_pairs,
    group_numbers,
    precedence_table,
)
from planning.tours.result import (
    Leg,
    SearchReport,
    Tour,
    TourImprovement,
    Unvisited,
    Visit,
)
from planning.values.deadline import Deadline


@kernel
def spanning_tree(times: Times, first: Indices, price: Array, ends: Indices, legs: Array) -> float:
    """Length of the least spanning tree with prices on configurations, by Prim's algorithm.

    Args:
        times: Shape (m, m) [s].
        first: First configuration of each stop, and m, shape (s + 1,).
        price: Prices of a leg at each configuration, shape (m,) [s].
        ends: Stops with one leg instead of two, shape (2,).
        legs: Written: legs of the tree at each configuration less those that a tour has at the
            dearest configuration of its stop, shape (m,).

    Returns:
        The bound [s].
    """
    stops = first.shape[0] - 1
    done = np.zeros(stops, dtype=np.bool_)
    nearest = np.full(stops, np.inf)
    here = np.zeros(stops, dtype=np.int64)
    there = np.zeros(stops, dtype=np.int64)
    legs[:] = 0.0
    total = 0.0
    current = 0
    done[0] = True
    for _ in range(stops - 1):
        following = -1
        # Start and end of a tour are never beside each other.
        for stop in range(stops):
            if done[stop]:
                continue
            if (current, stop) == (ends[0], ends[1]) or (stop, current) == (ends[0], ends[1]):
                continue
            for b in range(first[stop], first[stop + 1]):
                for a in range(first[current], first[current + 1]):
                    reduced = times[b, a] + price[a] + price[b]
                    if reduced < nearest[stop]:
                        nearest[stop], here[stop], there[stop] = reduced, b, a
        for stop in range(stops):
            if not done[stop] and (following < 0 or nearest[stop] < nearest[following]):
                following = stop
        total += nearest[following]
        legs[here[following]] += 1.0
        legs[there[following]] += 1.0
        done[following] = True
        current = following
    for stop in range(stops):
        degree = 1.0 if stop in (ends[0], ends[1]) else 2.0
        dearest = first[stop]
        for a in range(first[stop], first[stop + 1]):
            if price[a] > price[dearest]:
                dearest = a
        total -= degree * price[dearest]
        legs[dearest] -= degree
    return total


def lower_bound(
    times: Times, first: Indices, upper: float, deadline: Deadline | None = None
) -> float:
    """A time that no tour of the configurations beats [s].

    Args:
        times: Bounds of the times between configurations, shape (m, m) [s].
        first: First configuration of each stop, and m, shape (s + 1,); the last two stops are the
            start and the end.
        upper: Time of a known tour, which sets the steps [s].
        deadline: Time at which to end with the bound so far, 0 if there is none.
    """
    stops, m = len(first) - 1, len(times)
    ends = np.array([stops - 2, stops - 1])
    price, legs = np.zeros(m), np.zeros(m)
    best, best_price = -np.inf, price
    scale, since = 1.0, 0
    # Lookups of times that all rounds together may take: about a second.
    rounds = int(np.clip(4e8 / m**2, 10, 400))
    for _ in range(rounds):
        if deadline is not None and deadline.passed:
            break
        value = spanning_tree(times, first, price, ends, legs)
        since += 1
        if value > best:
            best, best_price, since = value, price.copy(), 0
        square = float(legs @ legs)
        # Steps end below this part of the gap.
        if square == 0.0 or scale < 1e-3:
            break
        # Rounds without a better bound after which steps are halved.
        if since >= 8:
            scale, since, price = 0.5 * scale, 0, best_price.copy()
            continue
        price = price + scale * max(upper - value, 0.0) / square * legs
    # Single precision rounds every time by less than this part.
    return max(0.0, best - 1e-6 * upper)


#: Shares of the remaining time, at most, for the first order, for checks of its straight motions
#: before any leg is planned, and for the bound.
_ORDER_SHARE, _CHECKS_SHARE, _BOUND_SHARE = 0.15, 0.25, 0.25
#: Searches in one round at most, for straight motions that are blocked, and for legs that took
#: longer than expected.
_MAX_CHECKS, _MAX_REPAIRS = 60, 20


class Stops(NamedTuple):
    """Stops of a tour: goals, then the start and the end.

    Args:
        goals: Numbers of the goals.
        first: First configuration of each stop, and their number, shape (s + 1,).
        alternatives: Number of the alternative each configuration of each goal reaches.
    """

    goals: tuple[int, ...]
    first: Indices
    alternatives: tuple[tuple[int, ...], ...]

    def groups(self, problem: TourProblem) -> Indices:
        """Number of each stop's group, without the two ends."""
        return group_numbers([problem.goals[i].group for i in self.goals])

    def pairs(self, problem: TourProblem) -> list[tuple[int, int]]:
        """Stops of which the first comes before the second."""
        stop = {goal: k for k, goal in enumerate(self.goals)}
        pairs = goal_pairs(problem.names, problem.groups, problem.precedence)
        return [(stop[a], stop[b]) for a, b in pairs if a in stop and b in stop]


class UnreachableGoal(NamedTuple):
    """A goal that no leg was found to.

    Args:
        goal: Number of the stage.
        failure: Why.
    """

    goal: int
    failure: Failure


@dataclass(slots=True, eq=False)
class TourSearch:
    """The search for a tour, round by round.

    Args:
        problem: The tour.
        options: Options of planning.
        stops: Goals that have configurations.
        legs: Legs between these.
        deadline: The end.
        report: Called with progress.
        offer: Called with each proved tour that is the best so far.
        network: Stops and times as the kernels take them.
        state: The tour that is being searched.
        work: Memory of the kernels.
        best: The best proved tour.
        best_time: Time of the best tour, stays not counted [s].
        best_cost: Cost that with what its configurations cost, as seconds.
        improvements: Proved tours that were the shortest so far.
        bound: A time that no tour beats, stays not counted [s]; 0 where none is known.
        replaced: Times of stops whose configuration took the place of one at a joint limit, the
            times of the legs beside that one and beside this [s].
    """

    problem: TourProblem
    options: TourOptions
    stops: Stops
    legs: LegTable
    deadline: Deadline
    report: Callable[[float, str], None]
    offer: Callable[[Tour], None]
    network: Network = field(init=False)
    state: TourState = field(init=False)
    work: SearchWork = field(init=False)
    best: TourState | None = None
    best_time: float = np.inf
    best_cost: float = np.inf
    improvements: list[TourImprovement] = field(default_factory=list)
    bound: float | None = None
    replaced: dict[int, tuple[float, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        pairs = self.stops.pairs(self.problem)
        precedence = precedence_table(pairs, len(self.stops.goals) + 2)
        # Near stops that moves of the search check.
        self.network = make_network(self.legs.times, self.stops.first, precedence, 10)
        groups = self.stops.groups(self.problem)
        self.state = nearest_neighbour_tour(self.network, groups, pairs)
        self.work = search_work(self.network, self.options.planning.seed)

    # ----------------------------------------------------------------------------------- rounds

    def run(self) -> Tour | UnreachableGoal | Failure:
        """Search and prove until the rounds or the time are over, or nothing gets better."""
        everywhere = range(len(self.stops.goals) + 2)
        # Kicks for each goal before the first legs are planned and in each round.
        kicks = 60
        self._improve(everywhere, kicks, self._share(_ORDER_SHARE))
        rounds, since, stopped = 0, 0, "finished"
        # Rounds without a shorter tour after which the search ends.
        patience = 3
        while True:
            since = 0 if self._settle(rounds) else since + 1
            if self.deadline.passed:
                stopped = "deadline"
                break
            unreachable = self._unreachable_goal(given_up=self.best is None and since >= patience)
            if unreachable is not None:
                return unreachable
            if self.best is not None and since >= patience:
                break
            if self.best is not None and rounds >= self.options.rounds:
                stopped = "rounds"
                break
            rounds += 1
            self.report(0.5 + 0.5 * rounds / (rounds + patience), "improve")
            if self.best is not None:
                set_state(self.state, self.best)
            self._improve((), kicks)
        if self.best is None:
            return self._timed_out(rounds)
        set_state(self.state, self.best)
        if avoid_limits(self):
            self._note_improvement(rounds)
        return self._tour(rounds, stopped)

    def _settle(self, round_number: int) -> bool:
        """Plan the legs of the tour and search again until all take as long as expected.

        Returns:
            Whether a proved tour shorter than all before was found.
        """
        shorter = False
        for _ in range(_MAX_REPAIRS):
            until = self.deadline if self.legs.legs else self._share(_CHECKS_SHARE)
            self._check_straight_legs(until)
            changed = self._plan_legs()
            shorter |= self._record(round_number)
            if self.best is not None and self.bound is None:
                self.bound = self._lower_bound(self._share(_BOUND_SHARE))
            if not changed or self.deadline.passed:
                break
            # Kicks for each goal after legs got longer.
            self._improve(changed, 3)
        return shorter

    def _check_straight_legs(self, until: Deadline) -> None:
        """Check straight legs until the tour takes none that is not known."""
        for _ in range(_MAX_CHECKS):
            blocked: list[int] = []
            for before, after in pairwise(self.visited()):
                known = len(self.legs.blocked)
                free = self.legs.check(self.configuration(before), self.configuration(after))
                if not free and len(self.legs.blocked) > known:
                    blocked += [before, after]
            if not blocked or until.passed:
                return
            self._improve(blocked, 0)

    def _plan_legs(self) -> list[int]:
        """Plan the legs of the tour; stops of those that take another time than expected."""
        changed: list[int] = []
        visited = self.visited()
        for k, (before, after) in enumerate(pairwise(visited)):
            if self.deadline.passed:
                break
            a, b = self.configuration(before), self.configuration(after)
            expected = self.legs.time(a, b)
            self.legs.plan(a, b, self.deadline.at_most(self.options.leg_timeout))
            if abs(self.legs.time(a, b) - expected) > SAME_TIME:
                changed += [before, after]
            if self.best is None:
                self.report(0.2 + 0.3 * k / len(visited), "prove")
        return changed

    def _record(self, round_number: int) -> bool:
        """Keep the tour if it is proved and the best so far."""
        legs = [self.legs.legs.get(pair) for pair in self._pairs()]
        if not all(legs) or not self._visits_groups_whole():
            return False
        time = sum(leg.trajectory.duration for leg in legs if leg is not None)
        cost = sum(self.legs.cost(a, b) for a, b in self._pairs()) + self._free_ends()
        if cost >= self.best_cost - SAME_TIME:
            return False
        self.best, self.best_time, self.best_cost = self.state.copy(), time, cost
        self._note_improvement(round_number)
        self.offer(self._tour(round_number, "deadline"))
        return True

    def _note_improvement(self, round_number: int) -> None:
        time = sum(self.legs.legs[pair].trajectory.duration for pair in self._pairs())
        dwell = sum(self.problem.goals[i].dwell for i in self.stops.goals)
        self.improvements.append(TourImprovement(round_number, time + dwell))

    def _free_ends(self) -> float:
        """Costs of the first and last visits beside their legs, where an end is any goal."""
        visited = self.visited()
        ends = [visited[k] for k in (0, -1) if visited[k] < len(self.stops.goals)]
        return 0.5 * sum(float(self.legs.costs.own[self.configuration(stop)]) for stop in ends)

    def _improve(self, stops: Iterable[int], kicks: int, until: Deadline | None = None) -> None:
        """Search on from the tour, at these stops first, until the kicks or the time are over."""
        until = self.deadline if until is None else until
        for stop in stops:
            enqueue(self.work, stop)
        left = kicks * len(self.stops.goals)
        # Kicks between two checks the clock.
        kicks_at_once = 100
        while True:
            search_kernel(self.network, self.state, self.work, min(left, kicks_at_once))
            left -= kicks_at_once
            if left <= 0 or until.passed:
                return

    def _share(self, share: float) -> Deadline:
        """The end of work that may take a share of the remaining time."""
        return self.deadline.within(share * self.deadline.remaining)

    def _lower_bound(self, until: Deadline) -> float:
        least = self.legs.bounds(until)
        if least is None:
            return 0.0
        return lower_bound(least, self.stops.first, self.best_time, until)

    # ------------------------------------------------------------------------- the tour so far

    def visited(self) -> list[int]:
        """Stops in their order, without an end where any will do."""
        real, choice = self.legs.real, self.state.choice
        return [int(stop) for stop in self.state.order if real[choice[stop]]]

    def configuration(self, stop: int) -> int:
        """The configuration of a stop in the tour so far."""
        return int(self.state.choice[stop])

    def _pairs(self) -> list[Pair]:
        """Configurations at the two ends of each leg."""
        return list(pairwise(self.configuration(stop) for stop in self.visited()))

    def _visits_groups_whole(self) -> bool:
        """Whether the goals of each group are visited one after another."""
        groups = self.stops.groups(self.problem)
        order = [int(groups[stop]) for stop in self.visited() if stop < len(groups)]
        return sum(int(a != b) for a, b in pairwise(order)) == len(set(order)) - 1

    # ------------------------------------------------------------------------------- outcomes

    def _unreachable_goal(self, *, given_up: bool) -> UnreachableGoal | None:
        """A goal that no leg leads to, and why; None where there is hope for all."""
        goals = len(self.stops.goals)
        owner = np.searchsorted(self.stops.first, np.arange(len(self.legs.joints)), "right") - 1
        proved = {int(owner[k]) for pair in self.legs.legs for k in pair}
        counts = Counter(int(owner[k]) for pair in self.legs.failures for k in pair)
        for pair, failure in self.legs.failures.items():
            for stop in (int(owner[pair[1]]), int(owner[pair[0]])):
                # Legs to a goal that are planned in vain before it is given up, where none was
                # proved.
                if stop < goals and stop not in proved and counts[stop] >= 3:
                    return UnreachableGoal(self.stops.goals[stop], failure)
        if given_up:
            for pair in self._pairs():
                stops = [int(owner[k]) for k in pair[::-1] if owner[k] < goals]
                if pair in self.legs.failures and stops:
                    return UnreachableGoal(self.stops.goals[stops[0]], self.legs.failures[pair])
        return None

    def _timed_out(self, rounds: int) -> Tour | Failure:
        """The proved beginning of the tour where a partial one will do, else a failure."""
        pairs = self._pairs()
        proved = next((k for k, p in enumerate(pairs) if p not in self.legs.legs), len(pairs))
        if proved > 0 and self.options.allow_partial:
            return self._tour(rounds, "deadline", proved)
        return Failure(
            "TIMED_OUT",
            f"time was up when {proved} of the {len(pairs)} legs of a tour were proved in order",
            "Allow more time, or ask for a partial tour: allow_partial.",
            "search",
            details={"proved_legs": proved, "legs": len(pairs)},
        )

    def _tour(self, rounds: int, stopped: str, proved: int | None = None) -> Tour:
        """The answer: the tour, or the first legs of it."""
        pairs, visited = self._pairs()[:proved], self.visited()
        legs = tuple(self.legs.legs[pair] for pair in pairs)
        shown = visited[: len(legs) + 1]
        visits, time = self._visits(shown, legs)
        late = [stop for stop in visited[len(legs) + 1 :] if stop < len(self.stops.goals)]
        message = "time was up before a motion to it was proved"
        unvisited = [
            Unvisited(i, self.problem.goals[i].id, "TIMED_OUT", message)
            for i in (self.stops.goals[stop] for stop in late)
        ]
        dwell = sum(visit.departure - visit.arrival for visit in visits)
        reaches_end = visited[-1] < len(self.stops.goals) or len(shown) == len(visited)
        whole = reaches_end and not unvisited
        return Tour(
            visits=visits,
            legs=legs,
            unvisited=tuple(unvisited),
            time=time,
            dwell=dwell,
            # A configuration that took the place of one at a limit is none the bound is of.
            lower_bound=min(self.bound + dwell, time) if whole and self.bound else 0.0,
            search=SearchReport(
                configurations=int(self.stops.first[-3]),
                checked=len(self.legs.free) + len(self.legs.blocked),
                blocked=len(self.legs.blocked),
                planned=len(self.legs.legs),
                rounds=rounds,
                improvements=tuple(self.improvements),
                stopped=stopped,
            ),
            deterministic=not self.deadline.interruptions.occurred,
            reaches_end=reaches_end,
        )

    def _visits(self, shown: Sequence[int], legs: Sequence[Leg]) -> tuple[tuple[Visit, ...], float]:
        """The goals with their times, and the time of the whole tour [s]."""
        visits: list[Visit] = []
        clock = 0.0
        for k, stop in enumerate(shown):
            clock += legs[k - 1].trajectory.duration if k > 0 else 0.0
            if stop < len(self.stops.goals):
                index, configuration = self.stops.goals[stop], self.configuration(stop)
                leaves = clock + self.problem.goals[index].dwell
                alternative = self.stops.alternatives[stop][
                    configuration - int(self.stops.first[stop])
                ]
                joints = self.legs.joints[configuration]
                before = self.configuration(shown[k - 1]) if k else None
                report = self._report_configuration(stop, before)
                visits.append(Visit(index, alternative, joints, clock, leaves, report))
                clock = leaves
        return tuple(visits), clock

    def _report_configuration(self, stop: int, before: int | None) -> ChosenConfiguration | None:
        """Costs of a visit's configuration, and why it is not another; None without a pose.

        Args:
            stop: The goal.
            before: The configuration before it; None where the tour begins at it.
        """
        now, costs = self.configuration(stop), self.legs.costs
        if not costs.posed[now]:
            return None
        rows = np.arange(int(self.stops.first[stop]), int(self.stops.first[stop + 1]))
        found, chain = self.legs.joints[rows], self.problem.robot.chain
        begin = found[now - rows[0]] if before is None else self.legs.joints[before]
        times = np.zeros(len(rows))
        if before is not None:
            times = np.array([self.legs.straight_time(begin, q) for q in found])
        return chosen_configuration(
            chain, found, self.legs.joints[now], begin, times, self.legs.clearance(now),
            self.options.planning.goal_costs, self.replaced.get(stop),
        )  # fmt: skip


def avoid_limits(search: "TourSearch") -> bool:
    """Take the configurations away from limits in the tour that was found; whether there were any.

    Args:
        search: Search whose state is the best tour; it is changed, and so is what was replaced.
    """
    costs, any_changed, changed = search.legs.costs, False, True
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
    for k in worth[:MAX_PLANNED]:
        if search.deadline.passed:
            return False
        row, q = others[k]
        ways = [*((legs.joints[a], q) for a in before), *((q, legs.joints[b]) for b in after)]
        until = search.deadline.at_most(search.options.leg_timeout)
        planned = [legs.plan_motion(*way, until, MAX_EDGES) for way in ways]
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
