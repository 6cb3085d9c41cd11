"""OMPL's RRT-Connect and its own simplification, on the edges that Armwright proves."""

import numpy as np
from ompl import base, geometric, util

from obstacles.checker import Checker
from planning.deadline import Deadline
from planning.preflight.preflight import preflight
from planning.problem import Problem
from planning.result import Failure
from planning.sampling.space import CertifiedEdges, joint_space, state_of

#: What OMPL may take for a path [s], and its own limit for simplifying it.
_SOLVE, _SIMPLIFY = 10.0, 1.0
_RANGE = 0.5


def simplified_length(problem: Problem, seed: int) -> float:
    """Length of OMPL's simplified path [rad]; NaN where it found none."""
    ready = preflight(problem, seed)
    if isinstance(ready, Failure):
        return np.nan
    util.RNG.setSeed(seed + 1)
    chain = problem.robot.chain
    checker: Checker = ready.checkers[-1]
    space = joint_space(chain, [ready.start, *ready.goals])
    information = base.SpaceInformation(space)
    edges = CertifiedEdges(information, checker, chain.n, Deadline.after(_SOLVE + _SIMPLIFY))
    information.setStateValidityChecker(edges.state_valid)
    information.setMotionValidator(edges)
    setup = geometric.SimpleSetup(information)
    setup.setStartAndGoalStates(state_of(space, ready.start), state_of(space, ready.goals[0]))
    planner = geometric.RRTConnect(information)
    planner.setRange(_RANGE)
    setup.setPlanner(planner)
    deadline = Deadline.after(_SOLVE)
    setup.solve(base.PlannerTerminationCondition(lambda: deadline.passed))
    if not setup.haveExactSolutionPath():
        return np.nan
    setup.simplifySolution(_SIMPLIFY)
    return float(setup.getSolutionPath().length())
