"""The whole way from a problem to a certified trajectory: the one file that sees every stage.

Planners give attempts: waypoints, or joint paths that lead the tool. Whatever they give is
shortened, timed and proved here, and here alone the answer is put together.
"""

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

from kinematics.arrays import Array
from kinematics.caches.preparation_limit import PreparationTimedOut, preparation_limit
from kinematics.errors import InvalidOption
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.checker import Checker
from planning.clearance_report import clearance_report
from planning.constrained.checker import ConstrainedChecker
from planning.constrained.path_constraints import apply_path_constraints
from planning.contact_cores import with_cores
from planning.goal_choice.goal_order import (
    MAX_EDGES,
    MAX_LONGER,
    deviation_note,
    ends_off_limits,
    plan_configuration,
)
from planning.options import Options, with_limits
from planning.pipeline.moving_start import (
    OWN_PATH,
    Stoppable,
    brakes_first,
    plan_braking,
    surroundings,
    with_stops,
)
from planning.pipeline.optimize_stage import (
    MOST_OFFERS,
    OptimizeStage,
    check_ends,
    refinement_options,
)
from planning.pipeline.path_search import (
    FoundPath,
    PathSearch,
    choose_fallback,
    choose_planners,
    with_reserve,
)
from planning.planner import Planner, Ready
from planning.preflight.goals import pose_goals
from planning.preflight.limits import moved_note, rates_onto_limits
from planning.preflight.preflight import preflight, start_only
from planning.problem import PoseGoal, Problem
from planning.proof.certificate import Certificate, certify, with_path
from planning.proof.limits.limit_uses import Violation
from planning.proof.path_nearness import CHORD_SHARE
from planning.result import Failure, Path, Plan, Stages
from planning.retiming.retime import near_path
from planning.retiming.retimed import PathToTime
from planning.retiming.simplify import motion_waypoints
from planning.stops.certificate import StopCertificate
from planning.timing.choice import chosen_parametrization
from planning.timing.method import TimingMethod
from planning.timing.motion_timing import motions
from planning.timing.options import Solver, TimingFailed, TimingOptions
from planning.timing.parametrization import TimeParametrization, timing_report
from planning.timing.time_scaling import ScaledTime, with_duration
from planning.tool_motions.tool_path import ToolPath
from planning.tool_paths.tool_timing import TimedToolPath, time_tool_path
from planning.values.deadline import Deadline
from planning.values.limits import MotionLimits
from planning.values.optimize_options import OPTIMIZE


def plan(
    problem: Problem,
    options: Options,
    planners: tuple[Planner, ...] | None = None,
    within: Deadline | None = None,
) -> Plan | Failure:
    """Find, shorten, time and prove a motion, all before one deadline.

    Args:
        problem: The robot, the scene, start and goal.
        options: Planner, timing, timeout, seed.
        planners: Tried in turn, in place of those that the options name.
        within: The end of what this plan is a part of; learns whether time was up.

    Returns:
        A plan whose trajectory is proved, or a failure that says what to try.

    Raises:
        InvalidOption: An unknown planner or option.
        InvalidGoal: Goals that do not go with the planner or the constraints.
        MissingLimit: A velocity or acceleration limit is not known.
    """
    timeout = options.timeout
    deadline = Deadline.after(timeout) if within is None else within.at_most(timeout)
    if problem.moving and brakes_first(problem, options):
        limits = proved_limits(problem, options)
        return plan_braking(
            problem, options, surroundings(problem, options), limits,
            lambda rest: plan(rest, options, planners, deadline),
        )  # fmt: skip
    options = refinement_options(options, problem)
    fallback: tuple[Planner, ...] = ()
    if planners is None:
        planners, fallback = choose_planners(problem, options), choose_fallback(options)
    options = with_limits(options, problem.constraints)
    parametrization = _time_parametrization(problem, options)
    problem, moved = _measured_rates(problem, parametrization)
    wrong = check_ends(problem, parametrization) if problem.moving else None
    if wrong is not None:
        return wrong
    stages = Stages(options.observer)
    pipeline = _Pipeline(
        problem, options, planners, fallback, parametrization, stages, deadline, problem
    )
    try:
        with preparation_limit(deadline.at):
            answer = pipeline.run()
            if isinstance(answer, Failure) and _is_too_deep(answer):
                around = pipeline.run_around_cores()
                answer = around if isinstance(around, Plan) else answer
    except PreparationTimedOut as late:
        deadline.interruptions.occurred = True
        answer = Failure(late.code, late.message, late.hint or "", late.details["stage"])
    if isinstance(answer, Failure):
        details = deadline.interruptions.reported_in(answer.code, answer.details)
        return replace(answer, details=details, stages=tuple(stages.reports))
    return replace(answer, notes=(*moved, *answer.notes)) if moved else answer


def proved_limits(problem: Problem, options: Options) -> MotionLimits:
    """Limits that a plan for a problem is proved within, but for a jerk that splines can't keep."""
    return _time_parametrization(problem, with_limits(options, problem.constraints)).motion_limits


def _measured_rates(
    problem: Problem, parametrization: TimeParametrization
) -> tuple[Problem, tuple[str, ...]]:
    """The problem with the rates of its start inside their limits, if hardly outside, and notes."""
    notes: tuple[str, ...] = ()
    velocity, acceleration = problem.start_velocity, problem.start_acceleration
    bounds = parametrization.bounds
    if velocity is not None:
        taken = rates_onto_limits(velocity, bounds["velocity"])
        notes, velocity = moved_note("velocity of the start", velocity, taken), taken
    if acceleration is not None:
        taken = rates_onto_limits(acceleration, bounds["acceleration"])
        notes += moved_note("acceleration of the start", acceleration, taken)
        acceleration = taken
    if not notes:
        return problem, ()
    return replace(problem, start_velocity=velocity, start_acceleration=acceleration), notes


def _time_parametrization(problem: Problem, options: Options) -> TimeParametrization:
    chain = problem.robot.chain
    return chosen_parametrization(
        options.timing, chain.joint_names, chain.limits, options.limits, chain
    )


class _Timed(NamedTuple):
    """A motion in time, with notes about the timing; of a tool path also its parts.

    ``solver`` is the name of the solver that found the speeds, where the method has several, and
    ``path`` has the waypoints that the motion is to be near, and the tolerance.
    """

    trajectory: Trajectory
    tool_path: TimedToolPath | None = None
    notes: tuple[str, ...] = ()
    solver: Solver | None = None
    path: tuple[Array, float] | None = None


class _Proved(NamedTuple):
    """A motion with its proof; the waypoints of its own path, where it left the one given.

    ``stops`` is the proof of its stops, where these are asked for.
    """

    timed: _Timed
    certificate: Certificate
    waypoints: Array | None = None
    stops: StopCertificate | None = None


@dataclass(frozen=True, slots=True, eq=False)
class _Pipeline:
    """One problem on its way through the stages.

    Args:
        problem: What is to be planned.
        options: How; constraints on the motion's limits are among them already.
        planners: Tried in turn.
        fallback: Planners that begin anew where those give no proved motion; may be none.
        parametrization: The limits and the method of timing.
        stages: Reports of the stages.
        deadline: The end of all of them.
        asked: What is to be proved: the problem, or that which has cores beside its obstacles.
    """

    problem: Problem
    options: Options
    planners: tuple[Planner, ...]
    fallback: tuple[Planner, ...]
    parametrization: TimeParametrization
    stages: Stages
    deadline: Deadline
    asked: Problem

    def run_around_cores(self) -> Plan | Failure | None:
        """Run the stages with cores of what is touched too deep; None where that has none."""
        problem = with_cores(self.problem)
        return None if problem is None else replace(self, problem=problem).run()

    def run(self) -> Plan | Failure:
        """Run the stages in order, to the first failure."""
        ready = self.stages.run("preflight", self._prepare, _describe_ready)
        if isinstance(ready, Failure):
            return ready
        answer = self._plan_from(ready, self.options)
        poses = [goal for goal in self.problem.goals if isinstance(goal, PoseGoal)]
        if isinstance(answer, Failure) or not poses:
            return answer
        ended = self._end_off_limits(ready, answer)
        last = ended.path.waypoints[-1]
        # A plan that leads the tool ends where its tolerance lets it.
        if ready.goals and pose_goals(self.problem, [last]):
            note = deviation_note(self.problem, last)
            if note is not None:
                ended = replace(ended, notes=(*ended.notes, note))
        times = answer.trajectory.duration, ended.trajectory.duration
        replaced = None if ended.trajectory is answer.trajectory else times
        posed = pose_goals(self.problem, [candidate.joints for candidate in ready.found])
        chosen = plan_configuration(
            self.problem, ready, posed, last, self.options.goal_costs, replaced
        )
        return ended if chosen is None else replace(ended, configuration=chosen)

    def _end_off_limits(self, ready: Ready, answer: Plan) -> Plan:
        """The plan, or one to another configuration where this ends at a limit for little time."""
        goals = pose_goals(self.problem, ready.goals)
        if not goals:
            return answer
        last, duration = answer.path.waypoints[-1], answer.trajectory.duration
        chain, limits = self.problem.robot.chain, self.parametrization.estimate_limits
        most = min(self.options.max_edges or MAX_EDGES, MAX_EDGES)
        options = replace(self.options, max_edges=most, explored=None)
        ends = ends_off_limits(chain, ready.start, goals, last, duration, (limits[0], limits[1]))
        for goal in ends:
            if self.deadline.passed:
                break
            other = self._plan_from(replace(ready, goals=[goal], best=None), options)
            if isinstance(other, Plan) and other.trajectory.duration <= MAX_LONGER * duration:
                return other
        certain = not self.deadline.interruptions.occurred
        return replace(answer, stages=tuple(self.stages.reports), deterministic=certain)

    def _plan_from(self, ready: Ready, options: Options) -> Plan | Failure:
        """Run the stages after preflight, with the fallback where the planners come to nothing."""
        if not self.fallback:
            answer = self._plan_by(self.planners, ready, options)
            if isinstance(answer, Plan) or answer.code != "INVALID_MOTION_PLAN":
                return answer
            reserved = with_reserve(self.planners)
            other = self._plan_by(reserved, ready, options) if reserved else answer
            return other if isinstance(other, Plan) else answer
        # The fallback has as much time as the planners before it at least.
        until = self.deadline.within(0.5 * self.deadline.remaining)
        answer = replace(self, deadline=until)._plan_by(self.planners, ready, options)
        if isinstance(answer, Plan):
            return answer
        other = self._plan_by(self.fallback, ready, options)
        if isinstance(other, Plan):
            return other
        # Of both failures: why the fallback found nothing, and where the first planner stopped.
        return replace(other, details={**answer.details, **other.details})

    def _plan_by(
        self, planners: tuple[Planner, ...], ready: Ready, options: Options
    ) -> Plan | Failure:
        """Run the stages after preflight with some planners."""
        search = PathSearch(
            problem=self.problem,
            options=options,
            planners=planners,
            stages=self.stages,
            deadline=self.deadline,
            limits=self.parametrization.estimate_limits,
            diagnoses=planners is not self.planners or not self.fallback,
        )
        found = search.find(ready)
        if isinstance(found, Failure):
            return found
        try:
            proved = self._time_and_prove(found)
        except TimingFailed as error:
            hint = error.hint or "Look at the velocity and acceleration limits."
            return Failure("INVALID_MOTION_PLAN", error.message, hint, "timing")
        if isinstance(proved, Failure):
            return proved
        if self.options.stops != "none":
            proved = self._with_stops(proved)
        return proved if isinstance(proved, Failure) else self._assemble(ready, found, proved)

    def _prepare(self) -> Ready | Failure:
        problem, seed = self.problem, self.options.seed
        if not any(planner.needs_goals for planner in self.planners):
            return start_only(problem)
        ready = preflight(problem, seed, self.deadline, self.options.goal_costs)
        return apply_path_constraints(problem, ready, seed, self.deadline)

    # ------------------------------------------------------------------------------- the motion

    def _time_and_prove(self, found: FoundPath) -> _Proved | Failure:
        """Time the path and prove it, with ever safer motions until one can be proved."""
        refine = self.options.refine is not None
        for time_motion in self._candidates(found):
            timed = self.stages.run("timing", time_motion, _describe_timing)
            # Proved before anything is made of it: whatever refinement takes, this can be answered.
            certificate = self._prove(timed)
            if refine:
                refine = False
                better = self._refine(found.checker, timed.trajectory)
                if better is not None:
                    return better
            if certificate.verified:
                return _Proved(timed, certificate)
            if self.deadline.passed:
                break
        assert certificate.violation is not None
        tool = found.attempt.tool_path is not None
        return _proof_failure(certificate.violation, self.deadline, tool=tool)

    def _candidates(self, found: FoundPath) -> Iterator[Callable[[], _Timed]]:
        """Ways to time the path, the fastest motion first."""
        tool_path, timing = found.attempt.tool_path, self.options.timing
        within, keep_path = self.options.path_tolerance, found.attempt.keep_path
        rounded = timing
        if tool_path is not None:
            if timing.duration is not None:
                raise InvalidOption(
                    "timing.duration belongs to free motions, not to those that lead the tool",
                    hint="Give tool_speed, or leave it out.",
                )
            yield from self._tool_candidates(found, tool_path)
            return
        near: Iterator[Callable[[], ScaledTime]] = iter(())
        if within is not None:
            chain = self.problem.robot.chain
            path = PathToTime(chain.joint_names, found.waypoints, None, within)
            near = near_path(path, timing, self.parametrization, chain)
            rounded, keep_path = replace(timing, blend_tolerance=(1.0 - CHORD_SHARE) * within), True
        on_path = motions(
            found.levels[-1],
            found.waypoints,
            self.parametrization,
            rounded,
            self.deadline,
            found.levels[:-1],
            keep_path=keep_path,
            holds=found.checker.holds if isinstance(found.checker, ConstrainedChecker) else None,
        )
        to_keep = None if within is None else (found.waypoints, within)
        for motion in itertools.chain(near, on_path):
            yield partial(_time_polyline, motion, self.parametrization.method, timing, to_keep)

    def _tool_candidates(
        self, found: FoundPath, tool_path: ToolPath
    ) -> Iterator[Callable[[], _Timed]]:
        """Ways to time a tool path, with the fastest motion to its start first."""
        chain = self.problem.robot.chain

        def time_tool(
            transits: Sequence[Callable[[], ScaledTime]] = (), *, near: bool = False
        ) -> _Timed:
            places = [place for place, _ in tool_path.transits]
            free = {k: time().trajectory for k, time in zip(places, transits, strict=True)}
            timed = time_tool_path(chain, tool_path, self.parametrization, free, near=near)
            return self._with_own_path(_Timed(timed.trajectory(chain), timed, timed.notes))

        if not tool_path.transits:
            # Near a path means off it: constraints that the path just holds are left to the path.
            if self.parametrization.method.near_path and not self.problem.constraints:
                yield partial(time_tool, near=True)
            yield time_tool
            return
        ways = [
            motions(found.levels[-1], waypoints, self.parametrization, self.options.timing,
                    self.deadline)
            for _, waypoints in tool_path.transits
        ]  # fmt: skip
        chosen = [next(way) for way in ways]
        while True:
            yield partial(time_tool, tuple(chosen))
            # Where the motion is refused all free ones take their next, safer form.
            safer = [next(way, None) for way in ways]
            if not any(safer):
                return
            chosen = [new or old for new, old in zip(safer, chosen, strict=True)]

    def _with_own_path(self, timed: _Timed) -> _Timed:
        """A motion that leaves the path found, with waypoints of its own where it is to be near."""
        within = self.options.path_tolerance
        if within is None:
            return timed
        path = motion_waypoints(timed.trajectory, within), within
        return timed._replace(path=path, notes=(*timed.notes, OWN_PATH))

    def _prove(self, timed: _Timed) -> Certificate:
        return self.stages.run("certificate", partial(self._certify, timed), _describe_certificate)

    def _certify(self, timed: _Timed) -> Certificate:
        problem, parametrization, tool_path = self.asked, self.parametrization, timed.tool_path
        limits = parametrization.motion_limits
        if tool_path is not None:
            limits = tool_path.limits(parametrization)
        certificate = certify(
            timed.trajectory,
            problem.robot,
            problem.scene,
            margin=problem.margin,
            constraints=problem.constraints,
            limits=limits,
            tool_motions=None if tool_path is None else tool_path.tool_motions,
            deadline=self.deadline,
        )
        return with_path(certificate, timed.trajectory, *timed.path) if timed.path else certificate

    def _with_stops(self, proved: _Proved) -> _Proved | Failure:
        """Prove the stops of a motion, which is slowed down where they need it."""
        timed = proved.timed

        def prove(slow: Trajectory) -> Certificate:
            return self._certify(timed._replace(trajectory=slow))

        # Times of tool motions and rates at the ends are the request's.
        fixed = timed.tool_path is not None or self.problem.moving
        found = self.stages.run(
            "stops",
            lambda: with_stops(
                (timed.trajectory, proved.certificate),
                surroundings(self.asked, self.options),
                self.options,
                self.deadline,
                None if fixed else prove,
            ),
            _describe_stops,
        )
        if isinstance(found, Failure):
            return found
        timed = timed._replace(trajectory=found.trajectory)
        return proved._replace(timed=timed, certificate=found.certificate, stops=found.stops)

    def _refine(self, checker: Checker, known: Trajectory) -> _Proved | Failure | None:
        """Optimise a motion and prove the result; None where the motion itself is to be taken."""
        work = OptimizeStage(self.problem, checker, self.options, self.parametrization, known)
        for _ in range(MOST_OFFERS):
            # The rest of the time is for the proof of what optimising offers.
            until = self.deadline.within(0.8 * self.deadline.remaining)
            offer = self.stages.run(OPTIMIZE, partial(work.offer, until), work.report)
            if offer is None:
                break
            timing, offered = self.options.timing, ScaledTime(offer.trajectory, 1.0)
            lasting = with_duration(offered, timing.duration, timing.at_least)
            timed = self._with_own_path(_Timed(lasting.trajectory))
            certificate = self._prove(timed)
            if certificate.verified:
                return _Proved(timed, certificate, offer.waypoints)
            if not work.reject(offer, certificate):
                break
        return work.failure(self.deadline)

    # ------------------------------------------------------------------------------- the answer

    def _assemble(self, ready: Ready, found: FoundPath, proved: _Proved) -> Plan:
        attempt, timed = found.attempt, proved.timed
        notes = ready.notes + attempt.notes + timed.notes
        if not self.problem.robot.pieces:
            notes += ("The robot has no collision geometry: nothing is known of collisions.",)
        optimised = proved.waypoints is not None
        clearance, certificate = None, proved.certificate
        try:
            clearance = clearance_report(
                ready.checkers, timed.trajectory, self.options.clearance, self.problem.margin,
                (certificate.min_obstacle_clearance, certificate.min_self_clearance),
            )  # fmt: skip
        except PreparationTimedOut:
            # What is proved is answered; the report is of what is only preferred.
            self.deadline.interruptions.occurred = True
            notes += ("There was no time to look where the motion is nearer than preferred.",)
        timing = timing_report(self.parametrization, timed.solver)
        waypoints = found.waypoints if proved.waypoints is None else proved.waypoints
        if timed.path is not None:
            waypoints = timed.path[0]
        return Plan(
            planner=OPTIMIZE if optimised else found.planner,
            stages=tuple(self.stages.reports),
            path=Path(waypoints),
            trajectory=timed.trajectory,
            certificate=certificate,
            notes=notes,
            descent=attempt.descent,
            progress=attempt.progress,
            fraction=None if attempt.tool_path is None else attempt.tool_path.fraction,
            tool_motions=() if timed.tool_path is None else timed.tool_path.reports,
            stopped=attempt.stopped,
            clearance=clearance,
            timing=replace(timing, solver=None) if optimised else timing,
            deterministic=not self.deadline.interruptions.occurred,
            stops=proved.stops,
            surroundings=surroundings(self.asked, self.options)._replace(
                margin=certificate.premises.margin
            ),
        )


def _is_too_deep(failure: Failure) -> bool:
    """Whether a motion touches what it may touch too deep on its way, not at an end."""
    return failure.stage == "certificate" and failure.details.keys() >= {"touch_depth", "time"}


def _time_polyline(
    motion: Callable[[], ScaledTime],
    method: TimingMethod,
    timing: TimingOptions,
    path: tuple[Array, float] | None,
) -> _Timed:
    scaled = with_duration(motion(), timing.duration, timing.at_least)
    notes = method.notes((scaled,))
    return _Timed(scaled.trajectory, notes=notes, solver=scaled.solver, path=path)


def _proof_failure(violation: Violation, deadline: Deadline, *, tool: bool) -> Failure:
    """Why the motion is no answer; ``tool`` says whether it leads the tool along motions."""
    hint = "Allow more time, another seed, or a smaller margin."
    if tool:
        hint = "Allow more time, a larger max_deviation, or a smaller margin."
        if violation.kind == "path_constraint":
            hint = "Lead the tool elsewhere, or widen the constraint."
    if "touch_depth" in violation.details:
        hint = "Raise touch_depth if so deep a contact is meant (null for any depth)."
    return Failure(
        code="TIMED_OUT" if deadline.passed else "INVALID_MOTION_PLAN",
        message=f"the motion that was found could not be proved: {violation.message}",
        hint=hint,
        stage="certificate",
        details={"kind": violation.kind, "time": violation.time, **violation.details},
    )


def _describe_ready(answer: Ready | Failure) -> tuple[bool, str]:
    if isinstance(answer, Failure):
        return False, answer.message
    if not answer.goals:
        return True, "The start is valid."
    return True, f"{len(answer.goals)} goal configuration(s)."


def _describe_timing(timed: _Timed) -> tuple[bool, str]:
    return True, f"{timed.trajectory.duration:.3f} s, {timed.trajectory.pieces} pieces."


def _describe_stops(found: Stoppable | Failure) -> tuple[bool, str]:
    if isinstance(found, Failure):
        return False, found.message
    slowed = f", slowed down by {found.stops.slowed:.3f} s" if found.stops.slowed else ""
    return True, f"At rest within {found.stops.longest:.3f} s{slowed}."


def _describe_certificate(certificate: Certificate) -> tuple[bool, str]:
    if certificate.violation is not None:
        return False, certificate.violation.message
    deviation = certificate.path_deviation
    if deviation is not None:
        return True, f"The tool is within {deviation.position:.3g} m of its motion."
    if certificate.clearance_pair is None:
        return True, "Nothing can collide."
    return True, f"At least {certificate.min_clearance:.4g} m clear, {certificate.cells} cells."
