"""The interface of planners: one question in, one attempt out."""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

from kinematics.arrays import Array
from obstacles.collision.checker import Checker
from obstacles.distance.signed_distance import ACCURACY
from planning.problem import Problem
from planning.result import Attempt
from planning.values.deadline import Deadline
from planning.values.search_trees import Explored

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


@dataclass(frozen=True, slots=True, eq=False)
class Query:
    """A question to a planner.

    Args:
        problem: The robot, the scene, start and goals.
        ready: The valid start and goal configurations.
        checker: One of the checkers in ``ready``; it proves motions free.
        seed: Seed of everything random.
        deadline: When to stop.
        limits: Of velocity, acceleration and jerk, as ``estimate_limits`` has them, shape (3, n).
        max_edges: Edges after which trees stop where a path is only preferred; None for no such
            bound.
        bound: Edges after which every planner stops; None for its own bounds.
        explored: Keeps the edges that trees and roadmaps prove; None for not at all.
        proves: Whether the path has to be proved; otherwise trees may check states of it only.
    """

    problem: Problem
    ready: Ready
    checker: Checker
    seed: int
    deadline: Deadline
    limits: Array
    max_edges: int | None = None
    bound: int | None = None
    explored: Explored | None = None
    proves: bool = True


class Planner(Protocol):
    """Finds a path; its options are checked where it is made."""

    @property
    def name(self) -> str:
        """Name of the planner on the wire and of its stage."""
        ...

    @property
    def needs_goals(self) -> bool:
        """Whether it needs goal configurations before it begins."""
        ...

    def plan(self, query: Query) -> Attempt:
        """Search for a path."""
        ...
