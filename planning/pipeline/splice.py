"""Splices: motions that leave another one while the arm runs it, or that one's stop.

The new motion begins with the position, velocity and acceleration that the old one has there, and
is proved together with what is run of the old one before.
"""

from dataclasses import dataclass, replace

import numpy as np

from kinematics.errors import InvalidOption
from kinematics.trajectory.trajectory import Trajectory, concatenate
from planning.options import Options
from planning.pipeline.stoppable import surroundings
from planning.problem import Problem
from planning.proof.certificate import certify
from planning.result import Failure, Path, Plan
from planning.stops.certificate import stop_motion

#: Name of the stage whose motion the stop is.
STOP = "stop"


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
        rates = [self.motion.sample([self.at], order)[0] for order in range(3)]
        return replace(
            problem, start=rates[0], start_velocity=rates[1], start_acceleration=rates[2]
        )

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
            held = replace(around.limits, holds_jerk=False)
            proof = certify(
                concatenate(whole), around.robot, around.scene, margin=around.margin, limits=held
            )
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
            return answer if isinstance(answer, Failure) else _unproved(reason)
        note = (
            f"no new motion was proved ({reason}): this is the stop of the motion that the arm "
            f"runs, from {self.at:.6g} s on"
        )
        path = Path(np.stack([stop.trajectory.start, stop.trajectory.end]))
        return Plan(STOP, answer.stages, path, stop.trajectory, stop.certificate, (note,))


def _unproved(reason: str) -> Failure:
    return Failure(
        "INVALID_MOTION_PLAN",
        f"neither a new motion nor the stop of the old one is proved: {reason}",
        "Look at what has changed in the scene since the old motion was planned.",
        STOP,
    )
