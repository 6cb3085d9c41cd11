"""Proved edges of trees and roadmaps: what planners explored, kept on request."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array

#: Edges that are kept of one run unless asked otherwise.
_MAX_EDGES = 4000
#: What edges belong to where a planner has one tree or a roadmap.
WHOLE = "all"


class Edge(NamedTuple):
    """A straight motion that was proved free.

    Args:
        begin: Shape (n,) [rad or m].
        end: Shape (n,) [rad or m].
        part: "start" or "goals" for the tree of one end, "all" where there is one tree or roadmap.
    """

    begin: Array
    end: Array
    part: str


@dataclass(slots=True)
class Explored:
    """The edges of the last run of a planner; a fresh tree takes the place of one given up.

    Args:
        max_edges: How many are kept; the others are counted.
        planner: Name of the planner whose run it was; None before the first one.
        runs: Runs that there were, this one among them.
        edges: Edges in the order in which they were proved.
        left_out: How many more there were.
    """

    max_edges: int = _MAX_EDGES
    planner: str | None = None
    runs: int = 0
    edges: list[Edge] = field(default_factory=list)
    left_out: int = 0
    _begins: bool = field(default=False, init=False, repr=False)

    def begin(self, planner: str) -> None:
        """A run begins; what the one before it explored stays until it has an edge.

        Args:
            planner: Name of the planner.
        """
        self.runs = self.runs + 1 if planner == self.planner else 1
        if planner != self.planner:
            self.edges.clear()
        self.planner, self.left_out, self._begins = planner, 0, True

    def add(self, begin: Array, end: Array, part: str = WHOLE) -> None:
        """Store an edge until the most edges are stored.

        Args:
            begin: Shape (n,) [rad or m].
            end: Shape (n,) [rad or m].
            part: The tree that it belongs to.
        """
        if self._begins:
            self.edges.clear()
            self._begins = False
        if len(self.edges) < self.max_edges:
            self.edges.append(Edge(np.array(begin), np.array(end), part))
        else:
            self.left_out += 1
