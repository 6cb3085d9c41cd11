"""Trees of boxes: each item in one leaf, tight boxes, skips past all that is below a node."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

import armwright as aw
from kinematics.arrays import Array
from kinematics.pose import transform
from obstacles.collision.fcl_distance import FclWorld
from obstacles.distance.bvh import (
    FIRST,
    LAST,
    SKIP,
    Tree,
    gap,
    tree,
)
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box, Capsule, Cone, Convex, Cylinder, HalfSpace, Shape, Sphere


def boxes(count: int, seed: int = 0) -> tuple[Array, Array]:
    random = np.random.default_rng(seed)
    low = random.normal(size=(count, 3))
    return low, low + random.uniform(0.0, 0.3, (count, 3))


def items_of(built: Tree, node: int) -> list[int]:
    first, last = built.nodes[node, FIRST : LAST + 1].astype(int)
    return [int(k) for k in built.items[first:last]]


def below(built: Tree, node: int) -> list[int]:
    """All items in the leaves from a node to where its skip leads."""
    nodes = range(node, int(built.nodes[node, SKIP]))
    return [k for n in nodes if built.nodes[n, FIRST] >= 0 for k in items_of(built, n)]


def nearest(built: Tree, points: Array, p: Array) -> tuple[int, int]:
    """The item nearest to p by a walk over the tree, and the leaves that it opened."""
    best, square, node, opened = -1, np.inf, 0, 0
    while node < len(built.nodes):
        if gap(built.nodes, node, p[0], p[1], p[2]) >= square:
            node = int(built.nodes[node, SKIP])
            continue
        if built.nodes[node, FIRST] >= 0.0:
            opened += 1
            for k in items_of(built, node):
                away = float(((points[k] - p) ** 2).sum())
                if away < square:
                    best, square = k, away
        node += 1
    return best, opened


@pytest.mark.parametrize("most", [1, 2, 5])
@pytest.mark.parametrize("count", [1, 2, 3, 7, 64, 301])
def test_every_item_is_in_one_leaf_that_holds_at_most_so_many(count: int, most: int) -> None:
    built = tree(*boxes(count), most)
    assert sorted(below(built, 0)) == list(range(count))
    assert sorted(built.items.tolist()) == list(range(count))
    for node, row in enumerate(built.nodes):
        if row[FIRST] >= 0.0:
            assert 1 <= len(items_of(built, node)) <= most
            assert row[SKIP] == node + 1
        else:
            assert row[LAST] == -1.0
            # Halves of an inner node: the next one, and the one that it skips to.
            middle = int(built.nodes[node + 1, SKIP])
            one, other = below(built, node + 1), below(built, middle)
            assert sorted(one + other) == sorted(below(built, node))
            assert abs(len(one) - len(other)) <= 1
            assert len(one) + len(other) > most
            assert built.nodes[middle, SKIP] == row[SKIP]
    assert built.nodes[0, SKIP] == len(built.nodes)


def test_a_walk_finds_the_nearest_point_and_leaves_most_leaves_closed() -> None:
    random = np.random.default_rng(3)
    points = random.normal(size=(1000, 3))
    built, oracle = tree(points, points), cKDTree(points)
    opened = []
    for p in random.normal(size=(40, 3)) * 2.0:
        found, leaves = nearest(built, points, p)
        assert found == oracle.query(p)[1]
        opened.append(leaves)
    assert np.median(opened) < 100


def test_a_tree_is_the_same_every_time_and_can_not_be_written_to() -> None:
    low, high = boxes(100, 4)
    one, other = tree(low, high), tree(low, high)
    np.testing.assert_array_equal(one.nodes, other.nodes)
    np.testing.assert_array_equal(one.items, other.items)
    for array in one:
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


ROBOT = aw.load_robot("planar_rr")
HIGH = 0.35


def at(x: float, y: float, z: float) -> np.ndarray:
    return transform(None, [x, y, z])


@pytest.mark.parametrize(
    "shape",
    [
        Box([0.1, 0.2, 0.3]),
        Sphere(0.1),
        Cylinder(0.1, 0.3),
        Capsule(0.1, 0.3),
        Cone(0.1, 0.2),
        HalfSpace([0.0, 0.6, 0.8], 0.0),
        Convex(np.random.default_rng(1).normal(scale=0.1, size=(20, 3))),
    ],
    ids=lambda shape: type(shape).__name__,
)
def test_the_points_are_as_far_apart_as_the_bodies(shape: Shape) -> None:
    scene = Scene([Obstacle("thing", shape, at(0.6, -0.9, HIGH))])
    world = FclWorld(ROBOT, scene)
    rng = np.random.default_rng(2)
    measured = 0
    for _ in range(12):
        q = rng.uniform(-1.0, 1.0, ROBOT.chain.n)
        nearest, clearance = world.nearest_points(q), world.clearance(q)
        assert nearest.distance == clearance.distance
        assert nearest.pair == clearance.pair
        if nearest.points is not None:
            first, second = nearest.points
            assert np.linalg.norm(first - second) == pytest.approx(nearest.distance, abs=1e-7)
            measured += 1
    assert measured >= 6


def test_the_points_of_a_ball_lie_on_its_surface() -> None:
    center = np.array([0.5, 0.8, HIGH])
    world = FclWorld(ROBOT, Scene([Obstacle("ball", Sphere(0.1), at(*center))]))
    nearest = world.nearest_points(np.zeros(ROBOT.chain.n))
    assert nearest.points is not None
    assert nearest.pair is not None
    on_ball = nearest.points[nearest.pair.index("ball")]
    on_link = nearest.points[1 - nearest.pair.index("ball")]
    assert np.linalg.norm(on_ball - center) == pytest.approx(0.1, abs=1e-7)
    # The nearest point of the ball looks towards the link.
    towards = (on_link - center) / np.linalg.norm(on_link - center)
    assert on_ball == pytest.approx(center + 0.1 * towards, abs=1e-6)


def test_there_are_no_points_without_anything_to_hit_or_in_collision() -> None:
    free = FclWorld(ROBOT, Scene([])).nearest_points(np.zeros(ROBOT.chain.n))
    if free.pair is None:
        assert np.isinf(free.distance)
    inside = FclWorld(ROBOT, Scene([Obstacle("ball", Sphere(5.0), at(0.0, 0.0, 0.0))]))
    struck = inside.nearest_points(np.zeros(ROBOT.chain.n))
    assert struck.distance < 0.0
    assert struck.points is None
