"""Distances of balls from every kind of piece, against FCL."""

import fcl
import numpy as np
import pytest

from obstacles.convex.piece import Piece, PieceKind
from obstacles.distance.ball_distance import bound_from, closed_form
from obstacles.distance.piece_set import PieceSet
from obstacles.distance.signed_distance import signed_distance
from tests.obstacles.solids import KINDS, random_solid, random_transform

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
