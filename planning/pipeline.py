"""The whole way from a problem to a certified trajectory: the one file that sees every stage."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TypeVar

import numpy as np

from kinematics.chain import Array
from kinematics.errors import InvalidOption
from kinematics.trajectory import Trajectory
from planning.certificate import Certificate, certify
from planning.deadline import Deadline
from planning.options import Options
from planning.potential_field import FieldOptions, potential_field
from planning.preflight import Ready, preflight
from planning.problem import Problem
from planning.result import Failure, Path, Plan, StageReport
from planning.rounding import certified_reaches
from planning.sampling import PLANNERS as SAMPLING_PLANNERS
from planning.sampling import sample
from planning.shortcut import shortcut
from planning.straight_line import straight_line
from planning.timing.blend import blend, merge
from planning.timing.failure import TimingFailed
from planning.timing.minimum_time import time_path

LADDER = ("straight_line", "potential_field", "rrt_connect")
PLANNERS = ("auto", "straight_line", "potential_field", *SAMPLING_PLANNERS)

#: Share of the time, and at most so many seconds, kept back for shortening, timing and the proof.
_RESERVED_SHARE = 0.2
_RESERVED_MOST = 1.0
#: Share of the time that is left which the potential field may spend.
_FIELD_SHARE = 0.1

#: A motion from a configuration to itself: to stand still this long [s].
_REST = 1e-3

_T = TypeVar("_T")


@dataclass(slots=True)
class _Stages:
    """Reports of the stages, written down as they end."""

    reports: list[StageReport] = field(default_factory=list)

    def run(self, name: str, stage: Callable[[], _T], tell: Callable[[_T], tuple[bool, str]]) -> _T:
        """Run a stage, time it, and note what ``tell`` makes of its answer."""
        began = time.perf_counter()
        answer = stage()
        succeeded, detail = tell(answer)
        milliseconds = 1e3 * (time.perf_counter() - began)
        outcome = "succeeded" if succeeded else "failed"
        self.reports.append(StageReport(name, outcome, milliseconds, detail))
        return answer


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
    _check_options(options)
    limits = _limits(problem, options)
    stages = _Stages()
    ready = stages.run("preflight", lambda: preflight(problem, options.seed), _tell_preflight)
    if isinstance(ready, Failure):
        return replace(ready, stages=tuple(stages.reports))
    reserved = min(_RESERVED_SHARE * options.timeout, _RESERVED_MOST)
    found = _find_path(problem, ready, options, stages, Deadline(deadline.at - reserved))
    if isinstance(found, Failure):
        return replace(found, stages=tuple(stages.reports))
    planner, waypoints = found
    if len(waypoints) > 2:
        waypoints = stages.run(
            "shortcut",
            lambda: shortcut(ready.checker, waypoints, options.seed, deadline),
            lambda short: (True, f"{len(waypoints)} waypoints became {len(short)}."),
        )
    try:
        timed = _time_and_prove(problem, ready, waypoints, limits, stages, deadline)
    except TimingFailed as error:
        hint = error.hint or "Look at the velocity and acceleration limits."
        timed = Failure("INVALID_MOTION_PLAN", error.message, hint, "timing")
    if isinstance(timed, Failure):
        return replace(timed, stages=tuple(stages.reports))
    trajectory, certificate = timed
    path = Path(waypoints)
    return Plan(planner, tuple(stages.reports), path, trajectory, certificate, ready.notes)


def _check_options(options: Options) -> None:
    if options.planner not in PLANNERS:
        raise InvalidOption(
            f"there is no planner {options.planner!r}",
            hint=f"Choose one of: {', '.join(PLANNERS)}.",
            planners=list(PLANNERS),
        )
    if options.planner in ("auto", "straight_line") and options.planner_options:
        raise InvalidOption(
            f"planner {options.planner!r} has no options",
            hint="Name the planner that planner_options are for.",
        )


def _limits(problem: Problem, options: Options) -> dict[str, Array]:
    chain = problem.robot.chain
    timing = options.timing
    velocity = chain.limits.require("velocity", chain.joint_names)
    acceleration = chain.limits.require("acceleration", chain.joint_names)
    return {
        "velocity": velocity * timing.velocity_scaling,
        "acceleration": acceleration * timing.acceleration_scaling,
    }


def _tell_preflight(answer: Ready | Failure) -> tuple[bool, str]:
    if isinstance(answer, Failure):
        return False, answer.message
    return True, f"{len(answer.goals)} goal configuration(s)."


def _find_path(
    problem: Problem, ready: Ready, options: Options, stages: _Stages, deadline: Deadline
) -> tuple[str, Array] | Failure:
    """Climb the ladder, or the one rung that was asked for."""
    for planner in LADDER if options.planner == "auto" else (options.planner,):
        waypoints = _rung(planner, problem, ready, options, stages, deadline)
        if waypoints is not None:
            return planner, waypoints
    last = stages.reports[-1]
    if deadline.passed:
        return Failure(
            code="TIMED_OUT",
            message=f"no path was found within the timeout of {options.timeout:g} s",
            hint="Allow more time, another seed, or a smaller margin.",
            stage=last.name,
        )
    return Failure(
        code="PLANNING_FAILED",
        message=f"{last.name} found no path: {last.detail}",
        hint='Ask for planner "auto", or move the start, the goal or the obstacles.',
        stage=last.name,
    )


def _rung(
    planner: str,
    problem: Problem,
    ready: Ready,
    options: Options,
    stages: _Stages,
    deadline: Deadline,
) -> Array | None:
    if planner == "straight_line":
        return _try_straight_line(ready, stages)
    if planner == "potential_field":
        share = _FIELD_SHARE if options.planner == "auto" else 1.0
        own = Deadline.after(share * deadline.remaining)
        return _try_potential_field(problem, ready, options, stages, own)
    chain = problem.robot.chain
    result = stages.run(
        planner,
        lambda: sample(
            planner, chain, ready.checker, ready.start, ready.goals,
            options.planner_options, options.seed, deadline,
        ),
        lambda sampled: (sampled.waypoints is not None, f"{sampled.edges} edges checked."),
    )  # fmt: skip
    return result.waypoints


def _try_straight_line(ready: Ready, stages: _Stages) -> Array | None:
    waypoints, _ = stages.run(
        "straight_line",
        lambda: straight_line(ready.checker, ready.start, ready.goals),
        lambda answer: (
            answer[0] is not None,
            "Proved free." if answer[0] is not None else f"Blocked by {answer[1][0].pair}.",
        ),
    )
    return waypoints


def _try_potential_field(
    problem: Problem, ready: Ready, options: Options, stages: _Stages, deadline: Deadline
) -> Array | None:
    parameters = FieldOptions.of({} if options.planner == "auto" else options.planner_options)
    result = stages.run(
        "potential_field",
        lambda: potential_field(
            problem.robot.chain, ready.checker, problem.scene,
            ready.start, ready.goals[0], parameters, deadline,
        ),
        lambda field: (field.waypoints is not None, field.detail),
    )  # fmt: skip
    return result.waypoints


def _time_and_prove(
    problem: Problem,
    ready: Ready,
    waypoints: Array,
    limits: dict[str, Array],
    stages: _Stages,
    deadline: Deadline,
) -> tuple[Trajectory, Certificate] | Failure:
    """Round the corners, time the path and prove it; with sharp corners if that fails."""
    points = merge(waypoints)
    for rounded in (True, False):
        timed = stages.run(
            "timing",
            partial(_timed, ready, points, limits, rounded, deadline),
            lambda timed: (True, f"{timed.duration:.3f} s, {timed.pieces} pieces."),
        )
        prove = partial(certify, timed, problem.robot, problem.scene, margin=problem.margin)
        certificate = stages.run(
            "certificate", partial(prove, limits=limits, deadline=deadline), _tell_certificate
        )
        if certificate.verified:
            return timed, certificate
        if len(points) < 3 or deadline.passed:
            break
    return _refused(certificate, deadline)


def _timed(
    ready: Ready, points: Array, limits: dict[str, Array], rounded: bool, deadline: Deadline
) -> Trajectory:
    names = ready.checker.model.chain.joint_names
    if len(points) < 2:
        return Trajectory(names, np.array([0.0, _REST]), points[0][None, :, None])
    reaches = np.zeros(len(points) - 2)
    if rounded:
        reaches = certified_reaches(ready.checker, points, deadline)
    path = blend(points, reaches)
    return time_path(path, names, limits["velocity"], limits["acceleration"]).trajectory


def _tell_certificate(certificate: Certificate) -> tuple[bool, str]:
    if certificate.violation is not None:
        return False, certificate.violation.message
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
