"""Ways of arms with real meshes that OMPL finds: whether a problem without a plan has a solution.

RRT-Connect of OMPL joins start and goal, and FCL looks at the way on the very triangles. Nothing of
Armwright's own search is used.
"""

import itertools

import numpy as np
from ompl import base, geometric, util

from benchmarks.triangles import Body, Triangles
from kinematics.arrays import Array
from obstacles.checker import Checker
from planning.sampling.space import joint_space, state_of

#: Distance between two looks at a motion while a way is looked for, between two looks by FCL at
#: the way that was found, and RRT-Connect's longest step [rad].
_RESOLUTION, _FINE, _RANGE = 0.01, 0.005, 0.5
#: Configurations that are looked at, ten seconds' work.
_LOOKS = 300_000


def has_way(
    checker: Checker, ends: tuple[Array, Array], truth: Triangles, bodies: list[Body]
) -> bool:
    """Whether a way between two configurations is found that FCL finds free.

    Args:
        checker: The arm in its scene.
        ends: Start and goal, both of shape (n,).
        truth: The arm as triangles.
        bodies: The scene as triangles.
    """
    way = free_way(checker, *ends)
    return way is not None and is_free(way, truth, bodies)


def is_free(way: Array, truth: Triangles, bodies: list[Body]) -> bool:
    """Whether FCL finds the straight motions between configurations (k, n) free."""
    for a, b in itertools.pairwise(way):
        count = int(np.ceil(np.abs(b - a).max() / _FINE)) + 1
        for share in np.linspace(0.0, 1.0, count):
            if truth.collision(a + share * (b - a), bodies) is not None:
                return False
    return True


def free_way(checker: Checker, start: Array, goal: Array, looks: int = _LOOKS) -> Array | None:
    """A way between two configurations by OMPL's RRT-Connect, shape (k, n); None where it fails.

    Args:
        checker: The arm in its scene.
        start: Where it begins, shape (n,).
        goal: Where it ends.
        looks: Configurations that may be looked at.
    """
    chain, looked = checker.model.chain, 0
    n = chain.n

    def free(state: object) -> bool:
        nonlocal looked
        looked += 1
        return checker.valid(np.array(state[0:n]))  # type: ignore[index]

    util.RNG.setSeed(1)
    space = joint_space(chain, [start, goal])
    setup = geometric.SimpleSetup(space)
    information = setup.getSpaceInformation()
    setup.setStateValidityChecker(free)
    information.setStateValidityCheckingResolution(_RESOLUTION / space.getMaximumExtent())
    setup.setStartAndGoalStates(state_of(space, start), state_of(space, goal))
    planner = geometric.RRTConnect(information)
    planner.setRange(_RANGE)
    setup.setPlanner(planner)
    setup.solve(base.PlannerTerminationCondition(lambda: looked > looks))
    if not setup.haveExactSolutionPath():
        return None
    states = setup.getSolutionPath().getStates()
    return np.array([state[0:n] for state in states], dtype=np.float64)
