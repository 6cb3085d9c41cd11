"""Narrow passages: found where they are wider, followed down to the clearance asked for."""

from itertools import pairwise

import numpy as np
import pytest

from kinematics.arrays import Array
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld
from obstacles.scenes.scene import Scene
from planning.search import rrt_connect
from planning.search.rrt_connect import PairOptions, TreePairs, find_narrow_passage
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


def test_each_pair_but_the_last_makes_the_guide_of_the_next(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[PairOptions] = []
    paths = [np.array([START, GOAL + k]) for k in range(6)]

    class Pairs(TreePairs):
        def grow(self, options: PairOptions) -> Array | None:
            asked.append(options)
            return paths[len(asked) - 1]

    made: list[Array] = []

    def keep(path: Array) -> Array:
        made.append(path)
        return path

    monkeypatch.setattr(rrt_connect, "_evenly_spread", keep)
    checker, roots = Checker.of(builtin("panda"), Scene()), np.array([START, GOAL])
    found = find_narrow_passage(Pairs(checker, roots, 0, Deadline.after(60.0), 100_000, None, True))
    assert found is paths[-1]
    assert [options.penetration for options in asked] == [0.02, 0.015, 0.01, 0.005, 0.0025, 0.0]
    assert asked[0].guide is None
    guides = [options.guide.points for options in asked if options.guide is not None]
    assert len(made) == 5
    assert all(a is b is c for a, b, c in zip(made, guides, paths, strict=False))


def test_points_of_a_guide_are_evenly_spread() -> None:
    path = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.3]])
    points = rrt_connect._evenly_spread(path)
    assert np.array_equal(points[[0, -1]], path[[0, -1]])
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).max() <= 0.25
    along = np.linspace(0.0, 1.3, len(points))
    expected = [(min(s, 1.0), max(s - 1.0, 0.0)) for s in along]
    np.testing.assert_allclose(points, expected, atol=1e-12)


def test_it_is_asked_once_plain_trees_have_come_to_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[int] = []

    def answer(grown: TreePairs) -> Array | None:
        asked.append(grown.edges)
        return np.array([BEFORE, ENCLOSED]) if len(asked) == 2 else None

    monkeypatch.setattr(rrt_connect, "find_narrow_passage", answer)
    until = Deadline.after(60.0)
    found = rrt_connect.rrt_connect(enclosed(), BEFORE, [ENCLOSED], 0, until, 50_000)
    assert found.waypoints is not None
    assert len(asked) == 2
    assert asked[0] >= 3000
