"""How to plan: which planner, which timing, how long, which seed."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from planning.optimize.options import RefineOptions
from planning.timing.parametrization import METHODS, Method

Interpolation = Literal["linear", "natural_spline", "clamped_spline"]
INTERPOLATIONS: tuple[Interpolation, ...] = ("linear", "natural_spline", "clamped_spline")

#: Least deviation of the tool that can be asked for [m], [rad]: inverse kinematics and the bounds
#: have three digits to spare below it.
LEAST_DEVIATION = 1e-7
#: Longest a single plan may take [s].
MAX_TIMEOUT = 600.0


@dataclass(frozen=True, slots=True, eq=False)
class Payload:
    """A rigid load.

    Args:
        mass: [kg].
        center_of_mass: In the link's frame, shape (3,) [m].
        inertia: About the centre of mass, shape (3, 3) [kg m^2]; None for a point.
        link: What carries it; the tip where none is named.
    """

    mass: float
    center_of_mass: Sequence[float] = (0.0, 0.0, 0.0)
    inertia: Sequence[Sequence[float]] | None = None
    link: str | None = None


@dataclass(frozen=True, slots=True, eq=False)
class TimingOptions:
    """How the path is timed.

    Args:
        method: "toppra", "spline" or "jerk_limited".
        velocity_scaling: Share of the velocity limits to use, in (0, 1].
        acceleration_scaling: Share of the acceleration limits to use, in (0, 1].
        jerk_scaling: Share of the jerk limits to use, in (0, 1].
        times: At the waypoints, for "spline" [s].
        scale_times: Whether they are stretched by the least factor that keeps all limits.
        interpolation: Between waypoints, "linear", "natural_spline" or "clamped_spline"; None
            leaves it to the method.
        blend_tolerance: How far corners may be cut, Euclidean in joint space; None for as far as
            can be proved, or not at all where nothing is proved.
        torque_limits: Whether torques are limited too.
        payload: What is carried, for torques.
        tool_speed: Largest speed of the tip [m/s].
        start_velocity: At the start, along the path, shape (n,).
        end_velocity: At the end, along the path, shape (n,).

    Raises:
        InvalidOption: An unknown method or interpolation, a share outside (0, 1], or an option
            that does not go with the method.
    """

    method: Method = "toppra"
    velocity_scaling: float = 1.0
    acceleration_scaling: float = 1.0
    jerk_scaling: float = 1.0
    times: Sequence[float] | None = None
    scale_times: bool = False
    interpolation: Interpolation | None = None
    blend_tolerance: float | None = None
    torque_limits: bool = False
    payload: Payload | None = None
    tool_speed: float | None = None
    start_velocity: Sequence[float] | None = None
    end_velocity: Sequence[float] | None = None

    def __post_init__(self) -> None:
        for name in ("velocity_scaling", "acceleration_scaling", "jerk_scaling"):
            if not 0.0 < getattr(self, name) <= 1.0:
                raise InvalidOption(f"timing.{name} must be in (0, 1]")
        for name, choices in (("method", METHODS), ("interpolation", (None, *INTERPOLATIONS))):
            if getattr(self, name) not in choices:
                known = [choice for choice in choices if choice is not None]
                raise InvalidOption(
                    f"there is no timing.{name} {getattr(self, name)!r}",
                    hint=f"Choose one of: {', '.join(known)}.",
                )
        spline = self.method == "spline"
        if spline and self.interpolation == "linear":
            raise InvalidOption(
                "the timing method spline does not go with linear interpolation",
                hint="Choose natural_spline or clamped_spline, or another method.",
            )
        for name, given in (("times", self.times is not None), ("scale_times", self.scale_times)):
            if given and not spline:
                raise InvalidOption(
                    f"timing.{name} belongs to the method spline, not {self.method}",
                    hint="Ask for the method spline, or leave it out.",
                )


@dataclass(frozen=True, slots=True, eq=False)
class ToolMotionOptions:
    """One motion of the tool, as it is asked for.

    Args:
        kind: "lin" or "circ".
        T_base_tip: Where it ends, shape (4, 4).
        via: Point on an arc, shape (3,) [m].
        center: Of an arc, shape (3,) [m].
        normal: Axis that the arc turns about by the right hand, with ``center``, shape (3,).
    """

    kind: Literal["lin", "circ"]
    T_base_tip: Array
    via: Sequence[float] | None = None
    center: Sequence[float] | None = None
    normal: Sequence[float] | None = None

    def __post_init__(self) -> None:
        if self.kind == "lin" and not (self.via is self.center is self.normal is None):
            raise InvalidOption("via, center and normal belong to motions of type circ")
        if self.kind == "circ" and (self.via is None) == (self.center is None):
            raise InvalidOption(
                "a motion of type circ needs via or center",
                hint="Give a point on the way, or the centre.",
            )
        if self.normal is not None and self.center is None:
            raise InvalidOption("normal goes with center: via says which way round")


@dataclass(frozen=True, slots=True, eq=False)
class CartesianOptions:
    """How the tool is led along lines and arcs.

    Args:
        motions: In order; none for one line to the goal.
        max_deviation: Of the tool's origin from its motion, for every instant [m].
        max_orientation_deviation: Of its orientation from that at the same place [rad].
        orientation: "slerp" about an axis that keeps still, or "free": only the origin is led.
        allow_partial: Whether a motion that ends early is an answer too.

    Raises:
        InvalidOption: A deviation is out of its range.
    """

    motions: tuple[ToolMotionOptions, ...] = ()
    max_deviation: float = 1e-4
    max_orientation_deviation: float = 1e-3
    orientation: Literal["slerp", "free"] = "slerp"
    allow_partial: bool = False

    def __post_init__(self) -> None:
        for name in ("max_deviation", "max_orientation_deviation"):
            if not LEAST_DEVIATION <= getattr(self, name) <= 1.0:
                raise InvalidOption(
                    f"planner_options.{name} must be from {LEAST_DEVIATION:g} to 1",
                    hint="Metres and radians; a tenth of a millimetre is a usual one.",
                )


@dataclass(frozen=True, slots=True)
class Options:
    """How a problem is planned.

    Args:
        planner: "auto" (the ladder) or the name of one planner.
        planner_options: Its parameters, by name.
        cartesian: Those of the planner "cartesian".
        timing: How the path is timed.
        limits: Joint limits (n,) in place of the robot's, by quantity.
        timeout: Seconds for all stages together.
        seed: Of everything random; the same seed gives the same answer.
        observer: Called with the name of each stage as it begins.
        refine: How the motion that was found is optimised; None for not at all.

    Raises:
        InvalidOption: The timeout is not in (0, 600].
    """

    planner: str = "auto"
    planner_options: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    cartesian: CartesianOptions = field(default_factory=CartesianOptions)
    timing: TimingOptions = field(default_factory=TimingOptions)
    limits: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    timeout: float = 5.0
    seed: int = 0
    observer: Callable[[str], None] | None = field(default=None, repr=False, compare=False)
    refine: RefineOptions | None = None

    def __post_init__(self) -> None:
        if not 0.0 < self.timeout <= MAX_TIMEOUT:
            raise InvalidOption(f"timeout must be in (0, {MAX_TIMEOUT:g}] seconds")
