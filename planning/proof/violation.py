"""Violation of what a motion has to keep, as a value."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Violation:
    """First thing that is wrong with a trajectory.

    Args:
        kind: "collision", "undecided", "position", "velocity", "acceleration", "jerk", "torque",
            "tool_speed", "path_constraint", "path_deviation", "continuity", "start", "goal",
            "unproved" or "time".
        time: When it begins [s]; of "torque", "tool_speed" and "path_deviation", when it is worst.
        message: One sentence.
        details: Values a program can use.
    """

    kind: str
    time: float
    message: str
    details: Mapping[str, Any]
