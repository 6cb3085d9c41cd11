"""Options of planning: planner, timing, timeout, seed."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Literal, get_args

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from planning.constraints.constraint_set import ConstraintSet
from planning.timing.options import TimingOptions
from planning.tool_motions.tool_tolerance import SeamOptions
from planning.values.optimize_options import RefineOptions
from planning.values.preferences import GoalCosts, PreferredClearance, StopKinds
from planning.values.search_trees import Explored

#: Longest a single plan may take [s].
MAX_TIMEOUT = 600.0


@dataclass(frozen=True, slots=True, eq=False)
class ToolMotionOptions:
    """One motion of the tool, as it is asked for.

    Args:
        kind: "lin" or "circ".
        T_base_tip: Where it ends, shape (4, 4).
        via: Point on an arc, shape (3,) [m].
        center: Of an arc, shape (3,) [m].
        normal: Axis that the arc turns about by the right hand, with ``center``, shape (3,).
        blend: Distance from its end at which the tool may leave it for the next one [m]; None for
            that of all motions.
        T_base_start: Where it begins, shape (4, 4); None for the end of the one before.
        longer: Whether the tool turns the longer way round.
    """

    kind: Literal["lin", "circ"]
    T_base_tip: Array
    via: Sequence[float] | None = None
    center: Sequence[float] | None = None
    normal: Sequence[float] | None = None
    blend: float | None = None
    T_base_start: Array | None = None
    longer: bool = False

    def __post_init__(self) -> None:
        if self.kind == "lin" and not (self.via is self.center is self.normal is None):
            raise InvalidOption("via, center and normal belong to motions of type circ")
        if self.kind == "circ" and (self.via is None) == (self.center is None):
            raise InvalidOption(
                "a motion of type circ needs via or center",
                hint="Give a point on the way, or the centre.",
            )
        if self.normal is not None and self.center is None:
            raise InvalidOption("normal needs center: via says which way round")
        if self.blend is not None:
            _check_blend(self.blend)


def _check_blend(blend: float) -> None:
    # Widest blend of a corner [m].
    max_blend = 10.0
    if not 0.0 <= blend <= max_blend:
        raise InvalidOption(
            f"blend is {blend:g} m; it must be from 0 to {max_blend:g}",
            hint="Give the distance from the corner at which the tool may leave its motion.",
        )


@dataclass(frozen=True, slots=True, eq=False)
class CartesianOptions:
    """Options of tool motions along lines and arcs.

    Args:
        motions: In order; none for one line to the goal.
        max_deviation: Of the tool's origin from its motion, for every instant [m].
        max_orientation_deviation: Of its orientation from that at the same place [rad].
        orientation: "slerp" about an axis that keeps still, or "free": only the origin is led.
        allow_partial: Whether a motion that ends early is an answer too.
        blend: Distance from corners at which the tool may leave one motion for the next [m]; 0 for
            a rest at every corner.
        seam: Waypoints with tolerances to be followed in place of motions; None for none.

    Raises:
        InvalidOption: A deviation or the blend is out of its range.
    """

    motions: tuple[ToolMotionOptions, ...] = ()
    max_deviation: float = 1e-4
    max_orientation_deviation: float = 1e-3
    orientation: Literal["slerp", "free"] = "slerp"
    allow_partial: bool = False
    blend: float = 0.0
    seam: SeamOptions | None = None

    def __post_init__(self) -> None:
        _check_blend(self.blend)
        if self.seam is not None and self.motions:
            raise InvalidOption("give motions or waypoints, not both")
        # Least deviation of the tool that can be asked for [m], [rad]: inverse kinematics and the
        # bounds have three digits to spare below it.
        least_deviation = 1e-7
        for name in ("max_deviation", "max_orientation_deviation"):
            if not least_deviation <= getattr(self, name) <= 1.0:
                raise InvalidOption(
                    f"planner_options.{name} must be from {least_deviation:g} to 1",
                    hint="Metres and radians; a tenth of a millimetre is a usual one.",
                )


@dataclass(frozen=True, slots=True)
class Options:
    """Options of planning.

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
        clearance: Distances that paths keep wherever there is space.
        goal_costs: Weights by which one of a pose's configurations is chosen.
        explored: Keeps the tree or roadmap of the last planner; None for not at all.
        max_edges: Edges that each planner may check, for one motion of many: the search then ends
            alike on every machine, and why it failed is not looked into; None for no such bound.
        stops: Stops that the motion is to have from every instant: it is slowed down until they are
            proved, or refused.
        path_tolerance: How far any joint of the motion may be from the plan's path, at every place
            [rad or m]; None for wherever it is free. Motions that leave the path that is found have
            few of their own waypoints for a path.

    Raises:
        InvalidOption: The timeout is not in (0, 600], or a value is none of its option.
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
    clearance: PreferredClearance = field(default_factory=PreferredClearance)
    goal_costs: GoalCosts = field(default_factory=GoalCosts)
    explored: Explored | None = field(default=None, repr=False, compare=False)
    max_edges: int | None = None
    stops: StopKinds = "none"
    path_tolerance: float | None = None

    def __post_init__(self) -> None:
        if self.stops not in get_args(StopKinds):
            raise InvalidOption(
                f"there are no stops of kind {self.stops!r}",
                hint=f"Name one of: {', '.join(get_args(StopKinds))}.",
            )
        if self.timing.times is not None and self.timing.method != "spline":
            raise InvalidOption(
                "timing.times of a plan belongs to the method spline",
                hint="Leave times out, or time a path of your own by POST /v1/retime.",
            )
        if self.path_tolerance is not None and not 0.0 < self.path_tolerance < np.inf:
            raise InvalidOption(
                f"path.tolerance is {self.path_tolerance}", hint="Give a positive number."
            )
        if not 0.0 < self.timeout <= MAX_TIMEOUT:
            raise InvalidOption(f"timeout must be in (0, {MAX_TIMEOUT:g}] seconds")


def with_limits(options: Options, constraints: ConstraintSet | None) -> Options:
    """Options whose timing keeps the constraints on tool speed and torque."""
    if constraints is None:
        return options
    timing, limits = options.timing, dict(options.limits)
    if constraints.tool_speed is not None:
        speed = min(constraints.tool_speed, timing.tool_speed or np.inf)
        timing = replace(timing, tool_speed=speed)
    if constraints.torque is not None:
        timing = replace(timing, torque_limits=True)
        if constraints.torque.limits is not None:
            given = np.array(constraints.torque.limits)
            limits["effort"] = np.minimum(given, limits.get("effort", np.inf))
    return replace(options, timing=timing, limits=limits)
