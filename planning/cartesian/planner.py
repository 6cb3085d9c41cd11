"""Straight and circular motions of the tool, from the problem to a certified trajectory.

Each motion is followed in one branch of inverse kinematics, proved free, timed, and at rest at its
ends: so corners are met exactly. What is answered is proved to keep the tool within
``max_deviation`` of its motion for every instant. Where the tool can't be led to the end it says
how far it comes and what is in the way.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from kinematics.arrays import Array
from kinematics.chain import Chain
from kinematics.errors import InvalidGoal, InvalidOption
from kinematics.forward import forward
from kinematics.pose import rotation_error, to_quaternion
from kinematics.trajectory import Trajectory, concatenate, stay
from obstacles.checker import Checker
from planning.cartesian.tool_following import Followed, Stop, Tolerances, follow
from planning.constrained.path_constraints import end_violation
from planning.deadline import Deadline
from planning.options import CartesianOptions, Options
from planning.preflight import ready_start
from planning.problem import JointGoal, PoseGoal, Problem
from planning.proof.certificate import Certificate, Violation, certify
from planning.proof.tool_deviation import PathDeviation, piece_deviations
from planning.ready import ValidStart
from planning.result import Failure, Path, Plan, ToolMotionReport
from planning.stages import Stages
from planning.timing.failure import TimingFailed
from planning.timing.parametrization import TimeParametrization
from planning.tool_motion import ToolMotion, arc_about, arc_via, line

#: More than the margin is kept by this, where the start has it to spare [m]: see ``preflight``.
_SLACK = 1e-4
#: Halvings of the stretch on which a motion meets something, to come near to it.
_NEARING = 12
#: How near a motion must come to the joints of its goal [rad or m].
_SAME_JOINTS = 1e-5
#: How near motions must end to a goal given by joints [m], [rad].
_SAME_POSE = (1e-6, 1e-6)
#: How often a spline of time is given twice as many waypoints to keep nearer to its motion.
_DENSER = 6


@dataclass(frozen=True, slots=True, eq=False)
class ToolPath:
    """Joint paths that lead the tool along its motions.

    Args:
        motions: Those that were begun.
        followed: The joint path of each.
        fraction: How much of all motions asked for was carried out: those that were completed,
            and the share of the one that was not, over their number.
        stop: Why it ends early; None where it does not.
    """

    motions: tuple[ToolMotion, ...]
    followed: tuple[Followed, ...]
    fraction: float
    stop: Stop | None

    @property
    def waypoints(self) -> Array:
        """The configurations that the curves go through, shape (k, n)."""
        rows = [self.followed[0].start]
        for item in self.followed:
            if item.path is not None:
                rows += [*item.path.coefficients[1:, :, 0], item.end]
        return np.array(rows)


def tool_path(
    chain: Chain,
    checker: Checker,
    start: Array,
    motions: Sequence[ToolMotion],
    tolerances: Tolerances,
    deadline: Deadline,
) -> ToolPath:
    """Lead the tool along motions from a configuration, as far as can be proved free.

    Each motion begins where the one before ends, the first at the tool's pose in ``start``. The
    joints stay in one branch: they never jump. Between the configurations found by inverse
    kinematics the tool is within the tolerances too, which is proved, not sampled.

    Args:
        chain: The robot; its tip is the tool.
        checker: The robot in its scene.
        start: Free and inside the limits, shape (n,).
        motions: Lines and arcs, at least one.
        tolerances: How far the tool may be off them.
        deadline: When to give up.
    """
    followed: list[Followed] = []
    q = start
    for motion in motions:
        found = _freed(checker, follow(chain, motion, q, tolerances, deadline))
        followed.append(found)
        q = found.end
        if found.stop is not None:
            break
    last = followed[-1]
    done = len(followed) - 1 + (1.0 if last.stop is None else last.reached)
    begun = tuple(motions[: len(followed)])
    return ToolPath(begun, tuple(followed), done / len(motions), last.stop)


def _freed(checker: Checker, followed: Followed) -> Followed:
    """What of a joint path is proved free."""
    path = followed.path
    if path is None:
        return followed
    at = 0.0
    for piece, length in zip(path.coefficients, path.lengths, strict=True):
        motion = checker.curve(*_stretch(piece, float(length)))
        if not motion.free:
            clear = _clear_until(checker, piece, float(length), motion.at)
            assert motion.pair is not None
            a, b = motion.pair
            text = f"{a!r} and {b!r} come too near to each other"
            details = {"pair": [a, b], "colliding": motion.colliding}
            return followed.cut(at + clear, Stop(at + clear, "collision", text, details))
        at += float(length)
    return followed


def _stretch(piece: Array, length: float) -> tuple[Array, Array, Array, Array]:
    """The beginning of a cubic piece (n, 4) as coefficients on [0, 1]."""
    b0, b1, b2, b3 = (piece * length ** np.arange(4)).T
    return b0, b1, b2, b3


def _clear_until(checker: Checker, piece: Array, length: float, met: float) -> float:
    """How far along a piece all is proved free, at most to where something was met."""
    low, high = 0.0, met * length
    for _ in range(_NEARING):
        middle = 0.5 * (low + high)
        free = middle > 0.0 and checker.curve(*_stretch(piece, middle)).free
        low, high = (middle, high) if free else (low, middle)
    return low


# --------------------------------------------------------------------------------- problems


def cartesian_plan(
    problem: Problem, options: Options, law: TimeParametrization, stages: Stages, deadline: Deadline
) -> Plan | Failure:
    """Lead the tool along the motions that are asked for, or straight to the goal.

    Args:
        problem: The robot, the scene, start and goal.
        options: Those of the planner "cartesian", timing, timeout.
        law: How to time.
        stages: Where to note what was done.
        deadline: When to give up.

    Raises:
        InvalidGoal: Motions that name no circle, or do not end at the goal; several goals.
        InvalidOption: Timing options that do not go with it.
    """
    _check(problem, options)
    begun = stages.run("preflight", lambda: ready_start(problem), _tell_start)
    if isinstance(begun, Failure):
        return replace(begun, stages=tuple(stages.reports))
    asked = options.cartesian
    free = asked.orientation == "free"
    tolerances = Tolerances(asked.max_deviation, None if free else asked.max_orientation_deviation)
    chain = problem.robot.chain
    motions = tool_motions(forward(chain, begun.joints), asked, _target(problem))
    checker = Checker(begun.checker.model, min(_SLACK, 0.5 * begun.clearance))
    found = stages.run(
        "cartesian",
        lambda: tool_path(chain, checker, begun.joints, motions, tolerances, deadline),
        _tell_path,
    )
    refused = _refused(problem, asked, found) or _off_constraints(problem, found)
    if refused is not None:
        return replace(refused, stages=tuple(stages.reports))
    try:
        timed = _time_and_prove(problem, found, tolerances, law, stages, deadline)
    except TimingFailed as error:
        hint = error.hint or "Look at the velocity and acceleration limits."
        timed = Failure("INVALID_MOTION_PLAN", error.message, hint, "timing")
    if isinstance(timed, Failure):
        return replace(timed, stages=tuple(stages.reports))
    trajectory, certificate, reports = timed
    stopped = None if found.stop is None else _stopped(problem.robot.chain, found)
    notes = begun.notes
    if stopped is not None:
        notes += (f"The motion ends early: {stopped['message']}.",)
    if not problem.robot.pieces:
        notes += ("The robot has no collision geometry: nothing is known of collisions.",)
    return Plan(
        planner="cartesian",
        stages=tuple(stages.reports),
        path=Path(found.waypoints),
        trajectory=trajectory,
        certificate=certificate,
        notes=notes,
        fraction=found.fraction,
        tool_motions=reports,
        stopped=stopped,
    )


def _off_constraints(problem: Problem, found: ToolPath) -> Failure | None:
    """Why the ends of the motion can't be answered: what constrains the path is broken there."""
    start = end_violation(problem.constraints, "start", found.followed[0].start)
    if start is not None or found.stop is not None:
        return start
    return end_violation(problem.constraints, "goal", found.followed[-1].end)


def _check(problem: Problem, options: Options) -> None:
    if len(problem.goals) != 1:
        raise InvalidGoal(
            "the planner cartesian goes to one goal, not to any of several",
            hint="Give the pose that the tool is to be led to.",
        )
    timing = options.timing
    if timing.times is not None:
        raise InvalidOption(
            "timing.times do not go with the planner cartesian: it finds the waypoints itself",
            hint="Leave times out, or time the path it answers by POST /v1/retime.",
        )
    if timing.interpolation not in {None, "clamped_spline"} or timing.blend_tolerance:
        raise InvalidOption(
            "timing.interpolation and blend_tolerance do not go with the planner cartesian: "
            "the tool's motion is kept, and stops at its corners",
            hint="Leave them out.",
        )


def _target(problem: Problem) -> Array:
    goal = problem.goals[0]
    if isinstance(goal, PoseGoal):
        return goal.T_base_tip
    return forward(problem.robot.chain, goal.joints)


def tool_motions(
    T_start: Array, asked: CartesianOptions, target: Array | None = None
) -> tuple[ToolMotion, ...]:
    """The motions that options ask for, each from where the one before ends.

    Args:
        T_start: Pose of the tool at the start, shape (4, 4).
        asked: The options.
        target: The goal's pose, shape (4, 4): what one line leads to if no motions are asked for.

    Raises:
        InvalidGoal: An arc that is none; the message says which motion.
        InvalidOption: There are neither motions nor a goal.
    """
    if not asked.motions:
        if target is None:
            raise InvalidOption("there is no motion to be carried out")
        return (line(T_start, target),)
    made: list[ToolMotion] = []
    T = T_start
    for i, item in enumerate(asked.motions):
        end = np.array(item.T_base_tip)
        try:
            if item.kind == "lin":
                made.append(line(T, end))
            elif item.via is not None:
                made.append(arc_via(T, end, item.via))
            else:
                assert item.center is not None
                made.append(arc_about(T, end, item.center, item.normal))
        except InvalidGoal as error:
            raise InvalidGoal(
                f"motions[{i}]: {error.message}", hint=error.hint, motion=i, **error.details
            ) from None
        T = end
    return tuple(made)


def _tell_start(answer: ValidStart | Failure) -> tuple[bool, str]:
    if isinstance(answer, Failure):
        return False, answer.message
    return True, "The start is valid."


def _tell_path(found: ToolPath) -> tuple[bool, str]:
    if found.stop is None:
        return True, f"{len(found.motions)} motion(s), {len(found.waypoints)} configurations."
    return False, f"{100.0 * found.fraction:.4g} % of the way: {found.stop.message}."


def _refused(problem: Problem, asked: CartesianOptions, found: ToolPath) -> Failure | None:
    """Why a path is no answer, if it is none."""
    chain, goal = problem.robot.chain, problem.goals[0]
    if asked.motions:
        _check_end(chain, goal, np.array(asked.motions[-1].T_base_tip))
    if found.stop is None:
        q = found.followed[-1].end
        if isinstance(goal, JointGoal) and np.abs(q - goal.joints).max() > _SAME_JOINTS:
            j = int(np.argmax(np.abs(q - goal.joints)))
            return Failure(
                "PLANNING_FAILED",
                "the tool can be led to the goal's pose, but not to its joints: "
                f"{chain.joint_names[j]!r} ends at {q[j]:.6g}, not {goal.joints[j]:.6g}",
                "Give the goal as a pose, or a goal in the branch of the start.",
                "cartesian",
                details=_place(chain, found, q) | {"reason": "branch"},
            )
        return None
    if asked.allow_partial and found.fraction > 0.0:
        return None
    stopped = _stopped(chain, found)
    if found.stop.reason == "time":
        return Failure(
            "TIMED_OUT", f"time was up after {100.0 * found.fraction:.4g} % of the motion",
            "Allow more time.", "cartesian", details=stopped,
        )  # fmt: skip
    return Failure(
        "PLANNING_FAILED",
        f"the tool can be led along {100.0 * found.fraction:.4g} % of its motion only: "
        f"{found.stop.message}",
        _HINTS[found.stop.reason],
        "cartesian",
        details=stopped,
    )


_HINTS = {
    "limit": "Start in another branch, or turn the tool elsewhere. allow_partial answers what "
    "can be done.",
    "singularity": "Start in another branch, or lead the tool past it. allow_partial answers what "
    "can be done.",
    "unreachable": "Bring the end nearer. allow_partial answers what can be done.",
    "branch": "Start in the branch of other_joints, or ask for planner auto, which may leave the "
    "line. allow_partial answers what can be done.",
    "collision": "Move what is in the way, or lead the tool round it. allow_partial answers what "
    "can be done.",
    "deviation": "Allow a larger max_deviation. allow_partial answers what can be done.",
}


def _check_end(chain: Chain, goal: JointGoal | PoseGoal, T_end: Array) -> None:
    if isinstance(goal, PoseGoal):
        target, allowed = goal.T_base_tip, (goal.position_tolerance, goal.orientation_tolerance)
    else:
        target, allowed = forward(chain, goal.joints), _SAME_POSE
    away = float(np.linalg.norm(target[:3, 3] - T_end[:3, 3]))
    turned = float(np.linalg.norm(rotation_error(T_end[:3, :3], target[:3, :3])))
    if away > allowed[0] or turned > allowed[1]:
        raise InvalidGoal(
            f"the last motion ends {away:.6g} m and {turned:.6g} rad from the goal",
            hint="Give the same pose for both.",
            position_error=away,
            orientation_error=turned,
        )


def _place(chain: Chain, found: ToolPath, q: Array) -> dict[str, Any]:
    """How far the tool came, as values."""
    T = forward(chain, q)
    pose = {
        "position": T[:3, 3].tolist(),
        "quaternion_xyzw": to_quaternion(T[:3, :3]).tolist(),
    }
    last = found.followed[-1]
    return {
        "fraction": found.fraction,
        "motion": len(found.followed) - 1,
        "motion_fraction": 1.0 if last.stop is None else last.reached,
        "nearest": {"joints": q.tolist(), "pose": pose},
    }


def _stopped(chain: Chain, found: ToolPath) -> dict[str, Any]:
    assert found.stop is not None
    place = _place(chain, found, found.followed[-1].end)
    told = {"reason": found.stop.reason, "message": found.stop.message}
    return {**place, **told, **found.stop.details}


# ----------------------------------------------------------------------------------- timing


def _time_and_prove(
    problem: Problem,
    found: ToolPath,
    tolerances: Tolerances,
    law: TimeParametrization,
    stages: Stages,
    deadline: Deadline,
) -> tuple[Trajectory, Certificate, tuple[ToolMotionReport, ...]] | Failure:
    chain = problem.robot.chain
    parts = stages.run(
        "timing",
        lambda: [_timed(chain, m, f, tolerances, law) for m, f in _moving(found)],
        lambda parts: (True, f"{sum(part.duration for part in parts):.3f} s."),
    )
    motion = concatenate(parts) if parts else stay(chain.joint_names, found.followed[0].start)
    certificate = stages.run(
        "certificate",
        lambda: _proved(problem, found, parts, motion, tolerances, law, deadline),
        _tell_certificate,
    )
    if certificate.verified:
        return motion, certificate, _reports(found, parts)
    violation = certificate.violation
    assert violation is not None
    return Failure(
        code="TIMED_OUT" if deadline.passed else "INVALID_MOTION_PLAN",
        message=f"the motion that was found could not be proved: {violation.message}",
        hint="Lead the tool elsewhere, or widen the constraint."
        if violation.kind == "path_constraint"
        else "Allow more time, a larger max_deviation, or a smaller margin.",
        stage="certificate",
        details={"kind": violation.kind, "time": violation.time, **violation.details},
    )


def _moving(found: ToolPath) -> list[tuple[ToolMotion, Followed]]:
    """The motions in which the joints move."""
    pairs = zip(found.motions, found.followed, strict=True)
    return [(motion, followed) for motion, followed in pairs if followed.path is not None]


def _timed(
    chain: Chain,
    motion: ToolMotion,
    followed: Followed,
    tolerances: Tolerances,
    law: TimeParametrization,
) -> Trajectory:
    """One motion in time, from rest to rest."""
    path = followed.path
    assert path is not None
    if law.method != "spline":
        return law.time(path, chain.joint_names).trajectory
    places = path.breaks
    for _ in range(_DENSER):
        timed = law.time_spline(path.sample(places), None, "clamped", chain.joint_names).trajectory
        _, fine, _ = piece_deviations(
            chain, timed.breaks, timed.coefficients, motion, tolerances.pair
        )
        if fine.all():
            break
        places = np.sort(np.concatenate([places, 0.5 * (places[1:] + places[:-1])]))
    return timed


def _proved(
    problem: Problem,
    found: ToolPath,
    parts: Sequence[Trajectory],
    whole: Trajectory,
    tolerances: Tolerances,
    law: TimeParametrization,
    deadline: Deadline,
) -> Certificate:
    certificate = certify(
        whole, problem.robot, problem.scene, margin=problem.margin,
        limits=_bounds(law, parts), loads=law.loads, constraints=problem.constraints,
        deadline=deadline,
    )  # fmt: skip
    motions = [motion for motion, _ in _moving(found)]
    deviation = path_deviation(problem.robot.chain, motions, parts, tolerances)
    certificate = replace(certificate, path_deviation=deviation)
    if deviation.verified or certificate.violation is not None:
        return certificate
    message = f"the tool is {deviation.position:.6g} m off its motion"
    if deviation.orientation is not None:
        message += f", or turned off it by {deviation.orientation:.6g} rad"
    details = {"position": deviation.position, "orientation": deviation.orientation}
    violation = Violation("path_deviation", deviation.time, message, details)
    return replace(certificate, verified=False, violation=violation)


def _bounds(law: TimeParametrization, parts: Sequence[Trajectory]) -> dict[str, Array]:
    """The limits of a law; splines of time, one after the other, can't hold a jerk limit."""
    bounds = law.bounds
    if law.method == "spline" and len(parts) > 1:
        bounds.pop("jerk", None)
    return bounds


def path_deviation(
    chain: Chain,
    motions: Sequence[ToolMotion],
    parts: Sequence[Trajectory],
    tolerances: Tolerances,
) -> PathDeviation:
    """How far a robot's tool is off lines and arcs, bounded for every instant.

    Args:
        chain: The robot; its tip is the tool.
        motions: What the tool is to do, in turn.
        parts: What the joints do meanwhile, one trajectory each.
        tolerances: What is allowed.
    """
    begins, worst, when, verified = 0.0, np.zeros(2), 0.0, True
    highest = -1.0
    for motion, part in zip(motions, parts, strict=True):
        bounds, fine, where = piece_deviations(
            chain, part.breaks, part.coefficients, motion, tolerances.pair
        )
        shares = (bounds / np.array(tolerances.pair)).max(axis=1)
        k = int(np.argmax(shares))
        if shares[k] > highest:
            highest, when = float(shares[k]), begins + float(where[k])
        worst = np.maximum(worst, bounds.max(axis=0))
        verified = verified and bool(fine.all())
        begins += part.duration
    free = tolerances.orientation is None
    return PathDeviation(
        position=float(worst[0]),
        orientation=None if free else float(worst[1]),
        verified=verified,
        time=when,
        max_position=tolerances.position,
        max_orientation=tolerances.orientation,
    )


def _tell_certificate(certificate: Certificate) -> tuple[bool, str]:
    if certificate.violation is not None:
        return False, certificate.violation.message
    deviation = certificate.path_deviation
    assert deviation is not None
    return True, f"The tool is within {deviation.position:.3g} m of its motion."


def _reports(found: ToolPath, parts: Sequence[Trajectory]) -> tuple[ToolMotionReport, ...]:
    times = iter(parts)
    reports, now = [], 0.0
    for motion, followed in zip(found.motions, found.followed, strict=True):
        then = now + (0.0 if followed.path is None else next(times).duration)
        reached = 1.0 if followed.stop is None else followed.reached
        reports.append(
            ToolMotionReport(motion.kind, motion.length, motion.angle, reached, now, then)
        )
        now = then
    return tuple(reports)
