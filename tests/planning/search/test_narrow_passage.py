"""Narrow passages: found where they are wider, followed down to the clearance asked for."""

from itertools import pairwise

import numpy as np
import pytest

from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld
from obstacles.scenes.scene import Scene
from planning.search.rrt_connect import TreePairs, find_narrow_passage
from planning.values.deadline import Deadline
from tests.planning.scenes import HOME, box, builtin, pillar, shelf

START, GOAL = HOME.copy(), HOME.copy()
START[0], GOAL[0] = -0.9, 0.9
#: Of two links in a plane: the first one between two posts can't be got out from there.
BEFORE, ENCLOSED = np.array([-2.0, 0.3]), np.array([2.5, 0.0])


def enclosed() -> Checker:
    """Bars on both sides of the first link in ENCLOSED."""
    posts = []
    for k, angle in enumerate((2.2, 2.8)):
        at = 0.3 * np.array([np.cos(angle), np.sin(angle)])
        posts.append(box(f"post{k}", (0.04, 2.0, 0.04), (at[0], 0.0, at[1])))
    return Checker.of(builtin("planar_rr"), Scene(tuple(posts)))


def pairs(scene: Scene, max_edges: int = 100_000, *, proves: bool = True) -> TreePairs:
    checker, roots = Checker.of(builtin("panda"), scene), np.array([START, GOAL])
    return TreePairs(checker, roots, 3, Deadline.after(60.0), max_edges, None, proves)


@pytest.mark.parametrize("scene", [pillar(0.0, 0.4), shelf(0.7)])
def test_the_way_keeps_the_clearance_asked_for_and_is_found_again(scene: Scene) -> None:
    robot, grown = builtin("panda"), pairs(scene)
    path = find_narrow_passage(grown)
    assert path is not None
    assert np.array_equal(path[[0, -1]], [START, GOAL])
    assert grown.runs >= 6
    assert Checker.of(robot, scene).polyline(path)[0].free
    world = FclWorld(robot, scene)
    for a, b in pairwise(path):
        assert not any(world.collisions(a + share * (b - a)) for share in np.linspace(0, 1, 30))
    again = find_narrow_passage(pairs(scene))
    assert again is not None
    assert np.array_equal(path, again)


def test_there_is_none_where_there_is_no_way() -> None:
    roots = np.array([BEFORE, ENCLOSED])
    grown = TreePairs(enclosed(), roots, 0, Deadline.after(60.0), 100_000, None, True)
    assert find_narrow_passage(grown) is None
    assert grown.edges <= 100_000


def test_budgets_hold_whatever_pair_they_end_in() -> None:
    for most in (1, 50, 200):
        grown = pairs(shelf(0.7), most)
        find_narrow_passage(grown)
        # The last pair may take as many again for a shorter path.
        assert grown.edges <= 2 * most
