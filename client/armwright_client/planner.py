"""Names of the planners, for type checkers and editors."""

from typing import TYPE_CHECKING, Literal, TypeAlias

#: Planners of the service by its names, then as OMPL writes its own.
KnownPlanner = Literal[
    "auto",
    "straight_line",
    "potential_field",
    "rrt_connect",
    "aorrtc",
    "bfmt",
    "bit_star",
    "bkpiece1",
    "fmt",
    "informed_rrt_star",
    "kpiece1",
    "lbkpiece1",
    "prm",
    "prm_star",
    "rrt",
    "rrt_star",
    "sorrt_star",
    "optimize",
    "cartesian",
    "RRTConnect",
    "AORRTC",
    "BFMT",
    "BITstar",
    "BKPIECE1",
    "FMT",
    "InformedRRTstar",
    "KPIECE1",
    "LBKPIECE1",
    "PRM",
    "PRMstar",
    "RRT",
    "RRTstar",
    "SORRTstar",
]
if TYPE_CHECKING:
    PlannerName: TypeAlias = KnownPlanner
else:
    # A newer service may have more; one that has it not says so, and lists its own.
    PlannerName = str
