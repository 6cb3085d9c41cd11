"""Violation of what a motion has to keep, as a value."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from kinematics.arrays import Array
from kinematics.trajectory.trajectory import Trajectory

#: A violation this near to the start or the goal, in every joint, is told as theirs [rad or m].
_AT_AN_END = 1e-6


@dataclass(frozen=True, slots=True)
class Violation:
    """First thing that is wrong with a trajectory.

    Args:
        kind: "collision", "undecided", "position", "velocity", "acceleration", "jerk", "torque",
            "tool_speed", "path_constraint", "path_deviation", "continuity", "start", "goal",
            "unproved" or "time".
        time: Begin of the violation [s]; of "torque", "tool_speed" and "path_deviation", its worst
            instant.
        message: One sentence.
        details: Values a program can use.
    """

    kind: str
    time: float
    message: str
    details: Mapping[str, Any]


def at_an_end(trajectory: Trajectory, q: Array) -> str | None:
    """Whether a configuration (n,) is the "start" or the "goal" of a motion; None for neither."""
    for where, end in (("start", trajectory.start), ("goal", trajectory.end)):
        if np.abs(q - end).max() <= _AT_AN_END:
            return where
    return None
