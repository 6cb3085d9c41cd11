"""The first planner: a straight motion in joint space, proved free or given up at once."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from kinematics.arrays import Array
from obstacles.collision.checker import Checker, Motion
from planning.planner import Query
from planning.result import Attempt


def straight_line(
    checker: Checker, start: Array, goals: list[Array]
) -> tuple[Array | None, list[Motion]]:
    """Try the straight joint motion to each goal in turn.

    Args:
        checker: The robot in its scene.
        start: Configuration, shape (n,) [rad or m].
        goals: Configurations (n,), the most wanted first.

    Returns:
        The two ends of the first motion that is proved free, or None, and what was found out
        about each.
    """
    motions = []
    for goal in goals:
        motion = checker.straight(start, goal)
        motions.append(motion)
        if motion.free:
            return np.array([start, goal]), motions
    return None, motions


@dataclass(frozen=True, slots=True)
class StraightLine:
    """The planner "straight_line"."""

    name: ClassVar[str] = "straight_line"
    needs_goals: ClassVar[bool] = True

    def plan(self, query: Query) -> Attempt:
        """Try the straight joint motion to each goal in turn."""
        waypoints, motions = straight_line(query.checker, query.ready.start, query.ready.goals)
        if waypoints is not None or motions[0].pair is None:
            return Attempt(waypoints, "Proved free.")
        return Attempt(None, f"Blocked: {motions[0].pair[0]} and {motions[0].pair[1]}.")
