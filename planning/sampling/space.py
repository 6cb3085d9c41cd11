"""OMPL's state space of an arm, and its motion validator that proves whole edges."""

from typing import Any

import numpy as np
from ompl import base, util

from kinematics.arrays import Array
from kinematics.model.chain import Chain
from obstacles.collision.checker import Checker
from planning.values.deadline import Deadline
from planning.values.search_box import search_box
from planning.values.search_trees import Explored

util.setLogLevel(util.LogLevel.LOG_NONE)


def joint_space(chain: Chain, known: list[Array]) -> Any:
    """The box of the joint limits; a turn beyond the known configurations where there are none."""
    lower, upper = search_box(chain, known)
    bounds = base.RealVectorBounds(chain.n)
    for j in range(chain.n):
        bounds.setLow(j, float(lower[j]))
        bounds.setHigh(j, float(upper[j]))
    space = base.RealVectorStateSpace(chain.n)
    space.setBounds(bounds)
    return space


def state_of(space: Any, q: Array) -> Any:
    """A configuration as a state of OMPL."""
    state = space.allocState()
    state[0 : len(q)] = [float(value) for value in q]
    return state


class CertifiedEdges(base.MotionValidator):
    """The motion validator: OMPL's planners only ever get edges that are proved.

    Args:
        information: OMPL's space information.
        checker: Proves edges.
        n: Number of joints.
        deadline: Afterwards nothing is proved any more, so that a planner in the midst of a long
            round comes to its end.
    """

    def __init__(self, information: Any, checker: Checker, n: int, deadline: Deadline) -> None:
        super().__init__(information)
        self._checker = checker
        self._n = n
        self._deadline = deadline
        self.count = 0
        self.proved: list[tuple[Array, Array]] | None = None
        self.explored: Explored | None = None

    def checkMotion(self, a: Any, b: Any) -> bool:
        """Whether the straight motion from a to b is proved free."""
        if self._deadline.passed:
            return False
        self.count += 1
        start, end = np.array(a[0 : self._n]), np.array(b[0 : self._n])
        free = self._checker.free(start, end)
        if free and self.proved is not None:
            self.proved.append((start, end))
        if free and self.explored is not None:
            self.explored.add(start, end)
        return free

    def state_valid(self, state: Any) -> bool:
        """Whether one state is free."""
        return not self._deadline.passed and self._checker.valid(np.array(state[0 : self._n]))


def problem(
    chain: Chain, checker: Checker, start: Array, goals: list[Array], deadline: Deadline
) -> tuple[Any, Any, CertifiedEdges]:
    """OMPL's space information and problem definition, and the edges that it will ask for."""
    space = joint_space(chain, [start, *goals])
    information = base.SpaceInformation(space)
    edges = CertifiedEdges(information, checker, chain.n, deadline)
    information.setStateValidityChecker(edges.state_valid)
    information.setMotionValidator(edges)
    information.setup()
    definition = base.ProblemDefinition(information)
    definition.addStartState(state_of(space, start))
    targets = base.GoalStates(information)
    for goal in goals:
        targets.addState(state_of(space, goal))
    definition.setGoal(targets)
    definition.setOptimizationObjective(base.PathLengthOptimizationObjective(information))
    return information, definition, edges


def solution(definition: Any, n: int) -> Array | None:
    """The path that was found, shape (k, n), if it ends at a goal."""
    # The status is also true of paths that end near the goal: only an exact one counts.
    if not definition.hasExactSolution():
        return None
    states = definition.getSolutionPath().getStates()
    return np.array([state[0:n] for state in states], dtype=np.float64)
