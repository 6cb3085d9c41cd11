"""The search for a path: planners in turn, shortcuts, and the distance from what is passed."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

from kinematics.arrays import Array
from obstacles.checker import Checker
from planning.clearance import clearance_levels, highest_level
from planning.constrained.checker import ConstrainedChecker
from planning.constrained.projected_rrt import Manifold, shortcut_along
from planning.constrained.relaxation import Relaxation, find_relaxation
from planning.deadline import Deadline
from planning.diagnosis import Diagnosis, diagnose
from planning.options import Options
from planning.planner import Planner, Query
from planning.planners import CASCADE
from planning.problem import Problem
from planning.ready import Ready
from planning.result import Attempt, Failure
from planning.search.clearance import keep_clear
from planning.search.quickening import quicken
from planning.search.shortcut import shortcut, shortcut_unproved
from planning.search.straight_line import StraightLine
from planning.stages import Stages

#: Share of the time that is kept back for shortening, timing and the proof.
_RESERVED_SHARE = 0.2
#: Time that is kept back for them at most [s].
_MAX_RESERVED = 1.0
#: Time that is spent on finding out why there is no path, at most [s].
_MAX_DIAGNOSIS = 1.0
#: Share of the time for a path of the robot in its solids' hulls, before the exact one is tried.
_HULLS_SHARE = 0.4
#: Share of the time for a path that keeps the preferred clearance all along.
_PREFERRED_SHARE = 0.4
#: Edges that the cascade's trees may look at for a path to the best goals, before all are tried.
_MAX_EDGES_TO_BEST = 2000
#: Edges that the cascade's trees may look at for such a path.
_MAX_PREFERRED_EDGES = 1000


class FoundPath(NamedTuple):
    """A path: the planner that found it, its attempt, and the checker that proved it free.

    ``levels`` are checkers of falling clearance, the last of which proves every path.
    """

    planner: str
    attempt: Attempt
    checker: Checker
    waypoints: Array
    levels: tuple[Checker, ...]


@dataclass(frozen=True, slots=True, eq=False)
class PathSearch:
    """The search for the path of one problem.

    Args:
        problem: What is to be planned.
        options: Planner, timeout, seed and preferred clearance.
        planners: Tried in turn.
        stages: Reports of the stages.
        deadline: The end of all stages.
        limits: Of velocity, acceleration and jerk, as ``estimate_limits`` has them, shape (3, n).
    """

    problem: Problem
    options: Options
    planners: tuple[Planner, ...]
    stages: Stages
    deadline: Deadline
    limits: Array

    def find(self, ready: Ready) -> FoundPath | Failure:
        """Find a path and shorten it, proved in every place.

        One that keeps the preferred clearance where it is looked at is shortened first and proved
        then: few of its legs are left. Where that proof fails, all is done once more with a proof
        of what the planners find.
        """
        found = self._find(ready, proves=False)
        if isinstance(found, Failure):
            return found
        short = self._shorten(found)
        if short is not None:
            return short
        found = self._find(ready, proves=True)
        return found if isinstance(found, Failure) else self._shorten(found) or found

    def _find(self, ready: Ready, *, proves: bool) -> FoundPath | Failure:
        """Let the planners try in turn; with the robot in its solids' hulls first, if it can be."""
        reserved = min(_RESERVED_SHARE * self.options.timeout, _MAX_RESERVED)
        deadline = Deadline(self.deadline.at - reserved, self.deadline.interruptions)
        best, chooses = ready, False
        if self.planners is CASCADE and ready.best is not None and ready.best < len(ready.goals):
            best, chooses = replace(ready, goals=ready.goals[: ready.best], best=None), True
        for checker in ready.checkers:
            levels = clearance_levels(checker, self.options.clearance)
            until = deadline.within(_PREFERRED_SHARE * deadline.remaining)
            spacious = self._spacious_query(best, levels, until, proves=proves)
            if spacious is not None:
                found, attempt = self._ask_planners(self.planners, spacious, levels)
                if found is not None:
                    return found
            if chooses:
                query = self._query(best, checker, until, _MAX_EDGES_TO_BEST)
                found, attempt = self._ask_planners(self.planners, query, levels)
                if found is not None:
                    return found
            share = 1.0 if checker is ready.checkers[-1] else _HULLS_SHARE
            until = deadline.within(share * deadline.remaining)
            query = self._query(ready, checker, until)
            found, attempt = self._ask_planners(self.planners, query, levels)
            if found is not None:
                return found
        if attempt.failure is not None:
            return attempt.failure
        failure = self._no_path(attempt, deadline)
        if self.options.max_edges is not None:
            return failure
        diagnosis = self.stages.run(
            "diagnosis", partial(self._diagnose, ready), lambda answer: (True, answer.sentence)
        )
        return replace(failure, details={**failure.details, **diagnosis.details})

    def _spacious_query(
        self, ready: Ready, levels: tuple[Checker, ...], until: Deadline, *, proves: bool
    ) -> Query | None:
        """The cascade's short search for a path that keeps the clearance that its ends have."""
        checker = levels[-1]
        is_later = checker is not ready.checkers[0]
        if self.planners is not CASCADE or is_later or isinstance(checker, ConstrainedChecker):
            return None
        highest = highest_level(levels, ready.start, ready.goals)
        if highest is None:
            return None
        level, goals = highest
        if len(goals) < len(ready.goals):
            ready = replace(ready, goals=goals)
        proves = proves or self.options.explored is not None
        return self._query(ready, level, until, _MAX_PREFERRED_EDGES, proves=proves)

    def _query(
        self,
        ready: Ready,
        checker: Checker,
        until: Deadline,
        max_edges: int | None = None,
        *,
        proves: bool = True,
    ) -> Query:
        options = self.options
        return Query(
            self.problem, ready, checker, options.seed, until, max_edges, options.max_edges,
            options.explored, proves,
        )  # fmt: skip

    def _ask_planners(
        self, planners: Sequence[Planner], query: Query, levels: tuple[Checker, ...]
    ) -> tuple[FoundPath | None, Attempt]:
        """The first path that a planner finds, if one does, and the last attempt."""
        for planner in planners:
            attempt = self.stages.run(planner.name, partial(planner.plan, query), _describe_attempt)
            if attempt.waypoints is not None:
                path = attempt.waypoints
                return FoundPath(planner.name, attempt, query.checker, path, levels), attempt
        return None, attempt

    def _no_path(self, attempt: Attempt, deadline: Deadline) -> Failure:
        last = self.stages.reports[-1]
        if deadline.passed:
            return Failure(
                code="TIMED_OUT",
                message=f"no path was found within the timeout of {self.options.timeout:g} s",
                hint="Allow more time, another seed, or a smaller margin.",
                stage=last.name,
                details=attempt.details,
            )
        known = None if attempt.explain is None else attempt.explain()
        return Failure(
            code="PLANNING_FAILED",
            message=f"{last.name} found no path: {last.detail}",
            hint='Ask for planner "auto", or move the start, the goal or the obstacles.'
            if known is None
            else known.hint,
            stage=last.name,
            details={**attempt.details, **({} if known is None else known.details)},
        )

    def _diagnose(self, ready: Ready) -> Diagnosis | Relaxation:
        """Diagnosis of a failed search, within the time reserved for it."""
        problem, seed = self.problem, self.options.seed
        until = self.deadline.at_most(_MAX_DIAGNOSIS)
        exact = ready.checkers[-1]
        if isinstance(exact, ConstrainedChecker):
            return find_relaxation(exact, ready.start, ready.goals, seed, until)
        return diagnose(
            problem.robot,
            problem.scene,
            exact,
            ready.start,
            ready.goals,
            until,
            margin=problem.margin,
            seed=seed,
        )

    def _shorten(self, found: FoundPath) -> FoundPath | None:
        """The path with fewer waypoints, None where it can't be proved.

        A tool path, or one to be kept, stays as it is.
        """
        if found.attempt.tool_path is not None or found.attempt.keep_path:
            return found._replace(levels=found.levels[-1:])
        if len(found.waypoints) > 2 or not found.attempt.proved:
            found = self._replace_path(found, "shortcut", self._shortcut)
            if len(found.waypoints) == 0:
                return None
        is_kept = found.checker is found.levels[0] and len(found.waypoints) == 2
        is_straight = found.planner == self.options.planner == StraightLine.name
        is_held = isinstance(found.checker, ConstrainedChecker)
        if is_kept or is_straight or is_held or len(found.levels) == 1:
            return found
        return self._replace_path(found, "clearance", self._keep_clear)

    def _replace_path(
        self, found: FoundPath, stage: str, change: Callable[[FoundPath], Array]
    ) -> FoundPath:
        count = len(found.waypoints)

        def describe(path: Array) -> tuple[bool, str]:
            if len(path) == 0:
                return False, "What was looked at could not be proved."
            return True, f"{count} waypoints became {len(path)}."

        path = self.stages.run(stage, partial(change, found), describe)
        return found._replace(waypoints=path)

    def _shortcut(self, found: FoundPath) -> Array:
        checker, waypoints = found.checker, found.waypoints
        if isinstance(checker, ConstrainedChecker):
            return shortcut_along(Manifold(checker), waypoints, self.options.seed, self.deadline)
        if not found.attempt.proved:
            return shortcut_unproved(checker, waypoints, self.deadline, found.levels[-1])
        return shortcut(checker, waypoints, self.deadline, found.levels[-1])

    def _keep_clear(self, found: FoundPath) -> Array:
        reached = found.levels.index(found.checker)
        path = keep_clear(found.levels, found.waypoints, self.deadline, reached)
        # What is optimised afterwards is made quicker there.
        if self.deadline.passed or self.options.refine is not None:
            return path
        return quicken(found.levels, path, self.limits, spacious=reached == 0)


def _describe_attempt(attempt: Attempt) -> tuple[bool, str]:
    return attempt.waypoints is not None and attempt.stopped is None, attempt.detail
