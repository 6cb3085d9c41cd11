"""Trees of boxes, distances of balls from pieces, and cheap bounds beside FCL and coal."""

import itertools

import fcl
import numpy as np
import pytest
from scipy.spatial import cKDTree

import armwright as aw
from kinematics.arrays import Array
from kinematics.pose import transform
from obstacles.collision.fcl_distance import FclWorld
from obstacles.convex.piece import Piece, PieceKind
from obstacles.distance.ball_distance import bound_from, closed_form
from obstacles.distance.bounds import balls_apart, quick_bound
from obstacles.distance.box_pairs import (
    box_of,
    from_first,
    gap_in_first,
    gap_in_second,
    triangle_gap,
    write_view,
)
from obstacles.distance.bvh import (
    FIRST,
    LAST,
    SKIP,
    Tree,
    gap,
    tree,
)
from obstacles.distance.piece_set import HALF, KIND, MIDDLE, POSE, WIDTH, CoreKind, PieceSet
from obstacles.distance.signed_distance import signed_distance
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box, Capsule, Cone, Convex, Cylinder, HalfSpace, Shape, Sphere
from tests.obstacles.solids import KINDS, coal_distance, random_solid, random_transform


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


#: FCL's iterations stop early enough in these units, hundredths of a millimetre.
UNITS = 1e5


def fcl_solid(piece: Piece, kind: str) -> fcl.CollisionObject:
    points, T = piece.vertices, piece.T_owner_piece
    if kind == "sphere":
        solid = fcl.Sphere(UNITS * piece.offset_radius)
    elif kind == "box":
        solid = fcl.Box(*(2.0 * UNITS * np.abs(points[0])))
    elif kind == "capsule":
        solid = fcl.Capsule(UNITS * piece.offset_radius, 2.0 * UNITS * abs(points[0, 2]))
    else:
        made = fcl.Cylinder if kind == "cylinder" else fcl.Cone
        solid = made(UNITS * piece.radius, 2.0 * UNITS * piece.half_height)
    return fcl.CollisionObject(solid, fcl.Transform(T[:3, :3], UNITS * T[:3, 3]))


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "hull"])
def test_balls_outside_are_as_far_as_fcl_says(kind: str) -> None:
    random = np.random.default_rng(sum(map(ord, kind)))
    apart = 0
    for _ in range(150):
        piece, _ = random_solid(random, kind, random_transform(random, 0.3))
        rows, corners, _, _ = PieceSet.of([piece])
        assert closed_form(rows, 0)
        p, radius = random.normal(size=3) * 0.6, random.uniform(0.01, 0.2)
        ours = bound_from(rows, 0, corners, *p) - radius
        ball = fcl.CollisionObject(fcl.Sphere(UNITS * radius), fcl.Transform(np.eye(3), UNITS * p))
        theirs = fcl.distance(ball, fcl_solid(piece, kind)) / UNITS
        if ours > 1e-6:
            apart += 1
            assert ours == pytest.approx(theirs, abs=1e-7)
        else:
            assert theirs <= 1e-6
    assert apart > 30


@pytest.mark.parametrize("kind", KINDS)
def test_signed_distances_inside_and_outside(kind: str) -> None:
    random = np.random.default_rng(sum(map(ord, kind)) + 1)
    inside = 0
    for _ in range(40):
        piece, _ = random_solid(random, kind, random_transform(random, 0.1))
        rows, corners, _, _ = PieceSet.of([piece])
        p = random.normal(size=3) * 0.2
        ours = bound_from(rows, 0, corners, *p)
        point = Piece(PieceKind.POLYTOPE, np.eye(4), p[None], offset_radius=0.0)
        lower, upper = signed_distance(point, np.eye(4), piece, piece.T_owner_piece)
        # The round ones' polytopes of 200 corners are right to 1e-4 of their size.
        room = 1e-7 if kind in ("box", "sphere", "capsule", "hull") else 1e-3
        assert ours <= upper + room
        assert lower - 1e-7 <= ours or kind == "hull"
        inside += ours < 0.0
    assert inside > 3


@pytest.mark.parametrize(("one", "other"), list(itertools.combinations_with_replacement(KINDS, 2)))
def test_no_bound_is_above_the_distance(one: str, other: str) -> None:
    random = np.random.default_rng(1)
    for _ in range(20):
        T_a, T_b = random_transform(random, 0.6), random_transform(random, 0.6)
        a, coal_a = random_solid(random, one, T_a)
        b, coal_b = random_solid(random, other, T_b)
        distance = max(coal_distance(coal_a, T_a, coal_b, T_b), 0.0)
        rows = PieceSet.of([a, b]).rows
        bound, n = quick_bound(rows, 0, rows, 1, np.inf)
        assert bound <= distance + 1e-7
        assert balls_apart(rows, 0, 1) <= bound + 1e-12
        early, _ = quick_bound(rows, 0, rows, 1, -np.inf)
        assert early <= bound + 1e-12
        if bound > 0.0:
            assert np.linalg.norm(n) == pytest.approx(1.0)


NODES = np.zeros((0, 10))
SIGNS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)


def desk_of(random: np.random.Generator, reach: float) -> tuple[Array, Array]:
    """Two boxes anywhere on a desk, and how the second is seen from the first."""
    desk, view = np.zeros((2, WIDTH)), np.zeros(WIDTH)
    for row in desk:
        row[KIND] = CoreKind.POLYTOPE
        row[MIDDLE : MIDDLE + 3] = random.normal(size=3) * 0.1
        row[HALF : HALF + 3] = random.uniform(0.0, 0.4, 3) * random.integers(0, 2, 3)
        row[POSE : POSE + 12] = random_transform(random, reach)[:3].reshape(12)
    write_view(desk, view)
    return desk, view


def placed(row: Array, points: Array) -> Array:
    T = row[POSE : POSE + 12].reshape(3, 4)
    return np.asarray(points @ T[:, :3].T + T[:, 3])


def corners_of(row: Array) -> Array:
    return placed(row, row[MIDDLE : MIDDLE + 3] + SIGNS * row[HALF : HALF + 3])


def turned(row: Array, n: tuple[float, float, float]) -> Array:
    return np.asarray(row[POSE : POSE + 12].reshape(3, 4)[:, :3] @ n)


def parted(a: Array, b: Array, n: Array) -> float:
    """How far points are apart along n or against it."""
    return float(max((a @ n).min() - (b @ n).max(), (b @ n).min() - (a @ n).max()))


def test_boxes_are_as_far_apart_as_is_told_along_the_direction_that_is_told() -> None:
    random, positive = np.random.default_rng(3), 0
    for k in range(400):
        desk, view = desk_of(random, 0.2 + 0.002 * k)
        a, b = box_of(desk, 0, NODES, -1), box_of(desk, 1, NODES, -1)
        own, others = corners_of(desk[0]), corners_of(desk[1])
        for side, gap_in in ((0, gap_in_first), (1, gap_in_second)):
            gap, n = gap_in(view, a, b)
            if gap > 0.0:
                positive += 1
                assert np.linalg.norm(n) == pytest.approx(1.0, abs=1e-12)
                assert parted(own, others, turned(desk[side], n)) >= gap - 1e-12
    assert positive > 300


@pytest.mark.parametrize("thin", [1.0, 1e-3, 1e-9, 0.0])
def test_triangles_are_as_far_apart_as_is_told_however_thin(thin: float) -> None:
    random, positive = np.random.default_rng(6), 0
    for _ in range(400):
        desk, view = desk_of(random, 0.6)
        corners = random.normal(size=(6, 3)) * 0.3
        for first in (0, 3):
            middle = 0.5 * (corners[first] + corners[first + 1])
            corners[first + 2] = middle + thin * corners[first + 2]
        gap, n = triangle_gap(view, corners, 0, 3)
        axis = np.zeros(3)
        from_first(desk, n, axis)
        if gap > 0.0:
            positive += 1
            own, others = placed(desk[0], corners[:3]), placed(desk[1], corners[3:])
            apart = (own @ axis).min() - (others @ axis).max()
            assert apart == pytest.approx(gap, abs=1e-12)
    assert positive > 100 or thin == 0.0
