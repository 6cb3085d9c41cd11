"""Sampling-based planning by OMPL, whole certified edges at a time.

OMPL asks one callback an edge; the edge goes to one kernel that proves it free or finds what it
hits. A planner therefore never holds an edge that is not proved.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from ompl import base, geometric, util

from kinematics.chain import Array, Chain
from kinematics.errors import InvalidOption
from obstacles.checker import Checker
from planning.deadline import Deadline

#: Longest edge [rad]: arms in clutter are solved several times sooner with short ones.
DEFAULT_RANGE = 0.5

#: The time a random tree takes is spread widely: one that has looked at so many edges without
#: arriving is given up for a fresh one, which may look at somewhat more. Counted in edges, not in
#: time, the answer depends on the seed alone.
_FIRST_BUDGET = 2000
_BUDGET_GROWTH = 1.5
#: Between the seeds of one request's trees; neighbouring requests should not share them.
_SEED_STRIDE = 7_919
_SEEDS = 2**31 - 1

_PLANNERS = {"rrt_connect": geometric.RRTConnect}
PLANNERS = tuple(_PLANNERS)

util.setLogLevel(util.LogLevel.LOG_NONE)


@dataclass(frozen=True, slots=True, eq=False)
class SamplingResult:
    """What a sampling-based planner found.

    Args:
        waypoints: Shape (k, n), every leg proved free; None where it found nothing in time.
        edges: Edges that were proved or refused.
    """

    waypoints: Array | None
    edges: int


def sample(
    planner: str,
    chain: Chain,
    checker: Checker,
    start: Array,
    goals: list[Array],
    options: Mapping[str, Any],
    seed: int,
    deadline: Deadline,
) -> SamplingResult:
    """Plan from a configuration to any of several with one of OMPL's planners.

    Args:
        planner: One of ``PLANNERS``.
        chain: The robot, for its limits.
        checker: The robot in its scene.
        start: Shape (n,), valid.
        goals: Valid configurations (n,).
        options: ``range``: longest edge [rad].
        seed: The same seed gives the same path.
        deadline: When to stop.

    Raises:
        InvalidOption: An unknown planner or option, or a value out of its range.
    """
    longest = _range_option(planner, options)
    spent, budget = 0, _FIRST_BUDGET
    attempt = 0
    while True:
        # OMPL's generator is one for the process: what is drawn from here on depends on this alone.
        util.RNG.setSeed((seed + attempt * _SEED_STRIDE) % _SEEDS + 1)
        space = _space(chain, [start, *goals])
        information = base.SpaceInformation(space)
        edges = _CertifiedEdges(information, checker, chain.n)
        waypoints = _attempt(planner, information, edges, start, goals, longest, budget, deadline)
        spent += edges.count
        if waypoints is not None or deadline.passed:
            return SamplingResult(waypoints, spent)
        attempt, budget = attempt + 1, int(_BUDGET_GROWTH * budget)


def _attempt(
    planner: str,
    information: Any,
    edges: "_CertifiedEdges",
    start: Array,
    goals: list[Array],
    longest: float,
    budget: int,
    deadline: Deadline,
) -> Array | None:
    """One run of a planner, until it has looked at so many edges or time is up."""
    space = information.getStateSpace()
    information.setStateValidityChecker(edges.state_valid)
    information.setMotionValidator(edges)
    information.setup()
    definition = base.ProblemDefinition(information)
    definition.addStartState(_state(space, start))
    targets = base.GoalStates(information)
    for goal in goals:
        targets.addState(_state(space, goal))
    definition.setGoal(targets)
    solver = _PLANNERS[planner](information)
    solver.setRange(longest)
    solver.setProblemDefinition(definition)
    solver.setup()
    enough = base.PlannerTerminationCondition(lambda: edges.count >= budget or deadline.passed)
    solver.solve(enough)
    # The status is also true of paths that end near the goal: only an exact one counts.
    if not definition.hasExactSolution():
        return None
    states = definition.getSolutionPath().getStates()
    return np.array([state[0 : len(start)] for state in states], dtype=np.float64)


class _CertifiedEdges(base.MotionValidator):
    """OMPL's door to the checker."""

    def __init__(self, information: Any, checker: Checker, n: int) -> None:
        super().__init__(information)
        self._checker = checker
        self._n = n
        self.count = 0

    def checkMotion(self, a: Any, b: Any) -> bool:
        """Whether the straight motion from a to b is proved free."""
        self.count += 1
        n = self._n
        return self._checker.free(np.array(a[0:n]), np.array(b[0:n]))

    def state_valid(self, state: Any) -> bool:
        """Whether one state is free."""
        return self._checker.valid(np.array(state[0 : self._n]))


def check_options(planner: str, options: Mapping[str, Any]) -> None:
    """Check a planner's own options.

    Raises:
        InvalidOption: There is no such option, or a value is out of its range.
    """
    _range_option(planner, options)


def _range_option(planner: str, options: Mapping[str, Any]) -> float:
    if planner not in _PLANNERS:
        raise InvalidOption(
            f"there is no planner {planner!r}", hint=f"Choose one of: {', '.join(PLANNERS)}."
        )
    unknown = sorted(set(options) - {"range"})
    if unknown:
        raise InvalidOption(
            f"planner {planner!r} has no option {unknown[0]!r}", hint="Its options are: range."
        )
    longest = options.get("range", DEFAULT_RANGE)
    number = isinstance(longest, int | float) and not isinstance(longest, bool)
    if not (number and 0.0 < longest < np.inf):
        raise InvalidOption(f"planner_options.range must be a positive number, not {longest!r}")
    return float(longest)


def _space(chain: Chain, known: list[Array]) -> Any:
    """The box of the joint limits; where there are none, a turn beyond what is known."""
    lower, upper = np.min(known, axis=0) - 2.0 * np.pi, np.max(known, axis=0) + 2.0 * np.pi
    lower = np.where(np.isfinite(chain.limits.lower), chain.limits.lower, lower)
    upper = np.where(np.isfinite(chain.limits.upper), chain.limits.upper, upper)
    bounds = base.RealVectorBounds(chain.n)
    for j in range(chain.n):
        bounds.setLow(j, float(lower[j]))
        bounds.setHigh(j, float(upper[j]))
    space = base.RealVectorStateSpace(chain.n)
    space.setBounds(bounds)
    return space


def _state(space: Any, q: Array) -> Any:
    state = space.allocState()
    state[0 : len(q)] = [float(value) for value in q]
    return state
