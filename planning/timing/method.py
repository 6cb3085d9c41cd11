"""Timing methods: each finds a motion in time along a given path."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from planning.timing.jerk.jerk_limited import time_path_with_jerk
from planning.timing.options import TOPPRA_SOLVERS, Method, Solver
from planning.timing.path.path import JointPath
from planning.timing.speed.minimum_time import time_path
from planning.timing.time_scaling import ScaledTime
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


@dataclass(frozen=True, slots=True)
class TimingMethod:
    """A method by which paths become motions.

    Args:
        name: The method's name in options.
        jerk: Use that it makes of jerk limits.
        solver: Solver of the speeds, where there is a choice.
        near_path: Whether a spline near the path is tried where it is proved free.
    """

    name: Method
    jerk: JerkUse
    solver: Solver | None = None
    near_path: bool = False

    @property
    def smooth(self) -> bool:
        """Whether corners have to be rounded by curves of continuous curvature."""
        return self.name == "jerk_limited"

    @property
    def follows_path(self) -> bool:
        """Whether the motion keeps exactly to the path: a spline of time leaves it."""
        return self.name != "spline"

    def time(
        self,
        path: JointPath,
        joint_names: Sequence[str],
        limits: PathLimits,
        end_speeds: tuple[float, float],
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
        if not self.follows_path:
            raise InvalidOption(
                f"the timing method {self.name} does not follow paths",
                hint="Choose toppra or jerk_limited.",
            )
        bounds, loads = (limits.velocity, limits.acceleration), limits.effort
        if self.smooth:
            assert limits.jerk is not None
            return time_path_with_jerk(
                path, joint_names, *bounds, limits.jerk, end_speeds=end_speeds, loads=loads
            )
        solver = self.solver or "reachability"
        return time_path(
            path, joint_names, *bounds, solver=solver, end_speeds=end_speeds, loads=loads
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


def timing_method(name: Method | None, solver: Solver | None = None) -> TimingMethod:
    """The method of a name.

    Args:
        name: Name as in ``TimingOptions.method``.
        solver: Solver as in ``TimingOptions.solver``.
    """
    if name == "toppra" or solver in TOPPRA_SOLVERS:
        return TimingMethod("toppra", JerkUse.UNUSED, solver or "reachability")
    if name == "spline":
        return TimingMethod("spline", JerkUse.WHERE_KNOWN)
    if solver is None and name is not None:
        return TimingMethod("jerk_limited", JerkUse.REQUIRED, "interior_point")
    near = solver in {None, "quintic_spline"}
    return TimingMethod("jerk_limited", JerkUse.RULED, "interior_point", near)
