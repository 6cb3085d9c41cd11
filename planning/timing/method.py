"""Timing methods: by which paths become motions, and what each of them keeps."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from planning.timing.options import TOPPRA_SOLVERS, Method, Solver
from planning.timing.time_scaling import ScaledTime

_SLOWED = "toppra's answer was slowed down"
_REASON = "to bring it inside the limits between its grid points."


class JerkUse(Enum):
    """Use that a method makes of jerk limits."""

    REQUIRED = "required"
    RULED = "where known, else by rule"
    WHERE_KNOWN = "where known"
    UNUSED = "unused"


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
