"""Certificate of the stops of a motion: from every instant of it the arm can come to rest.

A single stop is a motion of its own with the proof of any motion.
"""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.model.chain import Limits
from kinematics.trajectory.trajectory import Trajectory
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.proof.certificate import Certificate, certify
from planning.proof.limits.limit_uses import Violation
from planning.proof.limits.limits import QUANTITIES
from planning.stops.braking import BrakingLimits
from planning.stops.family_proof import Worst, prove_family
from planning.stops.path_stops import path_stop, prove_path_stops
from planning.stops.stop_family import StopFamily, joint_stop, state_at
from planning.values.deadline import Deadline
from planning.values.limits import MotionLimits
from planning.values.preferences import StopKind, StopKinds

#: Parts of a motion on which the longest stop with all joints braking is bounded [s].
_PART = 0.01
#: A motion begins in a state that it is no farther than this from [rad or m, and rates].
_SAME_STATE = 1e-6


class Surroundings(NamedTuple):
    """Robot and surroundings that stops are proved for.

    Args:
        robot: The arm with its geometry.
        scene: The obstacles.
        margin: Distance to keep from obstacles beyond their own margins [m].
        limits: Limits of acceleration and jerk to brake at in place of the robot's.
    """

    robot: RobotGeometry
    scene: Scene
    margin: float = 0.0
    limits: MotionLimits = MotionLimits()

    @property
    def braking(self) -> BrakingLimits:
        """Limits that the joints brake at.

        Raises:
            MissingLimit: The acceleration of a joint has no limit.
        """
        chain = self.robot.chain
        return BrakingLimits.of(chain.limits, chain.joint_names, self.limits)

    def certify(
        self, motion: Trajectory, *, holds_jerk: bool = True, deadline: Deadline | None = None
    ) -> Certificate:
        """The proof of a motion here, within these limits.

        Args:
            motion: The motion.
            holds_jerk: Whether jerk is to be kept where the limits say so; else it is only told.
            deadline: Instant at which the proof is given up.
        """
        limits = self.limits if holds_jerk else replace(self.limits, holds_jerk=False)
        return certify(
            motion, self.robot, self.scene, margin=self.margin, limits=limits, deadline=deadline
        )


@dataclass(frozen=True, slots=True)
class StopCertificate:
    """Certificate of the stops of a motion.

    Args:
        kind: "path", "joints" or "both".
        proved: Whether a stop of each kind is proved from every instant.
        worst: The stop that comes nearest to something, or the one at fault; of stops along the
            path alone the longest, whose clearance is that of the motion.
        longest: Bound of the longest time to rest [s]; infinite where no end is known.
        message: Sentence on the fault, "" where there is none.
        slowed: Time that the motion takes longer so that its stops are proved [s].
        late: Whether time was up before all was proved.
    """

    kind: StopKinds
    proved: bool
    worst: Worst = field(default_factory=lambda: Worst(0.0, 0.0, None, np.inf))
    longest: float = np.inf
    message: str = ""
    slowed: float = 0.0
    late: bool = False


def certify_stops(
    trajectory: Trajectory,
    certificate: Certificate,
    around: Surroundings,
    kind: StopKinds,
    deadline: Deadline | None = None,
) -> StopCertificate:
    """Prove that a motion can be stopped at every instant, or say where it can't.

    Args:
        trajectory: The motion.
        certificate: Its own proof: stops of a motion that is not proved are not either.
        around: Robot, scene, margin and limits.
        kind: "path", "joints" or "both".
        deadline: Instant at which the proof is given up.

    Raises:
        InvalidOption: The kind is none of these, or stops leave the path of a motion that was not
            compared with anything.
        MissingLimit: The acceleration of a joint has no limit.
    """
    check_kind(kind)
    braking = around.braking
    along = _along_path(trajectory, certificate, braking)
    if kind == "path" or (not along.proved and (kind == "both" or not certificate.verified)):
        return replace(along, kind=kind)
    if not certificate.proved.collisions:
        raise InvalidOption(
            f"stops {kind!r} leave the path, and nothing is known of collisions of this robot",
            hint='Give the robot solids, look at collisions, or ask for stops "path".',
        )
    family = StopFamily(trajectory, braking)
    margin = max(around.margin, certificate.premises.margin)
    found = prove_family(family, around.robot, around.scene, margin, deadline)
    longest = float(family.durations(family.cells(_PART)).max())
    if kind == "both":
        longest = max(longest, along.longest)
    return StopCertificate(kind, found.proved, found.worst, longest, found.message, late=found.late)


def certify_path_stops(
    trajectory: Trajectory, certificate: Certificate, limits: Limits, wanted: MotionLimits
) -> StopCertificate:
    """Prove that a motion of which limits alone are known can be stopped along its path.

    Args:
        trajectory: The motion.
        certificate: Its proof.
        limits: Limits of its joints.
        wanted: Limits in place of them.

    Raises:
        MissingLimit: The acceleration of a joint has no limit.
    """
    braking = BrakingLimits.of(limits, trajectory.joint_names, wanted)
    return _along_path(trajectory, certificate, braking)


def _along_path(
    trajectory: Trajectory, certificate: Certificate, braking: BrakingLimits
) -> StopCertificate:
    if not certificate.verified:
        time = certificate.violation.time if certificate.violation else 0.0
        worst = Worst(time, 0.0, None, certificate.min_clearance)
        return StopCertificate("path", False, worst, message="the motion itself is not proved")
    found = prove_path_stops(trajectory, braking)
    worst = Worst(found.time, 0.0, certificate.clearance_pair, certificate.min_clearance)
    return StopCertificate("path", found.proved, worst, found.longest, found.message)


def check_kind(kind: str) -> None:
    """Refuse a kind of stops that there is not.

    Raises:
        InvalidOption: It is none of "path", "joints" and "both".
    """
    if kind not in ("path", "joints", "both"):
        raise InvalidOption(
            f"there is no stop of kind {kind!r}", hint='Name "path", "joints" or "both".'
        )


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
    braking = around.braking
    if kind == "joints":
        motion = joint_stop(trajectory, at, braking)
    elif kind == "path":
        found = prove_path_stops(trajectory, braking)
        if not found.proved:
            raise InvalidOption(found.message, hint='Ask for a stop of kind "joints".')
        motion = path_stop(trajectory, at, braking)
    else:
        raise InvalidOption(f"there is no stop of kind {kind!r}", hint="Name path or joints.")
    # A stop along the path keeps limits of velocity and acceleration; its jerk is only told.
    certificate = around.certify(motion, holds_jerk=kind == "joints", deadline=deadline)
    jumps = state_jumps(motion, state_at(trajectory, at)[:2], "where braking begins")
    if jumps:
        certificate = replace(certificate, verified=False, violation=jumps[0])
    return Stop(motion, certificate, kind, at)


def state_jumps(motion: Trajectory, state: Array, where: str) -> list[Violation]:
    """Jumps by which a motion does not begin in a state.

    Args:
        motion: The motion.
        state: Position, velocity and perhaps acceleration, shape (k, n).
        where: Words on the instant, for the message.
    """
    faults = list[Violation]()
    jumps = np.abs(state_at(motion, 0.0)[: len(state)] - state)
    for name, jump in zip(QUANTITIES, jumps, strict=False):
        j = int(jump.argmax())
        if jump[j] > _SAME_STATE:
            joint, size = motion.joint_names[j], float(jump[j])
            message = f"the {name} of joint {joint!r} jumps by {size:.6g} {where}"
            details = {"quantity": name, "joint": joint, "jump": size}
            faults.append(Violation("start", 0.0, message, details))
    return faults
