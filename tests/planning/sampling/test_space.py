"""OMPL's view of an arm: bounds, states, and edges that are proved or refused."""

import numpy as np
from ompl import geometric, util

from planning.sampling.space import joint_space, problem, solution, state_of
from planning.values.deadline import Deadline
from tests.planning.sampling.world import GOAL, START, WALL, plane

OVER = np.array([0.0, 1.0])


def test_bounds_are_the_joint_limits() -> None:
    space = joint_space(plane(), [START, GOAL])
    lower, upper = plane().limits.lower, plane().limits.upper
    bounds = space.getBounds()
    np.testing.assert_allclose(list(bounds.low), np.where(np.isfinite(lower), lower, -7.2), atol=1)
    np.testing.assert_allclose(list(bounds.high), np.where(np.isfinite(upper), upper, 7.2), atol=1)
    assert space.getDimension() == 2
    assert list(state_of(space, GOAL)[0:2]) == list(GOAL)


def test_edges_are_counted_proved_and_kept() -> None:
    information, _, edges = problem(plane(), WALL, START, [GOAL], Deadline.after(100.0))
    space = information.getStateSpace()
    start, goal, over = (state_of(space, q) for q in (START, GOAL, OVER))
    assert not edges.checkMotion(start, goal), "the wall is between them"
    assert edges.checkMotion(start, over)
    edges.proved = []
    assert edges.checkMotion(over, goal)
    assert not edges.checkMotion(start, goal)
    assert edges.count == 4
    ((a, b),) = edges.proved
    np.testing.assert_array_equal([a, b], [OVER, GOAL])
    assert edges.state_valid(start)
    assert not edges.state_valid(state_of(space, np.array([0.0, 0.0])))


def test_after_the_deadline_nothing_is_proved() -> None:
    information, _, edges = problem(plane(), WALL, START, [GOAL], Deadline.after(-1.0))
    space = information.getStateSpace()
    start, over = state_of(space, START), state_of(space, OVER)
    assert not edges.checkMotion(start, over)
    assert not edges.state_valid(start)
    assert edges.count == 0


def test_a_solution_is_a_path_that_ends_at_the_goal() -> None:
    util.RNG.setSeed(1)
    information, definition, _ = problem(plane(), WALL, START, [GOAL], Deadline.after(100.0))
    assert solution(definition, 2) is None
    states = [state_of(information.getStateSpace(), q) for q in (START, OVER, GOAL)]
    path = geometric.PathGeometric(information)
    for state in states:
        path.append(state)
    definition.addSolutionPath(path, True, 0.3, "approximate")
    assert solution(definition, 2) is None, "a path that ends near the goal is none"
    definition.clearSolutionPaths()
    definition.addSolutionPath(path)
    answer = solution(definition, 2)
    assert answer is not None
    np.testing.assert_array_equal(answer, [START, OVER, GOAL])
