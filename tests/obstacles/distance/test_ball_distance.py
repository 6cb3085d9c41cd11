"""Distances of balls from every kind of piece, against FCL, and from clouds, against a k-d tree."""

import fcl
import numpy as np
import pytest
from scipy.spatial import KDTree

from kinematics.arrays import Array
from obstacles.convex.piece import Piece, PieceKind
from obstacles.distance.ball_distance import bound_from, closed_form, distance_from, nearest_from
from obstacles.distance.bvh import Tree, tree
from obstacles.distance.piece_set import CENTER, RADIUS, PieceSet, ball_rows
from obstacles.distance.signed_distance import signed_distance
from tests.obstacles.solids import KINDS, NO_VERTICES, random_solid, random_transform

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
        rows, corners, tables, _ = PieceSet.of([piece])
        assert closed_form(rows, 0)
        p, radius = random.normal(size=3) * 0.6, random.uniform(0.01, 0.2)
        ours = distance_from(rows, 0, corners, tables, *p) - radius
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
        rows, corners, tables, _ = PieceSet.of([piece])
        p = random.normal(size=3) * 0.2
        ours = distance_from(rows, 0, corners, tables, *p)
        point = Piece(PieceKind.POLYTOPE, np.eye(4), p[None], offset_radius=0.0)
        lower, upper = signed_distance(point, np.eye(4), piece, piece.T_owner_piece)
        # The round ones' polytopes of 200 corners are right to 1e-4 of their size.
        room = 1e-7 if kind in ("box", "sphere", "capsule", "hull") else 1e-3
        assert lower - 1e-7 <= ours <= upper + room
        assert bound_from(rows, 0, corners, *p) <= ours + 1e-9
        inside += ours < 0.0
    assert inside > 3


def test_halfspaces_and_rounded_polytopes() -> None:
    random = np.random.default_rng(3)
    for _ in range(50):
        T = random_transform(random)
        wall, p = Piece(PieceKind.HALFSPACE, T, NO_VERTICES), random.normal(size=3)
        rows, corners, tables, _ = PieceSet.of([wall])
        expected = float(T[:3, 2] @ (p - T[:3, 3]))
        assert distance_from(rows, 0, corners, tables, *p) == pytest.approx(expected)
        corners_of = random.normal(size=(6, 3)) * 0.2
        sharp, rounded = (
            PieceSet.of([Piece(PieceKind.POLYTOPE, T, corners_of, offset_radius=r)])
            for r in (0.0, 0.03)
        )
        gaps = [distance_from(s.rows, 0, s.corners, s.tables, *p) for s in (sharp, rounded)]
        assert gaps[0] - gaps[1] == pytest.approx(0.03, abs=1e-9)


def spread(random: np.random.Generator, count: int) -> tuple[Array, Array]:
    points = random.uniform(-1.0, 1.0, (count, 3))
    return points, ball_rows(points, 0.004)


def nearest(packed: PieceSet, grown: Tree, p: Array, within: float) -> tuple[float, int]:
    point = (float(p[0]), float(p[1]), float(p[2]))
    return nearest_from(packed.rows, grown, packed.corners, packed.tables, point, within)


def test_the_nearest_of_a_hundred_thousand_points() -> None:
    random = np.random.default_rng(4)
    points, rows = spread(random, 100_000)
    centers, radii = rows[:, CENTER : CENTER + 3], rows[:, RADIUS, None]
    grown, looked_up = tree(centers - radii, centers + radii), KDTree(points)
    cloud = PieceSet.of([])._replace(rows=rows)
    for p in random.normal(size=(300, 3)):
        expected, number = looked_up.query(p)
        distance, found = nearest(cloud, grown, p, np.inf)
        assert distance == pytest.approx(expected - 0.004, abs=1e-12)
        assert found == number
        within = 0.5 * (float(expected) - 0.004)
        if within > 0.0:
            assert nearest(cloud, grown, p, within) == (within, -1)


def test_the_nearest_of_mixed_solids() -> None:
    random = np.random.default_rng(5)
    pieces = [random_solid(random, kind, random_transform(random))[0] for kind in KINDS * 3]
    packed = PieceSet.of(pieces)
    balls = [piece.bounding_sphere() for piece in pieces]
    low, high = (
        np.array([center + sign * radius for center, radius in balls]) for sign in (-1.0, 1.0)
    )
    grown = tree(low, high)
    for p in random.normal(size=(60, 3)):
        each = [
            distance_from(packed.rows, k, packed.corners, packed.tables, *p)
            for k in range(len(pieces))
        ]
        distance, number = nearest(packed, grown, p, np.inf)
        assert distance == pytest.approx(min(each), abs=1e-9)
        assert each[number] == pytest.approx(min(each), abs=1e-9)


def test_an_empty_tree_has_no_nearest() -> None:
    none, bare = PieceSet.of([]), tree(np.zeros((0, 3)), np.zeros((0, 3)))
    assert nearest(none, bare, np.zeros(3), 2.0) == (2.0, -1)
