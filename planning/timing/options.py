"""Options of timing: the method, shares of the limits, what is carried; and its failure."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Literal

from kinematics.errors import ArmwrightError, InvalidOption


class TimingFailed(ArmwrightError):
    """No timing of the path was found: the solver gave up, or its answer was not finite."""

    code: ClassVar[str] = "INVALID_MOTION_PLAN"


Method = Literal["toppra", "spline", "jerk_limited"]
METHODS: tuple[Method, ...] = ("toppra", "spline", "jerk_limited")

#: Method of timing where none is named.
DEFAULT_METHOD: Method = "jerk_limited"

#: Who finds the speeds: for "toppra" our compiled kernels or the toppra package. "jerk_limited" has
#: one method: on the path, or by a spline near it; "double_s" is an older name for the first.
Solver = Literal["reachability", "toppra", "quintic_spline", "double_s", "interior_point"]
TOPPRA_SOLVERS: tuple[Solver, ...] = ("reachability", "toppra")
JERK_SOLVERS: tuple[Solver, ...] = ("quintic_spline", "double_s", "interior_point")
SOLVERS: tuple[Solver, ...] = (*TOPPRA_SOLVERS, *JERK_SOLVERS)

Interpolation = Literal["linear", "natural_spline", "clamped_spline"]
INTERPOLATIONS: tuple[Interpolation, ...] = ("linear", "natural_spline", "clamped_spline")


@dataclass(frozen=True, slots=True, eq=False)
class Payload:
    """A rigid load.

    Args:
        mass: [kg].
        center_of_mass: Position in the link's frame, shape (3,) [m].
        inertia: Inertia about the centre of mass, shape (3, 3) [kg m^2]; None for a point.
        link: Link that carries it; the tip where none is named.
    """

    mass: float
    center_of_mass: Sequence[float] = (0.0, 0.0, 0.0)
    inertia: Sequence[Sequence[float]] | None = None
    link: str | None = None


@dataclass(frozen=True, slots=True, eq=False)
class TimingOptions:
    """Options of the timing.

    Args:
        method: "toppra", "spline" or "jerk_limited"; None for jerk_limited. Jerk limits that are
            not known follow ``planning.timing.choice.JERK_RULE``, unless jerk_limited is named
            without a solver.
        solver: Solver for "toppra": "reachability" (ours) or "toppra" (the package); ours where
            None. For "jerk_limited": "quintic_spline" for fewest pieces, near the path where that
            is proved; "interior_point" (or "double_s", its older name) for the path itself. The
            first where neither method nor solver is named, else the second.
        velocity_scaling: Share of the velocity limits to use, in (0, 1].
        acceleration_scaling: Share of the acceleration limits to use, in (0, 1].
        jerk_scaling: Share of the jerk limits to use, in (0, 1].
        times: Times at the waypoints [s].
        velocities: Velocities at the waypoints beside times, each (n,) or None, for "jerk_limited".
        scale_times: Whether they are stretched by the least factor that keeps all limits.
        interpolation: Interpolation between waypoints, "linear", "natural_spline" or
            "clamped_spline"; None leaves it to the method.
        blend_tolerance: How far corners may be cut, Euclidean in joint space; None for as far as
            can be proved, or not at all where nothing is proved.
        torque_limits: Whether torques are limited too.
        payload: Payload that is carried, for torques.
        tool_speed: Largest speed of the tip [m/s].
        start_velocity: Velocity at the start, along the path, shape (n,).
        end_velocity: Velocity at the end, along the path, shape (n,).
        duration: Duration that the motion is slowed down to [s]; None for the least.
        at_least: Whether a motion that takes longer than the duration may stay as it is.

    Raises:
        InvalidOption: An unknown method or interpolation, a share outside (0, 1], or an option
            that does not go with the method.
    """

    method: Method | None = None
    solver: Solver | None = field(default=None, kw_only=True)
    velocity_scaling: float = 1.0
    acceleration_scaling: float = 1.0
    jerk_scaling: float = 1.0
    times: Sequence[float] | None = None
    velocities: Sequence[Sequence[float] | None] | None = field(default=None, kw_only=True)
    scale_times: bool = False
    interpolation: Interpolation | None = None
    blend_tolerance: float | None = None
    torque_limits: bool = False
    payload: Payload | None = None
    tool_speed: float | None = None
    start_velocity: Sequence[float] | None = None
    end_velocity: Sequence[float] | None = None
    duration: float | None = None
    at_least: bool = False

    def __post_init__(self) -> None:
        for name in ("velocity_scaling", "acceleration_scaling", "jerk_scaling"):
            if not 0.0 < getattr(self, name) <= 1.0:
                raise InvalidOption(f"timing.{name} must be in (0, 1]")
        for name, choices in (
            ("method", (None, *METHODS)),
            ("solver", (None, *SOLVERS)),
            ("interpolation", (None, *INTERPOLATIONS)),
        ):
            if getattr(self, name) not in choices:
                known = [choice for choice in choices if choice is not None]
                raise InvalidOption(
                    f"there is no timing.{name} {getattr(self, name)!r}",
                    hint=f"Choose one of: {', '.join(known)}.",
                )
        solved = "toppra" if self.solver in TOPPRA_SOLVERS else "jerk_limited"
        if self.solver is not None and self.method not in {None, solved}:
            raise InvalidOption(
                f"timing.solver {self.solver} belongs to the method {solved}, not {self.method}",
                hint=f"Ask for the method {solved}, or leave solver out.",
            )
        spline = self.method == "spline"
        if spline and self.interpolation == "linear":
            raise InvalidOption(
                "the timing method spline does not take linear interpolation",
                hint="Choose natural_spline or clamped_spline, or another method.",
            )
        if self.scale_times and not spline:
            raise InvalidOption(
                "timing.scale_times belongs to the method spline, not "
                f"{self.method or DEFAULT_METHOD}",
                hint="Ask for the method spline, or leave it out.",
            )
        if self.times is not None and self.method not in {"spline", "jerk_limited"}:
            raise InvalidOption(
                "timing.times belongs to the methods spline and jerk_limited, not "
                f"{self.method or 'the default'}",
                hint="Name one of them, or leave times out.",
            )
        if self.velocities is not None and (self.times is None or spline):
            raise InvalidOption(
                "timing.velocities belongs to the method jerk_limited with times",
                hint="Give times, or leave velocities out.",
            )
        self._check_duration()

    def _check_duration(self) -> None:
        if self.duration is None:
            if self.at_least:
                raise InvalidOption("timing.at_least needs timing.duration", hint="Give both.")
            return
        if not 0.0 < self.duration < math.inf:
            raise InvalidOption(
                f"timing.duration is {self.duration}", hint="Give a positive number of seconds."
            )
        for name in ("times", "start_velocity", "end_velocity"):
            if getattr(self, name) is not None:
                raise InvalidOption(
                    f"timing.{name} does not go with timing.duration, which slows the motion down",
                    hint="Give one of them.",
                )
