"""Motions that begin while the arm moves, and stops that are proved of a motion.

A motion is slowed down until its stops are proved: braking distances fall with the square of the
speed.

Planners that begin at rest have it brake first: every joint by itself as quickly as its limits
allow, which leaves the state with equal position, velocity and acceleration; the planned motion
begins where the arm has come to rest. Both are proved as one motion. A splice leaves another motion
while the arm runs it, with its state there, or is that one's stop; it is proved together with what
is run of the old one before.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from kinematics.errors import InvalidOption
from kinematics.trajectory.trajectory import Trajectory, concatenate
from planning.options import Options
from planning.problem import JointGoal, Problem
from planning.proof.certificate import Certificate, certify, with_path
from planning.result import Failure, Path, Plan
from planning.retiming.simplify import motion_waypoints
from planning.stops.braking import BrakingLimits
from planning.stops.certificate import StopCertificate, Surroundings, certify_stops, stop_motion
from planning.stops.stop_family import braking_motion, state_at
from planning.values.deadline import Deadline
from planning.values.limits import MotionLimits
from planning.values.optimize_options import OPTIMIZE

#: Name of the stage whose motion the stop is.
STOP = "stop"
#: Note on motions that leave the path that a planner found.
OWN_PATH = "the motion leaves the path that was found: path.joints has few of its own waypoints"


def brakes_first(problem: Problem, options: Options) -> bool:
    """Whether a motion begins while the arm moves, and its planner begins at rest."""
    begun = (problem.start_velocity, problem.start_acceleration)
    ends = [goal for goal in problem.goals if isinstance(goal, JointGoal)]
    return (
        any(rates is not None and rates.any() for rates in begun)
        and not any(one is not None for goal in ends for one in (goal.velocity, goal.acceleration))
        and options.refine is None
        and options.planner not in (OPTIMIZE, "cartesian")
        and options.timing.duration is None
        and options.timing.times is None
    )


def plan_braking(
    problem: Problem,
    options: Options,
    around: Surroundings,
    limits: MotionLimits,
    plan: Callable[[Problem], Plan | Failure],
) -> Plan | Failure:
    """Plan from where the arm comes to rest, and prove the motion with the braking before it.

    Args:
        problem: The problem, whose start moves.
        options: Planner, timing and stops.
        around: What stops are proved for.
        limits: Limits that the motion is proved within.
        plan: Plans a problem whose start is at rest.

    Raises:
        MissingLimit: The acceleration of a joint has no limit.
    """
    chain = problem.robot.chain
    still = np.zeros(chain.n)
    given = (problem.start_velocity, problem.start_acceleration)
    state = np.stack([problem.start, *(still if rates is None else rates for rates in given)])
    braking = braking_motion(
        chain.joint_names, state, BrakingLimits.of(chain.limits, chain.joint_names, limits)
    )
    rest = replace(problem, start=braking.end, start_velocity=None, start_acceleration=None)
    planned = plan(rest)
    if isinstance(planned, Failure):
        return planned
    motion = concatenate([braking, planned.trajectory])
    proof = certify(
        motion,
        problem.robot,
        problem.scene,
        margin=problem.margin,
        limits=limits,
        constraints=problem.constraints,
    )
    path, within, notes = planned.path, options.path_tolerance, planned.notes
    if within is not None:
        path = Path(np.concatenate([motion_waypoints(braking, within), path.waypoints]))
        proof, notes = with_path(proof, motion, path.waypoints, within), (*notes, OWN_PATH)
    if proof.violation is not None:
        return Failure(
            "INVALID_MOTION_PLAN",
            f"the arm moves at the start, and braking to rest is not proved: "
            f"{proof.violation.message}",
            'Start slower or farther away, or ask for the planner "optimize".',
            "moving_start",
            planned.stages,
            {"time": proof.violation.time, **proof.violation.details},
        )
    stops = planned.stops
    if stops is not None and options.stops != "none":
        stops = replace(certify_stops(motion, proof, around, options.stops), slowed=stops.slowed)
        if not stops.proved:
            hint = "Start slower, or ask for stops along the path alone."
            return Failure("INVALID_MOTION_PLAN", stops.message, hint, "stops")
    note = f"the arm moves at the start: it brakes to rest within {braking.duration:.3g} s first"
    return replace(
        planned, path=path, trajectory=motion, certificate=proof, stops=stops, notes=(*notes, note)
    )


@dataclass(frozen=True, slots=True)
class Splice:
    """The place at which a motion is left.

    Args:
        motion: The motion that the arm runs; it ends at rest.
        at: Instant of it at which the new one begins [s].

    Raises:
        InvalidOption: The instant is outside the motion.
    """

    motion: Trajectory
    at: float

    def __post_init__(self) -> None:
        if not 0.0 <= self.at <= self.motion.duration:
            raise InvalidOption(
                f"start.at is {self.at:g} s, outside the motion of the plan",
                hint=f"Give an instant from 0 to {self.motion.duration:.9g} s.",
            )

    def begins(self, problem: Problem) -> Problem:
        """A problem with the state of the motion there in place of its start."""
        q, qd, qdd = state_at(self.motion, self.at)
        return replace(problem, start=q, start_velocity=qd, start_acceleration=qdd)

    def join(self, answer: Plan | Failure, problem: Problem, options: Options) -> Plan | Failure:
        """The plan, proved together with the motion before it; else the stop of that motion.

        Args:
            answer: What planning came to.
            problem: The problem, with the state of the motion as its start.
            options: Its options.
        """
        around, reason = surroundings(problem, options), ""
        if isinstance(answer, Plan):
            before = self.motion.split(self.at)[0] if 0.0 < self.at < self.motion.duration else None
            whole = [answer.trajectory] if before is None else [before, answer.trajectory]
            # A motion led as splines are keeps no jerk, which its own certificate tells.
            proof = around.certify(concatenate(whole), holds_jerk=False)
            if proof.violation is None:
                note = (
                    f"proved together with the motion that it leaves at {self.at:.6g} s: "
                    f"clearance {proof.min_clearance:.6g} m"
                )
                return replace(answer, notes=(*answer.notes, note))
            reason = proof.violation.message
        else:
            reason = answer.message
        stop = stop_motion(self.motion, around, self.at, "path")
        if not stop.certificate.verified:
            if isinstance(answer, Failure):
                return answer
            message = f"neither a new motion nor the stop of the old one is proved: {reason}"
            hint = "Look at what has changed in the scene since the old motion was planned."
            return Failure("INVALID_MOTION_PLAN", message, hint, STOP)
        note = (
            f"no new motion was proved ({reason}): this is the stop of the motion that the arm "
            f"runs, from {self.at:.6g} s on"
        )
        path, proof = np.stack([stop.trajectory.start, stop.trajectory.end]), stop.certificate
        if options.path_tolerance is not None:
            path = motion_waypoints(stop.trajectory, options.path_tolerance)
            proof = with_path(proof, stop.trajectory, path, options.path_tolerance)
        return Plan(STOP, answer.stages, Path(path), stop.trajectory, proof, (note,))


#: Times as long as it was that a motion is made at most.
_MOST_SLOWED = 16.0
#: Factors of time are found within this share of them.
_WITHIN = 0.02
#: Limits that stops are held to.
_BRAKING = ("velocity", "acceleration", "jerk")


@dataclass(frozen=True, slots=True)
class Stoppable:
    """A motion with its proof and that of its stops.

    Args:
        trajectory: The motion.
        certificate: Its proof.
        stops: The proof of its stops.
    """

    trajectory: Trajectory
    certificate: Certificate
    stops: StopCertificate


def surroundings(problem: Problem, options: Options) -> Surroundings:
    """Robot, scene, margin and limits that the stops of a plan are proved for.

    Joints brake at the robot's limits or those of the request, whatever the scaling of the motion.
    """
    bounds = {name: row for name, row in options.limits.items() if name in _BRAKING}
    return Surroundings(problem.robot, problem.scene, problem.margin, MotionLimits(bounds))


def with_stops(
    motion: tuple[Trajectory, Certificate],
    around: Surroundings,
    options: Options,
    deadline: Deadline,
    prove: Callable[[Trajectory], Certificate] | None,
) -> Stoppable | Failure:
    """The motion, slowed down as little as its stops need, or why they are not proved.

    Args:
        motion: The motion and its proof.
        around: Robot, scene, margin and limits.
        options: Kind of stops.
        deadline: Instant at which the proofs are given up.
        prove: Proof of a slower motion; None where it can't be slowed down.

    Raises:
        MissingLimit: The acceleration of a joint has no limit.
    """

    def attempt(trajectory: Trajectory, certificate: Certificate) -> Stoppable:
        stops = certify_stops(trajectory, certificate, around, options.stops, deadline)
        longer = trajectory.duration - motion[0].duration
        return Stoppable(trajectory, certificate, replace(stops, slowed=longer))

    known = attempt(*motion)
    if known.stops.proved:
        return known
    found = known if prove is None else _slow_down(known, prove, attempt)
    return found if found.stops.proved else _failure(known.stops, deadline, prove is not None)


def _slow_down(
    known: Stoppable,
    prove: Callable[[Trajectory], Certificate],
    attempt: Callable[[Trajectory, Certificate], Stoppable],
) -> Stoppable:
    """The least slowed of the motions tried whose stops are proved; the known one if none is."""

    def slower(factor: float) -> Stoppable:
        slow = known.trajectory.dilate(factor)
        return attempt(slow, prove(slow))

    low, high, best = 1.0, 1.0, known
    while not best.stops.proved:
        low, high = high, min(1.25 * high * high, _MOST_SLOWED)
        if best.stops.late or low >= _MOST_SLOWED:
            return known
        best = slower(high)
    while high > low * (1.0 + _WITHIN):
        middle = (low * high) ** 0.5
        tried = slower(middle)
        if tried.stops.late:
            break
        low, high, best = (low, middle, tried) if tried.stops.proved else (middle, high, best)
    return best


def _failure(stops: StopCertificate, deadline: Deadline, slowed: bool) -> Failure:
    tried = f"up to {_MOST_SLOWED:g} times as slow" if slowed else "and can't be slowed down"
    pair = None if stops.worst.pair is None else list(stops.worst.pair)
    hint = "Allow more time, a smaller margin, or ask for stops along the path alone."
    if not slowed:
        hint = "Lower timing.velocity_scaling, or ask for stops along the path alone."
    return Failure(
        code="TIMED_OUT" if deadline.passed else "INVALID_MOTION_PLAN",
        message=f"the motion that was found, {tried}, has no proved stops: {stops.message}",
        hint=hint,
        stage="stops",
        details={
            "kind": stops.kind,
            "time": stops.worst.time,
            "after": stops.worst.after,
            "pair": pair,
            "clearance": stops.worst.clearance,
        },
    )
