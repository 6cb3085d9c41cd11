"""The interface of planners: one question in, one attempt out."""

from dataclasses import dataclass
from typing import Protocol

from obstacles.collision.checker import Checker
from planning.preflight_result import Ready
from planning.problem import Problem
from planning.result import Attempt
from planning.values.deadline import Deadline
from planning.values.search_trees import Explored


@dataclass(frozen=True, slots=True, eq=False)
class Query:
    """A question to a planner.

    Args:
        problem: The robot, the scene, start and goals.
        ready: The valid start and goal configurations.
        checker: One of the checkers in ``ready``; it proves motions free.
        seed: Seed of everything random.
        deadline: When to stop.
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
    max_edges: int | None = None
    bound: int | None = None
    explored: Explored | None = None
    proves: bool = True

    @property
    def exact(self) -> bool:
        """Whether the checker has the robot's exact solids, not their hulls."""
        return self.checker is self.ready.checkers[-1]


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
