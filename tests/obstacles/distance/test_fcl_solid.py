"""FCL's solids of our pieces: their distances are those of the pieces, wherever they are moved."""

import itertools

import fcl
import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.pose import transform
from obstacles.convex.piece import Piece, PieceKind
from obstacles.distance.fcl_solid import (
    THIN,
    UNITS,
    FclSolid,
    fcl_cube,
    fcl_point,
    fcl_solid,
    separation,
)
from obstacles.distance.signed_distance import signed_distance
from obstacles.shapes.shape import Box, Convex, HalfSpace, Sphere
from tests.obstacles.outline import convex_pieces
from tests.obstacles.solids import random_transform


def moved(piece: Piece, T: Array | None = None) -> FclSolid:
    solid = fcl_solid(piece)
    solid.move(piece.T_owner_piece if T is None else T)
    return solid


def apart(a: FclSolid, b: FclSolid) -> float:
    found = separation(a, b)
    assert found is not None
    return found.distance


@pytest.mark.parametrize("seed", range(3))
def test_distances_are_those_of_the_pieces(seed: int) -> None:
    random = np.random.default_rng(seed)
    compared = 0
    for a, b in itertools.combinations(convex_pieces(random), 2):
        far = b.placed(transform(None, random.normal(size=3)))
        lower, upper = signed_distance(a, a.T_owner_piece, far, far.T_owner_piece)
        found = separation(moved(a), moved(far))
        if found is None:
            # The cores touch, so the pieces overlap.
            assert upper <= 1e-6
            continue
        if lower > 0.0:
            compared += 1
            assert found.distance == pytest.approx(lower, abs=1e-4 * (1.0 + lower))
            # The nearest points are as far apart as FCL says, in its own units.
            length = np.linalg.norm(found.other - found.nearest) / UNITS
            assert length == pytest.approx(fcl_length(a, far), rel=1e-3)
    assert compared > 5


def fcl_length(a: Piece, b: Piece) -> float:
    return float(fcl.distance(moved(a).object, moved(b).object)) / UNITS


def test_points_segments_and_triangles_have_solids() -> None:
    """FCL knows none of them: balls and capsules a nanometre thick, and two-sided triangles."""
    point = fcl_point()
    for corners in (
        [[0.0, 0, 0]],
        [[0.0, 0, -1], [0, 0, 1]],
        [[0.0, 0, -1], [0, 0, 1], [0, -1, 0]],
    ):
        piece = Piece(PieceKind.POLYTOPE, np.eye(4), np.array(corners))
        point.move(transform(None, [0.3, 0.4, 0.0]))
        assert apart(moved(piece), point) == pytest.approx(0.5, abs=1e-6)
    triangle = Piece(PieceKind.POLYTOPE, np.eye(4), np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]))
    for height in (0.2, -0.2):
        point.move(transform(None, [0.2, 0.2, height]))
        assert apart(moved(triangle), point) == pytest.approx(0.2, abs=1e-6)


def test_degenerate_corners_are_what_they_span() -> None:
    """Three in a line are a segment, three in one place a point, many in a plane a polygon."""
    point = fcl_point()
    point.move(transform(None, [0.0, 0.0, 0.7]))
    line = Piece(PieceKind.POLYTOPE, np.eye(4), np.array([[-1.0, 0, 0], [0, 0, 0], [1, 0, 0]]))
    spot = Piece(PieceKind.POLYTOPE, np.eye(4), np.zeros((3, 3)))
    ring = np.column_stack([np.cos(np.arange(9)), np.sin(np.arange(9)), np.zeros(9)])
    flat = Piece(PieceKind.POLYTOPE, np.eye(4), ring)
    for piece in (line, spot, flat):
        assert apart(moved(piece), point) == pytest.approx(0.7, abs=1e-6)


def test_solids_of_one_piece_are_moved_apart() -> None:
    (box,) = Box(np.full(3, 0.2)).pieces()
    one, other = fcl_solid(box), fcl_solid(box)
    one.move(np.eye(4))
    # Not right above each other: there FCL takes corners for the nearest points.
    other.move(transform(None, [1.0, 0.01, 0.02]))
    assert apart(one, other) == pytest.approx(0.8)
    other.move(transform(None, [0.01, 0.02, 3.0]))
    assert apart(one, other) == pytest.approx(2.8)


def test_what_touches_has_no_separation() -> None:
    (box,) = Box(np.full(3, 0.2)).pieces()
    for shift in (0.0, 0.1, 0.19):
        assert separation(moved(box), moved(box, transform(None, [shift, 0, 0]))) is None


def test_the_radius_around_a_core_is_taken_off() -> None:
    """Of balls only the centres are asked about: they overlap by a negative distance."""
    (ball,) = Sphere(0.3).pieces()
    for gap in (1.0, 0.1, -0.2):
        other = moved(ball, transform(None, [0.6 + gap, 0.0, 0.0]))
        assert apart(moved(ball), other) == pytest.approx(gap, abs=1e-6)


def test_a_halfspace_is_refused() -> None:
    (floor,) = HalfSpace(np.array([0.0, 0.0, 1.0]), 0.0).pieces()
    with pytest.raises(ValueError, match="half-space"):
        fcl_solid(floor)


@pytest.mark.parametrize("side", [1e-3, 0.5, 20.0])
def test_a_cube_has_its_side(side: float) -> None:
    cube, point = fcl_cube(side), fcl_point()
    cube.move(np.eye(4))
    point.move(transform(None, [side, 0.0, 0.0]))
    assert apart(cube, point) == pytest.approx(0.5 * side, rel=1e-5)
    assert cube.excess == 0.0
    assert point.excess == THIN


def test_frames_of_segments_lie_along_them() -> None:
    random = np.random.default_rng(5)
    for _ in range(10):
        ends = random.normal(size=(2, 3))
        (piece,) = Convex(ends).pieces()
        solid = fcl_solid(piece)
        np.testing.assert_allclose(solid.T_piece_fcl[:3, 3], ends.mean(axis=0), atol=1e-12)
        along = ends[1] - ends[0]
        cosine = abs(solid.T_piece_fcl[:3, 2] @ along) / np.linalg.norm(along)
        assert cosine == pytest.approx(1.0)
        T = random_transform(random)
        solid.move(T)
        point = fcl_point()
        at = T[:3, :3] @ ends.mean(axis=0) + T[:3, 3]
        across = T[:3, :3] @ np.linalg.svd(along[None])[2][1]
        point.move(transform(None, at + 0.4 * across))
        assert apart(solid, point) == pytest.approx(0.4, abs=1e-6)
