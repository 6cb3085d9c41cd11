"""Distances of balls from pieces, and cheap bounds of distances, beside FCL and coal."""

import itertools

import fcl
import numpy as np
import pytest

from kinematics.arrays import Array
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
from obstacles.distance.piece_set import HALF, KIND, MIDDLE, POSE, WIDTH, CoreKind, PieceSet
from obstacles.distance.signed_distance import signed_distance
from tests.obstacles.solids import KINDS, coal_distance, random_solid, random_transform

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
