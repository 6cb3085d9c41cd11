"""The search for a path: planners in turn, shortcuts, and the distance from what is passed.

Planners by name, and the cascade that plans where none is named.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from obstacles.collision.checker import Checker
from planning.clearance.levels import (
    MANY_EDGES,
    ClearanceTrial,
    clearance_levels,
    clearance_trials,
    leg_states,
)
from planning.clearance.moving_away import join_ends, keep_clear, retreat
from planning.clearance.time_shortcut import quicken
from planning.constrained.checker import ConstrainedChecker
from planning.constrained.path_constraints import Relaxation, find_relaxation
from planning.constrained.projected_rrt import Manifold, ProjectedRrt, shortest_along
from planning.field.options import FieldOptions
from planning.field.planner import PotentialField
from planning.options import Options
from planning.pipeline.diagnosis import Diagnosis, diagnose
from planning.planner import Planner, Query, Ready
from planning.problem import Problem
from planning.result import Attempt, Failure, Stages
from planning.sampling.planners import PLANNERS as OMPL_PLANNERS
from planning.sampling.search import OmplPlanner
from planning.search.rrt_connect import RrtConnect, StraightLine
from planning.search.shortcut import path_is_free, shortcut
from planning.tool_paths.planner import Cartesian
from planning.values.deadline import Deadline
from planning.values.joint_barrier import JointBarrier, joint_barrier
from planning.values.optimize_options import OPTIMIZE


@dataclass(frozen=True, slots=True)
class ByConstraints:
    """Two planners of one name, one of them for paths under constraints.

    Args:
        free: Plans where no constraint holds along the path.
        constrained: Plans where one does.
    """

    free: Planner
    constrained: Planner

    @property
    def name(self) -> str:
        """Name of the first planner."""
        return self.free.name

    @property
    def needs_goals(self) -> bool:
        """Whether one of them needs goal configurations."""
        return self.free.needs_goals or self.constrained.needs_goals

    def plan(self, query: Query) -> Attempt:
        """Search with the planner that suits the checker."""
        constrained = isinstance(query.checker, ConstrainedChecker)
        return (self.constrained if constrained else self.free).plan(query)


#: Planners tried in turn where none is named.
CASCADE: tuple[Planner, ...] = (
    StraightLine(),
    ByConstraints(
        RrtConnect(fallback=OmplPlanner.of("rrt_connect", {})), ProjectedRrt("rrt_connect")
    ),
)


def choose_fallback(options: Options) -> tuple[Planner, ...]:
    """Return the planner of OMPL's that a potential field falls back on; none of other planners.

    Args:
        options: The planner's name and its options.

    Raises:
        InvalidOption: OMPL has no planner of that name, or an option is wrong.
    """
    if options.planner != "potential_field":
        return ()
    name = FieldOptions.of(options.planner_options).fallback
    if name is None:
        return ()
    if name not in OMPL_PLANNERS:
        raise InvalidOption(
            f"planner_options.fallback: OMPL has no planner {name!r}",
            hint=f"Choose one of: {', '.join(OMPL_PLANNERS)}; or null for none.",
            planners=list(OMPL_PLANNERS),
        )
    return (_ompl_planner(name, {}),)


def with_reserve(planners: tuple[Planner, ...]) -> tuple[Planner, ...]:
    """Planners that lead the tool, with more of its tolerance left to the proof; none of others."""
    # Part of the tolerance that the second search uses: proofs miss by a few percent.
    return tuple(replace(one, share=0.6) for one in planners if isinstance(one, Cartesian))


def _ompl_planner(name: str, options: Mapping[str, Any]) -> Planner:
    """One of OMPL's planners; RRT-Connect has a projected one for paths under constraints."""
    planner = OmplPlanner.of(name, options)
    return ByConstraints(planner, ProjectedRrt(name)) if name == "rrt_connect" else planner


#: Names of all planners.
PLANNERS = ("auto", "straight_line", "potential_field", "cartesian", OPTIMIZE, *OMPL_PLANNERS)


def choose_planners(problem: Problem, options: Options) -> tuple[Planner, ...]:
    """Return the planners to be tried in turn, with their options checked.

    Args:
        problem: What is to be planned.
        options: The planner's name and its options.

    Raises:
        InvalidOption: There is no such planner or option, or a value is out of its range.
        InvalidGoal: The planner does not take goals like those of the problem.
    """
    name = options.planner
    if name not in PLANNERS:
        raise InvalidOption(
            f"there is no planner {name!r}",
            hint=f"Choose one of: {', '.join(PLANNERS)}.",
            planners=list(PLANNERS),
        )
    if name in OMPL_PLANNERS:
        return (_ompl_planner(name, options.planner_options),)
    if name == "potential_field":
        return (PotentialField(FieldOptions.of(options.planner_options)),)
    if options.planner_options:
        raise InvalidOption(
            f"planner {name!r} has no options",
            hint="Name the planner that planner_options are for.",
        )
    if name == "cartesian":
        return (Cartesian.of(problem, options),)
    return (StraightLine(),) if name == "straight_line" else CASCADE


#: Share of the time that is left for shortening, timing and the proof.
_RESERVED_SHARE = 0.2
#: Time that these, or the diagnosis of a failure, may take of a long timeout [s].
_MAX_RESERVED = 1.0
#: Share of the time that is left where nothing was found by then, and one more search is made.
_LAST_SHARE = 0.05
#: Share of the time for searches that ask for more than is needed: the preferred clearance, or a
#: path of the robot in its solids' hulls.
_DEMANDING_SHARE = 0.4


class FoundPath(NamedTuple):
    """A path: the planner that found it, its attempt, and the checker that it was found with.

    Args:
        planner: Its name.
        attempt: What it answered; whether its path is proved free.
        checker: One of the levels, the highest that the path keeps.
        waypoints: Shape (k, n).
        levels: Checkers of falling clearance, the last of which proves paths and motions.
        motion_levels: Take their place for the motion, where it has others.
        ends: Of a path between retreats.
    """

    planner: str
    attempt: Attempt
    checker: Checker
    waypoints: Array
    levels: tuple[Checker, ...]
    motion_levels: tuple[Checker, ...] | None = None
    ends: "Ends | None" = None


class Ends(NamedTuple):
    """Ends of a path that is planned between retreats from them.

    Args:
        start: Shape (n,).
        goals: Configurations (n,).
        retreats: From each of the goals, (n,).
        least: Proves the legs to the ends.
    """

    start: Array
    goals: list[Array]
    retreats: list[Array]
    least: Checker


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
        diagnoses: Whether a search that finds nothing is followed by a diagnosis.
    """

    problem: Problem
    options: Options
    planners: tuple[Planner, ...]
    stages: Stages
    deadline: Deadline
    limits: Array
    diagnoses: bool = True

    def find(self, ready: Ready) -> FoundPath | Failure:
        """Find a path and shorten it, proved in every place.

        One that keeps the preferred clearance where it is looked at is changed first and proved
        then: few of its legs are left. Where that proof fails, all is done once more with a proof
        of what the planners find.
        """
        found = self._find(ready, proves=False)
        if isinstance(found, Failure):
            return found
        short = self._shorten(found)
        if found.attempt.proved or self._is_proved(short):
            return short
        found = self._find(ready, proves=True)
        return found if isinstance(found, Failure) else self._shorten(found)

    def _is_proved(self, found: FoundPath) -> bool:
        """Prove the legs of a path that was only looked at, as a stage of its own."""
        checker, path = found.levels[-1], found.waypoints
        return self.stages.run(
            "path_proof",
            partial(path_is_free, checker, path),
            lambda free: _describe_proof(path, free=free),
        )

    def _find(self, ready: Ready, *, proves: bool) -> FoundPath | Failure:
        """Search under ever weaker conditions: the first path is the answer.

        Where no planner is named, the conditions are: the preferred clearance all along, or between
        retreats from ends that are too near; what is needed, to the best goals. Then every planner
        searches for a path to any goal. All of this is done with the robot in its solids' hulls
        first, if it can be.
        """
        reserved = min(_RESERVED_SHARE * self.options.timeout, _MAX_RESERVED)
        deadline = Deadline(self.deadline.at - reserved, self.deadline.interruptions)
        proves = proves or self.options.explored is not None
        best = self._best_goals(ready)
        for checker in ready.checkers:
            levels = clearance_levels(checker, self.options.clearance)
            until = deadline.within(_DEMANDING_SHARE * deadline.remaining)
            found = None
            if checker is ready.checkers[0] and self._prefers_clearance(levels):
                found = self._find_clear(best, levels, until, proves=proves)
            if found is None and best is not ready:
                query = self._query(best, checker, until, MANY_EDGES)
                found, attempt = self._ask_planners(query, levels)
            if found is None:
                share = 1.0 if checker is ready.checkers[-1] else _DEMANDING_SHARE
                last = deadline.within(share * deadline.remaining)
                found, attempt = self._ask_planners(self._query(ready, checker, last), levels)
            if found is not None:
                return found
        if attempt.failure is not None:
            return attempt.failure
        return self._explain(ready, self._no_path(attempt, deadline))

    def _best_goals(self, ready: Ready) -> Ready:
        """The goals that are about as good as the first, for the cascade; else all."""
        if self.planners is not CASCADE or ready.best is None or ready.best == len(ready.goals):
            return ready
        return replace(ready, goals=ready.goals[: ready.best], best=None)

    def _explain(self, ready: Ready, failure: Failure) -> FoundPath | Failure:
        """The failure with its cause, or a path that is found in the time left after that."""
        if self.options.max_edges is not None or not self.diagnoses:
            return failure
        barrier = self._barrier(ready)
        if barrier is not None:
            failure = _beyond(barrier, failure)
        diagnosis = self.stages.run(
            "diagnosis", partial(self._diagnose, ready), lambda answer: (True, answer.sentence)
        )
        if barrier is None and failure.code == "TIMED_OUT":
            found = self._find_in_what_is_left(ready)
            if found is not None:
                return found
        return replace(failure, details={**failure.details, **diagnosis.details})

    def _find_in_what_is_left(self, ready: Ready) -> FoundPath | None:
        """A path that a search with another seed finds, in time that the diagnosis did not need."""
        reserved = _LAST_SHARE * self.options.timeout
        until = Deadline(self.deadline.at - reserved, self.deadline.interruptions)
        if until.passed:
            return None
        checker = ready.checkers[-1]
        query = replace(self._query(ready, checker, until), seed=self.options.seed + 1)
        levels = clearance_levels(checker, self.options.clearance)
        return self._ask_planners(query, levels)[0]

    def _prefers_clearance(self, levels: tuple[Checker, ...]) -> bool:
        """Whether the cascade searches for a path that keeps the preferred clearance."""
        is_constrained = isinstance(levels[-1], ConstrainedChecker)
        return self.planners is CASCADE and not is_constrained and len(levels) > 1

    def _find_clear(
        self, ready: Ready, levels: tuple[Checker, ...], until: Deadline, *, proves: bool
    ) -> FoundPath | None:
        """The first path that keeps a clearance."""
        trials = clearance_trials(levels, ready.start, ready.goals[0])
        for trial in trials:
            path = self._try_clearance(ready, levels, trial, until, proves=proves)
            if path is not None:
                return path
        return None

    def _try_clearance(
        self,
        ready: Ready,
        levels: tuple[Checker, ...],
        trial: ClearanceTrial,
        until: Deadline,
        *,
        proves: bool,
    ) -> FoundPath | None:
        """A path that keeps the preferred clearance all along, or between retreats from its ends.

        Where both ends keep it, all of the path and of its motion is held to it.
        """
        level, least = trial.level, levels[-1]
        start = retreat(level.planned, least, ready.start)
        if start is None:
            return None
        kept, ends, retreats = list[Array](), list[Array](), start is not ready.start
        for goal in ready.goals:
            end = retreat(level.planned, least, goal)
            if end is not None:
                kept.append(goal)
                ends.append(end)
                retreats = retreats or end is not goal
        if not kept:
            return None
        among = Ready(start, ends, ready.checkers, ready.notes, ready.best)
        query = self._query(among, level.planned, until, trial.max_edges, proves=proves)
        found, _ = self._ask_planners(query, (level.planned, level.kept))
        if found is None:
            return None
        if not retreats:
            return found._replace(motion_levels=(level.kept, level.preferred, level.preferred))
        lower = (level.kept, *levels[1:])
        return found._replace(motion_levels=lower, ends=Ends(ready.start, kept, ends, least))

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
            self.problem, ready, checker, options.seed, until, self.limits, max_edges,
            options.max_edges, options.explored, proves,
        )  # fmt: skip

    def _ask_planners(
        self, query: Query, levels: tuple[Checker, ...]
    ) -> tuple[FoundPath | None, Attempt]:
        """The first path that a planner finds, if one does, and the last attempt."""
        for planner in self.planners:
            name = planner.name
            attempt = self.stages.run(name, partial(planner.plan, query), _describe_attempt)
            if attempt.waypoints is not None:
                path = attempt.waypoints
                return FoundPath(name, attempt, query.checker, path, levels), attempt
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

    def _barrier(self, ready: Ready) -> JointBarrier | None:
        """A value of a joint that nothing passes, where the goals lie beyond one."""
        exact = ready.checkers[-1]
        if isinstance(exact, ConstrainedChecker):
            return None
        until = self.deadline.at_most(_MAX_RESERVED)
        return joint_barrier(exact, ready.start, ready.goals, self.options.seed, until)

    def _diagnose(self, ready: Ready) -> Diagnosis | Relaxation:
        """Diagnosis of a failed search, within the time reserved for it."""
        seed, exact = self.options.seed, ready.checkers[-1]
        until = self.deadline.at_most(_MAX_RESERVED)
        if isinstance(exact, ConstrainedChecker):
            return find_relaxation(exact, ready.start, ready.goals, seed, until)
        return diagnose(self.problem, exact, ready, until, seed)

    def _shorten(self, found: FoundPath) -> FoundPath:
        """The path with fewer waypoints. A tool path, or one to be kept, stays as it is."""
        if found.attempt.tool_path is not None or found.attempt.keep_path:
            return found._replace(levels=found.levels[-1:])
        if len(found.waypoints) > 2:
            found = self._replace_path(found, "shortcut", self._shortcut)
        is_kept = found.checker is found.levels[0] and len(found.waypoints) == 2
        if self._may_keep_clear(found) and not (is_kept and found.ends is None):
            found = self._replace_path(found, "clearance", self._keep_clear)
        return found if found.motion_levels is None else self._for_motion(found)

    def _may_keep_clear(self, found: FoundPath) -> bool:
        """Whether a path may be moved for the sake of its clearance."""
        is_straight = found.planner == self.options.planner == StraightLine.name
        is_held = isinstance(found.checker, ConstrainedChecker) or len(found.levels) == 1
        return not (is_held or is_straight)

    def _for_motion(self, found: FoundPath) -> FoundPath:
        """The path with the levels for its motion, and the highest that it keeps as its checker."""
        levels = found.motion_levels
        assert levels is not None
        if found.ends is None or self.options.refine is None:
            return found._replace(levels=levels, checker=levels[-1])
        states = leg_states(found.waypoints)
        kept = next((level for level in levels[:-1] if level.all_valid(states)), levels[-1])
        return found._replace(levels=levels, checker=kept)

    def _replace_path(
        self, found: FoundPath, stage: str, change: Callable[[FoundPath], Array]
    ) -> FoundPath:
        count = len(found.waypoints)
        path = self.stages.run(
            stage,
            partial(change, found),
            lambda path: (True, f"{count} waypoints became {len(path)}."),
        )
        return found._replace(waypoints=path)

    def _shortcut(self, found: FoundPath) -> Array:
        checker, waypoints = found.checker, found.waypoints
        if isinstance(checker, ConstrainedChecker):
            return shortest_along(Manifold(checker), waypoints, self.options.seed, self.deadline)
        proved, proof = found.attempt.proved, found.levels[-1] if found.attempt.proved else None
        short = shortcut(checker, waypoints, proof, proves=proved)
        if self._may_keep_clear(found) or self.deadline.passed:
            return short
        return quicken(found.levels[-1:], short, self.limits, proves=proved)

    def _keep_clear(self, found: FoundPath) -> Array:
        reached, proves = found.levels.index(found.checker), found.attempt.proved
        path = keep_clear(found.levels, found.waypoints, self.deadline, reached)
        quickens = not self.deadline.passed
        if quickens:
            path = quicken(found.levels, path, self.limits, spacious=reached == 0, proves=proves)
        if found.ends is None:
            return path
        path = _join(found.ends, found.checker, path)
        # Only legs next to the ends lack something: there it is weighed against the time.
        levels = found.levels[-1], found.ends.least
        return quicken(levels, path, self.limits, proves=proves) if quickens else path


def _beyond(barrier: JointBarrier, failure: Failure) -> Failure:
    """The failure of a search for goals beyond a value of a joint that nothing passes."""
    details = {**failure.details, **asdict(barrier), "pair": list(barrier.pair)}
    code = "PLANNING_FAILED" if barrier.certain else failure.code
    return replace(failure, code=code, message=barrier.message, hint=barrier.hint, details=details)


def _join(ends: Ends, clear: Checker, path: Array) -> Array:
    """The path with the ends that it is to have."""
    apart = [float(np.abs(end - path[-1]).max()) for end in ends.retreats]
    last = apart.index(min(apart))
    return join_ends(clear, ends.least, ends.start, path, ends.goals[last])


def _describe_proof(waypoints: Array, *, free: bool) -> tuple[bool, str]:
    legs = len(waypoints) - 1
    if free:
        return True, f"{legs} legs are proved free."
    return False, f"Of {legs} legs that were looked at, not all could be proved free."


def _describe_attempt(attempt: Attempt) -> tuple[bool, str]:
    return attempt.waypoints is not None and attempt.stopped is None, attempt.detail
