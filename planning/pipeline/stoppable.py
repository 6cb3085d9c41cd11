"""Stage that proves the stops of a motion, slowed down until they are.

Braking distances fall with the square of the speed.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

from kinematics.trajectory.trajectory import Trajectory
from planning.options import Options
from planning.problem import Problem
from planning.proof.certificate import Certificate
from planning.result import Failure
from planning.stops.certificate import StopCertificate, Surroundings, certify_stops
from planning.values.deadline import Deadline
from planning.values.limits import MotionLimits

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
