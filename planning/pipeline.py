"""The whole way from a problem to a certified trajectory: the one file that sees every stage."""

from dataclasses import replace
from functools import partial
from typing import NamedTuple

from kinematics.arrays import Array
from kinematics.trajectory import Trajectory
from obstacles.checker import Checker
from planning.cartesian.planner import cartesian_plan
from planning.constrained.checker import ConstrainedChecker
from planning.constrained.path_constraints import constrained
from planning.constrained.projected_rrt import Manifold, shorten
from planning.constrained.relaxation import Relaxation, relaxed
from planning.deadline import Deadline
from planning.diagnosis import Diagnosis, diagnose
from planning.motion_limits import with_limits
from planning.optimize.options import OPTIMIZE
from planning.optimize_stage import MOST_OFFERS, OptimizeStage, check_ends, refining
from planning.options import Options
from planning.preflight import preflight
from planning.problem import Problem
from planning.proof.certificate import Certificate, certify
from planning.ready import Ready
from planning.result import Attempt, Failure, Path, Plan
from planning.search.planner import Rung, check_options
from planning.search.shortcut import shortcut
from planning.stages import Stages
from planning.timing.choice import chosen_parametrization
from planning.timing.failure import TimingFailed
from planning.timing.motion_timing import motions
from planning.timing.parametrization import TimeParametrization

CASCADE = ("straight_line", "potential_field", "rrt_connect")

#: Share of the time, and at most so many seconds, kept back for shortening, timing and the proof.
_RESERVED_SHARE = 0.2
_RESERVED_MOST = 1.0
#: Seconds at most that are spent on finding out why there is no path.
_DIAGNOSIS_MOST = 1.0
#: Share of the time for a path of the robot in its solids' hulls, before the exact one is tried.
_HULLS_SHARE = 0.4

#: Share of the time that is left which optimising may take; the rest is for the proof of its offer.
_REFINING_SHARE = 0.8


def plan(problem: Problem, options: Options) -> Plan | Failure:
    """Find, shorten, time and prove a motion, all before one deadline.

    Args:
        problem: The robot, the scene, start and goal.
        options: Planner, timing, timeout, seed.

    Returns:
        A plan whose trajectory is proved, or a failure that says what to try.

    Raises:
        InvalidOption: An unknown planner or option.
        MissingLimit: A velocity or acceleration limit is not known.
    """
    deadline = Deadline.after(options.timeout)
    options = refining(options, problem)
    check_options(options)
    options = with_limits(options, problem.constraints)
    law = _law(problem, options)
    stages = Stages(options.observer)
    wrong = check_ends(problem, law)
    if wrong is not None:
        return wrong
    if options.planner == "cartesian":
        return cartesian_plan(problem, options, law, stages, deadline)
    ready = stages.run(
        "preflight",
        lambda: constrained(problem, preflight(problem, options.seed, deadline), options.seed),
        _tell_preflight,
    )
    if isinstance(ready, Failure):
        return replace(ready, stages=tuple(stages.reports))
    reserved = min(_RESERVED_SHARE * options.timeout, _RESERVED_MOST)
    found = _find_path(problem, ready, options, stages, Deadline(deadline.at - reserved))
    if isinstance(found, Failure):
        told = stages.run(
            "diagnosis",
            lambda: _diagnosis(problem, ready, options, deadline),
            lambda told: (True, told.sentence),
        )
        details = {**found.details, **told.details}
        return replace(found, stages=tuple(stages.reports), details=details)
    planner, attempt, checker = found
    waypoints = attempt.waypoints
    assert waypoints is not None
    if len(waypoints) > 2:
        waypoints = stages.run(
            "shortcut",
            lambda: _shorter(checker, waypoints, options.seed, deadline),
            lambda short: (True, f"{len(waypoints)} waypoints became {len(short)}."),
        )
    try:
        timed = _time_and_prove(problem, checker, waypoints, law, options, stages, deadline)
    except TimingFailed as error:
        hint = error.hint or "Look at the velocity and acceleration limits."
        timed = Failure("INVALID_MOTION_PLAN", error.message, hint, "timing")
    if isinstance(timed, Failure):
        return replace(timed, stages=tuple(stages.reports))
    trajectory, certificate = timed.trajectory, timed.certificate
    optimised = timed.waypoints is not None
    notes = ready.notes + attempt.notes
    if not problem.robot.pieces:
        notes += ("The robot has no collision geometry: nothing is known of collisions.",)
    return Plan(
        planner=OPTIMIZE if optimised else planner,
        stages=tuple(stages.reports),
        path=Path(waypoints if timed.waypoints is None else timed.waypoints),
        trajectory=trajectory,
        certificate=certificate,
        notes=notes,
        descent=attempt.descent,
        progress=attempt.progress,
    )


def _shorter(checker: Checker, waypoints: Array, seed: int, deadline: Deadline) -> Array:
    if isinstance(checker, ConstrainedChecker):
        return shorten(Manifold(checker), waypoints, seed, deadline)
    return shortcut(checker, waypoints, deadline)


def _law(problem: Problem, options: Options) -> TimeParametrization:
    chain = problem.robot.chain
    return chosen_parametrization(
        options.timing, chain.joint_names, chain.limits, options.limits, chain
    )


def _tell_preflight(answer: Ready | Failure) -> tuple[bool, str]:
    if isinstance(answer, Failure):
        return False, answer.message
    return True, f"{len(answer.goals)} goal configuration(s)."


def _find_path(
    problem: Problem, ready: Ready, options: Options, stages: Stages, deadline: Deadline
) -> tuple[str, Attempt, Checker] | Failure:
    """Climb the ladder, or the one rung that was asked for; in hulls first where that can be."""
    for checker in ready.checkers:
        exact = checker is ready.checkers[-1]
        share = 1.0 if exact else _HULLS_SHARE
        own = Deadline.after(share * deadline.remaining)
        for planner in CASCADE if options.planner == "auto" else (options.planner,):
            rung = Rung(planner, problem, ready, checker, options, own)
            attempt = stages.run(planner, rung.run_planner, _tell_attempt)
            if attempt.waypoints is not None:
                return planner, attempt, checker
    last = stages.reports[-1]
    if deadline.passed:
        return Failure(
            code="TIMED_OUT",
            message=f"no path was found within the timeout of {options.timeout:g} s",
            hint="Allow more time, another seed, or a smaller margin.",
            stage=last.name,
            details=attempt.details,
        )
    return Failure(
        code="PLANNING_FAILED",
        message=f"{last.name} found no path: {last.detail}",
        hint='Ask for planner "auto", or move the start, the goal or the obstacles.',
        stage=last.name,
        details=attempt.details,
    )


def _diagnosis(
    problem: Problem, ready: Ready, options: Options, deadline: Deadline
) -> Diagnosis | Relaxation:
    """What is in the way, in the time that was kept back for a path that was not found."""
    own = Deadline.after(min(_DIAGNOSIS_MOST, deadline.remaining))
    exact = ready.checkers[-1]
    if isinstance(exact, ConstrainedChecker):
        return relaxed(exact, ready.start, ready.goals, options.seed, own)
    return diagnose(
        problem.robot, problem.scene, ready.checkers[-1], ready.start, ready.goals, own,
        margin=problem.margin, seed=options.seed,
    )  # fmt: skip


def _tell_attempt(attempt: Attempt) -> tuple[bool, str]:
    return attempt.waypoints is not None, attempt.detail


class _Proved(NamedTuple):
    """A motion with its proof; the waypoints of its own path, where it left the one given."""

    trajectory: Trajectory
    certificate: Certificate
    waypoints: Array | None = None


def _time_and_prove(
    problem: Problem,
    checker: Checker,
    waypoints: Array,
    law: TimeParametrization,
    options: Options,
    stages: Stages,
    deadline: Deadline,
) -> _Proved | Failure:
    """Time the path and prove it, with ever safer motions until one can be proved."""
    refine = options.refine
    for motion in motions(checker, waypoints, law, options.timing, deadline):
        timed = stages.run(
            "timing",
            motion,
            lambda timed: (True, f"{timed.duration:.3f} s, {timed.pieces} pieces."),
        )
        # Proved before anything is made of it: whatever refinement takes, this can be answered.
        certificate = _prove(problem, timed, law, stages, deadline)
        if refine is not None:
            better = _refine(problem, checker, timed, law, options, stages, deadline)
            if better is not None:
                return better
            refine = None
        if certificate.verified:
            return _Proved(timed, certificate)
        if deadline.passed:
            break
    return _refused(certificate, deadline)


def _prove(
    problem: Problem,
    timed: Trajectory,
    law: TimeParametrization,
    stages: Stages,
    deadline: Deadline,
) -> Certificate:
    prove = partial(
        certify, timed, problem.robot, problem.scene, margin=problem.margin,
        constraints=problem.constraints,
    )  # fmt: skip
    return stages.run(
        "certificate",
        partial(prove, limits=law.bounds, loads=law.loads, deadline=deadline),
        _tell_certificate,
    )


def _refine(
    problem: Problem,
    checker: Checker,
    timed: Trajectory,
    law: TimeParametrization,
    options: Options,
    stages: Stages,
    deadline: Deadline,
) -> _Proved | Failure | None:
    """Optimise a motion and prove what comes of it; None where the motion itself is to be taken."""
    work = OptimizeStage(problem, checker, options, law, timed)
    for _ in range(MOST_OFFERS):
        offer = stages.run(OPTIMIZE, partial(work.offer, _share(deadline)), work.tell)
        if offer is None:
            break
        certificate = _prove(problem, offer.trajectory, law, stages, deadline)
        if certificate.verified:
            return _Proved(offer.trajectory, certificate, offer.waypoints)
        if not work.refuse(offer, certificate):
            break
    return work.failure(deadline)


def _share(deadline: Deadline) -> Deadline:
    return Deadline.after(_REFINING_SHARE * deadline.remaining)


def _tell_certificate(certificate: Certificate) -> tuple[bool, str]:
    if certificate.violation is not None:
        return False, certificate.violation.message
    if certificate.clearance_pair is None:
        return True, "Nothing can collide."
    return True, f"At least {certificate.min_clearance:.4g} m clear, {certificate.cells} cells."


def _refused(certificate: Certificate, deadline: Deadline) -> Failure:
    violation = certificate.violation
    assert violation is not None
    code = "TIMED_OUT" if deadline.passed else "INVALID_MOTION_PLAN"
    return Failure(
        code=code,
        message=f"the motion that was found could not be proved: {violation.message}",
        hint="Allow more time, another seed, or a smaller margin.",
        stage="certificate",
        details={"kind": violation.kind, "time": violation.time, **violation.details},
    )
