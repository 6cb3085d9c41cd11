"""A single stop of a motion, as a motion of its own with the proof of any motion."""

from dataclasses import dataclass, replace

from kinematics.errors import InvalidOption
from kinematics.trajectory.trajectory import Trajectory
from planning.proof.certificate import Certificate, certify
from planning.stops.certificate import Surroundings
from planning.stops.path_stops import path_stop, prove_path_stops
from planning.stops.stop_family import joint_stop
from planning.values.deadline import Deadline
from planning.values.preferences import StopKind


@dataclass(frozen=True, slots=True)
class Stop:
    """A stop.

    Args:
        trajectory: The motion to rest; its time counts from the instant at which braking begins.
        certificate: Its proof.
        kind: "path" or "joints".
        at: Instant of the motion that it leaves [s].
    """

    trajectory: Trajectory
    certificate: Certificate
    kind: StopKind
    at: float


def stop_motion(
    trajectory: Trajectory,
    around: Surroundings,
    at: float,
    kind: StopKind = "path",
    deadline: Deadline | None = None,
) -> Stop:
    """The stop of a motion from an instant on, and its proof, which may find a collision.

    Args:
        trajectory: The motion.
        around: Robot, scene, margin and limits.
        at: The instant [s].
        kind: "path" or "joints".
        deadline: Instant at which the proof is given up.

    Raises:
        InvalidOption: The instant is outside the motion, the kind is none of these, or the motion
            ends without rest, so that its path may be too short for a stop.
        MissingLimit: The acceleration of a joint has no limit.
    """
    if not 0.0 <= at <= trajectory.duration:
        raise InvalidOption(
            f"at is {at:g} s, outside the motion",
            hint=f"Give an instant from 0 to {trajectory.duration:.9g} s.",
        )
    braking, limits = around.braking, around.limits
    if kind == "joints":
        motion = joint_stop(trajectory, at, braking)
    elif kind == "path":
        found = prove_path_stops(trajectory, braking)
        if not found.proved:
            raise InvalidOption(found.message, hint='Ask for a stop of kind "joints".')
        motion = path_stop(trajectory, at, braking)
        # A stop along the path keeps limits of velocity and acceleration; its jerk is only told.
        limits = replace(limits, holds_jerk=False)
    else:
        raise InvalidOption(f"there is no stop of kind {kind!r}", hint="Name path or joints.")
    certificate = certify(
        motion, around.robot, around.scene, margin=around.margin, limits=limits, deadline=deadline
    )
    return Stop(motion, certificate, kind, at)
