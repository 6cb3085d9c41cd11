"""Timing of paths: requests and answers."""

from pydantic import ConfigDict, Field

from armwright_client.base import (
    Answer,
    Positive,
    Request,
    Rows,
    Vector,
)
from armwright_client.certificate import Certificate, LimitValues
from armwright_client.plan import Timing
from armwright_client.timing import TimingReport
from armwright_client.trajectory import TimedTrajectory


class RetimePath(Request):
    """Points in joint space, with the times of a spline if there are any [s]."""

    joints: Rows
    knots: Vector | None = None
    joint_names: list[str] | None = None


class RetimeTiming(Timing):
    """Options of the timing of given points.

    Args:
        start_velocity: At the start, along the path; at rest if left out.
        end_velocity: At the end, likewise.
    """

    start_velocity: Vector | None = None
    end_velocity: Vector | None = None


class JointState(Request):
    """State of all joints.

    Args:
        position: [rad or m].
        velocity: At rest if left out [rad/s or m/s].
        acceleration: Zero if left out [rad/s^2 or m/s^2].
    """

    position: Vector
    velocity: Vector | None = None
    acceleration: Vector | None = None


class RetimeRequest(Request):
    """A path, or two states, to be timed within a robot's limits or those given."""

    model_config = ConfigDict(serialize_by_alias=True, validate_by_name=True)

    path: RetimePath | None = None
    start: JointState | None = Field(None, alias="from")
    end: JointState | None = Field(None, alias="to")
    joint_names: list[str] | None = None
    synchronization: str | None = None
    robot: str | None = None
    limits: LimitValues | None = None
    timing: RetimeTiming | None = None
    timeout: Positive | None = None


class Retimed(Answer):
    """A timed motion, and what was proved of its limits.

    Args:
        status: "success", or "unverified" where the certificate is not verified.
        trajectory: The motion.
        certificate: Of its limits alone; not verified where times that were given break them.
        factor: Times that were given were stretched by this.
        needed_factor: Times have to be stretched by this for all limits to hold; 1 if they do,
            None where no stretching cures what is wrong.
        timing: Method and limits that it was timed by.
        notes: What is special about the path.
        peaks: Exact largest |velocity|, |acceleration| and |jerk| of each joint.
    """

    status: str
    trajectory: TimedTrajectory
    certificate: Certificate
    factor: float
    needed_factor: float | None
    timing: TimingReport | None = None
    notes: list[str] = Field(default_factory=list)
    peaks: dict[str, list[float]] = Field(default_factory=dict)
