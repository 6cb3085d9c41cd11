"""Timing methods: each finds a motion in time along a given path."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import ClassVar, NamedTuple

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from planning.timing.jerk.jerk_limited import time_path_with_jerk
from planning.timing.options import TOPPRA_SOLVERS, Method, Solver
from planning.timing.path.path import JointPath
from planning.timing.speed.effort_limits import effort_rows, slow_down
from planning.timing.speed.minimum_time import time_path
from planning.timing.time_scaling import ScaledTime, slowed_at_ends
from planning.values.limits import EffortLimits

_SLOWED = "toppra's answer was slowed down"
_REASON = "to bring it inside the limits between its grid points."


class JerkUse(Enum):
    """Use that a method makes of jerk limits."""

    REQUIRED = "required"
    RULED = "where known, else by rule"
    WHERE_KNOWN = "where known"
    UNUSED = "unused"


class PathLimits(NamedTuple):
    """Limits that a path is timed within.

    Args:
        velocity: Shape (n,), inf where there is none [rad/s or m/s].
        acceleration: Shape (n,) [rad/s^2 or m/s^2].
        jerk: Shape (n,); None where jerk is not limited [rad/s^3 or m/s^3].
        effort: Limits of torque and tool speed.
    """

    velocity: Array
    acceleration: Array
    jerk: Array | None = None
    effort: EffortLimits | None = None


class TimingMethod:
    """A method by which paths become motions.

    Attributes:
        name: The method's name in options.
        jerk: Use that it makes of jerk limits.
        smooth: Whether corners have to be rounded by curves of continuous curvature.
        follows_path: Whether the motion keeps exactly to the path that it is given.
        solver: Solver of the speeds, where there is a choice.
        near_path: Whether a spline near the path is tried where it is proved free.
    """

    name: ClassVar[Method]
    jerk: JerkUse
    smooth: ClassVar[bool] = False
    follows_path: ClassVar[bool] = True
    solver: Solver | None = None
    near_path: bool = False

    def time(
        self,
        path: JointPath,  # noqa: ARG002  for those that do
        joint_names: Sequence[str],  # noqa: ARG002
        limits: PathLimits,  # noqa: ARG002
        end_speeds: tuple[float, float],  # noqa: ARG002
    ) -> ScaledTime:
        """The path run through as fast as the limits allow.

        Args:
            path: Path to follow.
            joint_names: n names.
            limits: Limits of the motion.
            end_speeds: ds/dt at the start and at the end.

        Raises:
            InvalidOption: A limit is malformed, or the method does not follow paths.
            TimingFailed: There is no such motion, or none was found.
        """
        raise InvalidOption(
            f"the timing method {self.name} does not follow paths",
            hint="Choose toppra or jerk_limited.",
        )

    def notes(self, parts: Sequence[ScaledTime]) -> tuple[str, ...]:  # noqa: ARG002
        """Notes for whoever asked, about the motions that this method made."""
        return ()


@dataclass(frozen=True, slots=True)
class TimeOptimal(TimingMethod):
    """The least time within limits of velocity and acceleration (TOPP-RA).

    Args:
        solver: Solver of the speeds along the path.
    """

    solver: Solver = "reachability"
    jerk: JerkUse = JerkUse.UNUSED

    name: ClassVar[Method] = "toppra"

    def time(
        self,
        path: JointPath,
        joint_names: Sequence[str],
        limits: PathLimits,
        end_speeds: tuple[float, float],
    ) -> ScaledTime:
        """See ``TimingMethod.time``."""
        return time_path(
            path,
            joint_names,
            limits.velocity,
            limits.acceleration,
            solver=self.solver,
            end_speeds=end_speeds,
            loads=limits.effort,
        )

    def notes(self, parts: Sequence[ScaledTime]) -> tuple[str, ...]:
        """Notes on how much the toppra package's answers were slowed down."""
        if self.solver != "toppra" or not parts:
            return ()
        duration = sum(part.trajectory.duration for part in parts)
        answered = sum(part.trajectory.duration / part.factor for part in parts)
        # A motion slowed down by less than this part was not slowed down but for rounding [-].
        if duration <= answered * (1.0 + 1e-9):
            return ("toppra's answer keeps all limits between its grid points too.",)
        percent = 100.0 * (duration / answered - 1.0)
        seconds = duration - answered
        return (f"{_SLOWED} by {percent:.3g} % ({seconds:.3g} s) {_REASON}",)


@dataclass(frozen=True, slots=True)
class JerkLimited(TimingMethod):
    """Limits of velocity, acceleration and jerk: on the path little more than the least time.

    Args:
        near_path: Whether a spline near the path is tried where it is proved free.
        jerk: Use of jerk limits: required, or by rule where they are not known.
    """

    near_path: bool = False
    jerk: JerkUse = JerkUse.REQUIRED
    solver: Solver = field(default="interior_point", init=False)

    name: ClassVar[Method] = "jerk_limited"
    smooth: ClassVar[bool] = True

    def time(
        self,
        path: JointPath,
        joint_names: Sequence[str],
        limits: PathLimits,
        end_speeds: tuple[float, float],
    ) -> ScaledTime:
        """See ``TimingMethod.time``."""
        assert limits.jerk is not None
        bounds, effort = (limits.velocity, limits.acceleration, limits.jerk), limits.effort
        extra = None if effort is None else effort_rows(effort)
        return slowed_at_ends(
            lambda speeds: time_path_with_jerk(
                path, joint_names, *bounds, end_speeds=speeds, extra=extra
            ),
            lambda made: made if effort is None else slow_down(effort, made),
            end_speeds,
        )


@dataclass(frozen=True, slots=True)
class SplineInTime(TimingMethod):
    """A cubic spline of time through waypoints; between them it leaves the path."""

    jerk: JerkUse = JerkUse.WHERE_KNOWN

    name: ClassVar[Method] = "spline"
    follows_path: ClassVar[bool] = False


def timing_method(name: Method | None, solver: Solver | None = None) -> TimingMethod:
    """The method of a name.

    Args:
        name: Name as in ``TimingOptions.method``.
        solver: Solver as in ``TimingOptions.solver``.
    """
    if name == "toppra" or solver in TOPPRA_SOLVERS:
        return TimeOptimal(solver or "reachability")
    if name == "spline":
        return SplineInTime()
    if solver is None and name is not None:
        return JerkLimited()
    return JerkLimited(solver in {None, "quintic_spline"}, JerkUse.RULED)
