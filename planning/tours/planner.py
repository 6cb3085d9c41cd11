"""Tours from goals to proved legs: search by straight times, proofs only where the tour goes."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from kinematics.arrays import Array, typed
from obstacles.collision.checker import Checker
from planning.constrained.path_constraints import check_widths, end_violation
from planning.options import with_limits
from planning.preflight.preflight import check_start
from planning.problem import JointGoal, Problem
from planning.result import Failure
from planning.timing.choice import chosen_parametrization
from planning.tours.legs import (
    Configurations,
    LegTable,
    find_configurations,
    least_times,
    visit_costs,
)
from planning.tours.problem import TourOptions, TourProblem, goal_pairs
from planning.tours.result import Tour, Unvisited
from planning.tours.search import Stops, TourSearch
from planning.values.deadline import Deadline

#: Called with the share of the work that is done, and its stage.
Report = Callable[[float, str], None]
#: Called with a proved tour that is the best so far.
Offer = Callable[[Tour], None]
#: Codes of what is wrong at the end of a tour, by those of its start.
_CODES_OF_ENDS: Mapping[str, str] = {
    "START_STATE_IN_COLLISION": "GOAL_IN_COLLISION",
    "START_STATE_VIOLATES_PATH_CONSTRAINTS": "GOAL_VIOLATES_PATH_CONSTRAINTS",
}


@typed
def plan_tour(
    problem: TourProblem,
    options: TourOptions | None = None,
    report: Report = lambda _share, _stage: None,
    offer: Offer = lambda _tour: None,
) -> Tour | Failure:
    """Visit goals in the order that takes the least time, every leg proved.

    The search goes by the times of straight motions, which are exact from rest to rest. Only legs
    that a tour takes are checked and planned; where one takes longer than expected, the order and
    the configurations are searched again.

    Args:
        problem: The robot, the scene, goals and their order.
        options: Planning of the legs, rounds of the search.
        report: Called with the share of the work that is done, and its stage.
        offer: Called with each proved tour that is the best so far.

    Returns:
        The shortest proved tour that was found before the deadline, or why there is none.

    Raises:
        InvalidGoal: A constraint is too thin for a motion.
        InvalidOption: An unknown planner or option.
        MissingLimit: A velocity or acceleration limit is not known.
    """
    planner = _TourPlanner(problem, options or TourOptions(), report, offer)
    answer = planner.run()
    if isinstance(answer, Tour):
        return answer
    details = planner.deadline.interruptions.reported_in(answer.code, answer.details)
    return replace(answer, details=details)


@dataclass(slots=True, eq=False)
class _TourPlanner:
    """One tour on its way from goals to a proof.

    Args:
        problem: The tour.
        options: Options of planning.
        report: Called with progress.
        offer: Called with each proved tour that is the best so far.
        deadline: The end of all stages.
        checker: The exact robot in the scene with its margins.
        unvisited: Goals that are left out.
        notes: Notes on what was done to the request.
    """

    problem: TourProblem
    options: TourOptions
    report: Report
    offer: Offer
    deadline: Deadline = field(init=False)
    checker: Checker = field(init=False)
    unvisited: list[Unvisited] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.deadline = Deadline.after(self.options.planning.timeout)
        self.checker = Checker.of(self.problem.robot, self.problem.scene, self.problem.margin)

    def run(self) -> Tour | Failure:
        """Run the stages in order, to the first failure."""
        if self.problem.constraints is not None:
            check_widths(self.problem.constraints.hard)
        ends = self._ends()
        if isinstance(ends, Failure):
            return ends
        found = self._configurations(ends[0])
        if isinstance(found, Failure):
            return found
        while found:
            tables = self._tables(found, ends)
            if isinstance(tables, Failure):
                return tables
            stops, legs = tables
            search = TourSearch(
                self.problem, self.options, stops, legs, self.deadline, self.report,
                lambda tour: self.offer(self._with_left_out(tour)),
            )  # fmt: skip
            tour = search.run()
            if isinstance(tour, Failure):
                return tour
            if isinstance(tour, Tour):
                return self._with_left_out(tour)
            goal = self.problem.goals[tour.goal]
            failure = tour.failure
            message = f"no motion to it was found: {failure.message}"
            self.unvisited.append(
                Unvisited(tour.goal, goal.id, failure.code, message, failure.details)
            )
            if not self.options.allow_partial:
                break
            del found[tour.goal]
            self._leave_out_followers(found)
        return _out_of_reach(self.unvisited, len(self.problem.goals))

    def _with_left_out(self, tour: Tour) -> Tour:
        """A tour with what the search does not know: goals left out before it, and notes."""
        unvisited = sorted([*self.unvisited, *tour.unvisited], key=lambda one: one.index)
        notes = self.notes if tour.reaches_end else [*self.notes, _end_note(self.problem, tour)]
        return replace(tour, unvisited=tuple(unvisited), notes=tuple(notes))

    # ----------------------------------------------------------------------------- the two ends

    def _ends(self) -> tuple[Array | None, Array | None] | Failure:
        """Configurations at the start and at the end of the tour, None where any will do."""
        problem = self.problem
        start: Array | None = None
        if problem.start is not None:
            valid = self._valid(problem.start)
            if isinstance(valid, Failure):
                return valid
            start = valid
        if isinstance(problem.end, str):
            return start, start if problem.end == "start" else None
        end = self._valid(problem.end)
        if isinstance(end, Failure):
            message = end.message.replace("the start", "the end of the tour")
            code = _CODES_OF_ENDS.get(end.code, "GOAL_STATE_INVALID")
            return replace(end, code=code, message=message, stage="end")
        return start, end

    def _valid(self, q: Array) -> Array | Failure:
        single = Problem(
            self.problem.robot, self.problem.scene, q, (JointGoal(q),), self.problem.margin,
            self.problem.start_state_tolerance,
        )  # fmt: skip
        valid = check_start(single)
        if isinstance(valid, Failure):
            return valid
        violation = end_violation(self.problem.constraints, "start", valid.joints)
        if violation is not None:
            return violation
        self.notes += [note for note in valid.notes if note not in self.notes]
        return valid.joints

    # --------------------------------------------------------------------------- configurations

    def _configurations(self, start: Array | None) -> dict[int, Configurations] | Failure:
        """Free configurations of the goals that have any, by number."""
        goals = self.problem.goals
        low, high = self.problem.robot.chain.sampling_bounds()
        near: Array = 0.5 * (low + high) if start is None else start
        found: dict[int, Configurations] = {}
        for i, goal in enumerate(goals):
            if self.deadline.passed:
                return Failure(
                    "TIMED_OUT",
                    f"time was up when configurations of {i} of {len(goals)} goals were known",
                    "Allow more time.",
                    "configurations",
                )
            answer = find_configurations(
                self.problem, goal, self.checker, near, self.options.planning.seed, self.deadline
            )
            if isinstance(answer, Failure):
                self.unvisited.append(
                    Unvisited(i, goal.id, answer.code, answer.message, answer.details)
                )
            else:
                found[i] = answer
            # Share of the work that is finding configurations.
            self.report(0.2 * (i + 1) / len(goals), "configurations")
        if self.unvisited and not self.options.allow_partial:
            return _out_of_reach(self.unvisited, len(goals))
        self._leave_out_followers(found)
        return found

    def _leave_out_followers(self, found: dict[int, Configurations]) -> None:
        """Leave out goals that come after one that is left out: what they wait for never comes."""
        problem = self.problem
        pairs = goal_pairs(problem.names, problem.groups, problem.precedence)
        waiting = [one.index for one in self.unvisited]
        while waiting:
            missing = waiting.pop()
            for before, after in pairs:
                if before == missing and after in found:
                    del found[after]
                    self.unvisited.append(follower_left_out(problem, before, after))
                    waiting.append(after)

    # ----------------------------------------------------------------------------------- tables

    def _tables(
        self, found: dict[int, Configurations], ends: Sequence[Array | None]
    ) -> tuple[Stops, LegTable] | Failure:
        """Stops and the legs between them; a failure where time is up before."""
        n = self.problem.robot.chain.n
        goals = tuple(found)
        parts = list(found.values())
        for q in ends:
            row = np.zeros((1, n)) if q is None else q[None, :]
            parts.append(Configurations(row, (0,), np.zeros(1), np.zeros(1, np.bool_)))
        counts = [len(part.joints) for part in parts]
        first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        joints = np.ascontiguousarray(np.vstack([part.joints for part in parts]))
        real = np.ones(len(joints))
        real[-2:] = [q is not None for q in ends]
        stops = Stops(goals, first, tuple(found[i].alternatives for i in goals))
        groups = np.concatenate([stops.groups(self.problem), [-1, -2]])
        planning = with_limits(self.options.planning, self.problem.constraints)
        chain = self.problem.robot.chain
        parametrization = chosen_parametrization(
            planning.timing, chain.joint_names, chain.limits, planning.limits, chain
        )
        times = least_times(parametrization, joints, real, self.deadline, straight=True)
        if times is None:
            return Failure(
                "TIMED_OUT",
                f"time was up before the times between {len(joints)} configurations were known",
                "Allow more time, or fewer samples of free axes.",
                "search",
            )
        legs = LegTable(
            self.problem, planning, parametrization, self.checker, joints,
            np.repeat(groups, counts), real,
            any(goal.group is not None for goal in self.problem.goals), times,
            visit_costs(chain, planning.goal_costs, parts),
        )  # fmt: skip
        return stops, legs


def _end_note(problem: TourProblem, tour: Tour) -> str:
    end = "back to the start" if isinstance(problem.end, str) else "to its end"
    last = problem.goals[tour.visits[-1].index].id
    return f"Time was up before a motion {end} was proved: the tour ends at {last!r}."


def follower_left_out(problem: TourProblem, before: int, after: int) -> Unvisited:
    """The report of a goal whose predecessor is left out."""
    first, second = problem.goals[before].id, problem.goals[after].id
    message = f"goal {second!r} comes after {first!r}, which is left out"
    return Unvisited(after, second, "PREDECESSOR_LEFT_OUT", message, {"predecessor": first})


def _out_of_reach(unvisited: Sequence[Unvisited], count: int) -> Failure:
    """The failure of goals that can't be visited, each with its number and reason."""
    first = unvisited[0]
    return Failure(
        code=first.code,
        message=f"{len(unvisited)} of {count} goals can't be visited; the first, "
        f"goals[{first.index}] ({first.id!r}): {first.message}",
        hint="Move or remove these goals, or ask for a tour without them: allow_partial.",
        stage="configurations",
        details={
            **first.details,
            "unvisited": [
                {"index": one.index, "id": one.id, "code": one.code, "message": one.message}
                for one in unvisited
            ],
        },
    )
