"""Values that planning begins with: a valid start, goal configurations, checkers."""

from dataclasses import dataclass
from typing import NamedTuple

from kinematics.arrays import Array
from obstacles.collision.checker import Checker
from obstacles.distance.signed_distance import ACCURACY

#: A start or goal this near to its margin [m] counts as touching, and is told with pair and depth:
#: the proof knows distances to a tenth of a micrometre, below twice that nothing can be proved.
TOUCHING = 2.0 * ACCURACY
#: Planning keeps this much more than the margin, where start and goal have it to spare: it spares
#: the certificate halving its cells down to nothing where a path would graze [m].
SLACK = 1e-3
#: Of a start, and of goals by joints alone, nobody need know how much more clearance they have [m].
ENOUGH = 2.0 * SLACK


@dataclass(frozen=True, slots=True, eq=False)
class ValidStart:
    """A valid start.

    Args:
        joints: Inside the limits, shape (n,).
        checker: Of the exact robot in the scene with its margins.
        clearance: Of the start, margins taken off, or ``ENOUGH`` where it has that [m].
        notes: What was done to the request.
    """

    joints: Array
    checker: Checker
    clearance: float
    notes: tuple[str, ...]


class Candidate(NamedTuple):
    """A valid configuration of a goal.

    Args:
        clearance: Margins taken off [m]; ``ENOUGH`` where it is that and is not asked for.
        joints: Shape (n,) [rad or m].
    """

    clearance: float
    joints: Array


@dataclass(frozen=True, slots=True, eq=False)
class Ready:
    """A problem with a valid start and at least one valid goal.

    Args:
        start: Inside the limits, shape (n,).
        goals: Valid goal configurations (n,), the best first.
        checkers: Of the scene with its margins, and the slack kept beyond them. The last is of the
            exact robot; one before it, if any, of the robot in its solids' hulls, which is quicker
            to plan with and keeps obstacles out of the robot's pockets.
        notes: What was done to the request.
        best: How many of the goals, from the first on, are about as good; None for all.
        found: The goals with their clearances, in any order, where some are of poses.
    """

    start: Array
    goals: list[Array]
    checkers: tuple[Checker, ...]
    notes: tuple[str, ...]
    best: int | None = None
    found: tuple[Candidate, ...] = ()
