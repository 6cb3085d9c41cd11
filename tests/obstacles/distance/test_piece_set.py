"""Packed pieces: rows say what the pieces are, and packing behind others changes no distance."""

import itertools

import numpy as np
import pytest
import trimesh

from kinematics.arrays import Array
from obstacles.convex.piece import Piece, PieceKind
from obstacles.distance.piece_set import (
    ANCHOR,
    ANCHOR_STOP,
    CENTER,
    GROUP,
    GROUP_STOP,
    KIND,
    MIDDLE,
    NODE,
    NODE_STOP,
    POSE,
    RADIUS,
    SIZE,
    START,
    STOP,
    TABLE,
    WIDTH,
    CoreKind,
    PieceSet,
    ball_rows,
)
from obstacles.distance.signed_distance import signed_distance
from obstacles.distance.triangles.distance import touching
from obstacles.shapes.shape import (
    Box,
    Capsule,
    Cone,
    Convex,
    Cylinder,
    HalfSpace,
    PointCloud,
    Sphere,
)
from tests.obstacles.arms import cup, mesh_shape
from tests.obstacles.outline import convex_pieces
from tests.obstacles.solids import random_transform

RANDOM = np.random.default_rng(0)
FEW = Convex(RANDOM.normal(size=(8, 3)))
MANY = Convex(RANDOM.normal(size=(60, 3)))
KINDS = [
    (Box(np.array([0.1, 0.2, 0.3])), CoreKind.BOX),
    (Sphere(0.1), CoreKind.POINT),
    (Capsule(0.1, 0.2), CoreKind.POLYTOPE),
    (Cylinder(0.1, 0.2), CoreKind.CYLINDER),
    (Cone(0.1, 0.2), CoreKind.CONE),
    (HalfSpace(np.array([0.0, 1.0, 1.0]), 0.1), CoreKind.HALFSPACE),
    (FEW, CoreKind.POLYTOPE),
    (MANY, CoreKind.TABLED),
]


def corners_of(packed: PieceSet, i: int) -> Array:
    return packed.corners[int(packed.rows[i, START]) : int(packed.rows[i, STOP])]


def leaves(packed: PieceSet, i: int) -> Array:
    """The triangles in the leaves of a cover's tree, (t, 3, 3), in the order of their corners."""
    nodes = packed.surfaces[int(packed.rows[i, NODE]) : int(packed.rows[i, NODE_STOP])]
    first = nodes[nodes[:, 8] >= 0.0, 8].astype(int)
    return np.array([packed.corners[k : k + 3] for k in first])


def cup_pieces(T: Array) -> list[Piece]:
    return [piece.placed(T) for piece in mesh_shape(cup()).pieces()]


@pytest.mark.parametrize(("shape", "kind"), KINDS, ids=lambda x: getattr(x, "name", None))
def test_a_row_says_what_the_piece_is(shape: Box, kind: CoreKind) -> None:
    (piece,) = shape.pieces()
    piece = piece.placed(random_transform(np.random.default_rng(1)))
    packed = PieceSet.of([piece])
    row = packed.rows[0]
    assert row.shape == (WIDTH,)
    assert row[KIND] == kind
    center, radius = piece.bounding_sphere()
    np.testing.assert_allclose(row[CENTER : CENTER + 3], center, atol=1e-12)
    assert row[RADIUS] == radius
    if kind != CoreKind.POINT:
        np.testing.assert_allclose(row[POSE : POSE + 12].reshape(3, 4), piece.T_owner_piece[:3])
        np.testing.assert_array_equal(row[MIDDLE : MIDDLE + 6], piece.local_box())
    if kind == CoreKind.BOX:
        np.testing.assert_array_equal(row[SIZE : SIZE + 3], piece.box_half_sizes())
    if kind in (CoreKind.CYLINDER, CoreKind.CONE):
        assert row[SIZE : SIZE + 2].tolist() == [piece.radius, piece.half_height]
    if kind in (CoreKind.POLYTOPE, CoreKind.TABLED):
        np.testing.assert_array_equal(corners_of(packed, 0), piece.vertices)
    else:
        assert row[START] == row[STOP] == 0.0
    assert (len(packed.tables) > 0) == (kind == CoreKind.TABLED)
    assert not row[NODE:].any()


def test_a_ball_has_its_frame_at_its_point_and_turns_with_nothing() -> None:
    """Wherever its point is in the frame of the piece."""
    point, T = np.array([[0.3, -0.2, 0.1]]), random_transform(np.random.default_rng(2))
    ball = Piece(PieceKind.POLYTOPE, T, point, 0.0, 0.0, 0.05)
    row = PieceSet.of([ball]).rows[0]
    np.testing.assert_allclose(row, ball_rows(point @ T[:3, :3].T + T[:3, 3], 0.05)[0], atol=1e-12)


def test_rows_of_balls_are_those_of_a_cloud() -> None:
    cloud = PointCloud(np.random.default_rng(3).normal(size=(9, 3)), 0.07)
    packed = PieceSet.of(cloud.pieces())
    np.testing.assert_allclose(ball_rows(cloud.points, 0.07), packed.rows, atol=1e-12)
    assert len(packed.corners) == 0


def test_each_piece_is_packed_as_alone() -> None:
    """But for where its corners and tables start."""
    random = np.random.default_rng(4)
    pieces = [*convex_pieces(random), *convex_pieces(random)]
    packed = PieceSet.of(pieces)
    for i, piece in enumerate(pieces):
        alone = PieceSet.of([piece])
        np.testing.assert_array_equal(packed.rows[i, :START], alone.rows[0, :START])
        np.testing.assert_array_equal(corners_of(packed, i), corners_of(alone, 0))
        if len(alone.tables):
            first = int(packed.rows[i, TABLE])
            own = packed.tables[first : first + len(alone.tables)]
            np.testing.assert_array_equal(own, alone.tables)


def test_nothing_packs_to_nothing() -> None:
    packed = PieceSet.of([])
    assert packed.rows.shape == (0, WIDTH)
    assert packed.corners.shape == (0, 3)
    assert len(packed.tables) == len(packed.surfaces) == 0


def test_a_cover_carries_all_its_triangles_and_a_point_of_each_body() -> None:
    pieces = cup_pieces(np.eye(4))
    assert len(pieces) > 1
    packed = PieceSet.of(pieces)
    for i, piece in enumerate(pieces):
        assert piece.surface is not None
        row, triangles = packed.rows[i], leaves(packed, i)
        # All of them, in the order of the tree.
        assert sorted(map(np.ndarray.tobytes, triangles)) == sorted(
            map(np.ndarray.tobytes, piece.surface.triangles)
        )
        anchors = packed.corners[int(row[ANCHOR]) : int(row[ANCHOR_STOP])]
        np.testing.assert_array_equal(anchors, piece.surface.anchors)
        # Together they bound the cup.
        assert row[GROUP : GROUP_STOP + 1].tolist() == [0, len(pieces)]
    volume = trimesh.Trimesh(
        np.vstack([p.surface.triangles.reshape(-1, 3) for p in pieces if p.surface]),
        np.arange(3 * sum(len(p.surface.triangles) for p in pieces if p.surface)).reshape(-1, 3),
        process=False,
    ).volume
    assert volume == pytest.approx(cup().volume, rel=1e-6)


def test_groups_of_two_meshes_are_their_own() -> None:
    (ball,) = Sphere(0.1).pieces()
    pieces = [ball, *cup_pieces(np.eye(4)), ball, *cup_pieces(random_transform(RANDOM))]
    rows, k = PieceSet.of(pieces).rows, len(cup_pieces(np.eye(4)))
    assert rows[1 : 1 + k, GROUP].tolist() == [1] * k
    assert rows[1 : 1 + k, GROUP_STOP].tolist() == [1 + k] * k
    assert rows[2 + k :, GROUP].tolist() == [2 + k] * k
    assert rows[2 + k :, GROUP_STOP].tolist() == [2 + 2 * k] * k


def test_an_open_mesh_bounds_nothing() -> None:
    bowl = cup()
    bowl.update_faces(np.arange(len(bowl.faces)) < len(bowl.faces) - 2)
    rows = PieceSet.of(list(mesh_shape(bowl).pieces())).rows
    assert (rows[:, NODE_STOP] > rows[:, NODE]).all()
    assert not rows[:, GROUP_STOP].any()


def test_packed_behind_others_pieces_touch_what_they_touched() -> None:
    random = np.random.default_rng(5)
    T = random_transform(random, 0.1)
    first = PieceSet.of([*convex_pieces(random), *cup_pieces(T)])
    own = [
        *(p for k in range(3) for p in convex_pieces(np.random.default_rng(6 + k))),
        *cup_pieces(random_transform(random, 0.2)), *(p.placed(T) for p in MANY.pieces()),
    ]  # fmt: skip
    alone = PieceSet.of(own)
    behind = alone.behind(first)
    np.testing.assert_array_equal(behind.corners[: len(first.corners)], first.corners)
    np.testing.assert_array_equal(behind.tables[: len(first.tables)], first.tables)
    np.testing.assert_array_equal(behind.surfaces[: len(first.surfaces)], first.surfaces)
    verdicts = []
    for i, j in itertools.combinations(range(len(own)), 2):
        verdicts.append(touching(behind, i, j))
        assert verdicts[-1] == touching(alone, i, j)
    assert 0 < sum(verdicts) < len(verdicts)


def test_behind_pieces_without_corners_they_are_as_before() -> None:
    balls = PieceSet.of(list(PointCloud(np.eye(3), 0.1).pieces()))
    some = PieceSet.of(convex_pieces(np.random.default_rng(9)))
    assert some.behind(balls) is some


def test_touching_is_a_signed_distance_of_at_most_zero() -> None:
    random = np.random.default_rng(10)
    seen = [0, 0]
    for _ in range(4):
        pieces = [p.placed(random_transform(random, 0.15)) for p in convex_pieces(random)]
        packed = PieceSet.of(pieces)
        for (i, a), (j, b) in itertools.combinations(enumerate(pieces), 2):
            lower, upper = signed_distance(a, a.T_owner_piece, b, b.T_owner_piece)
            if upper <= 0.0 or lower > 0.0:
                assert touching(packed, i, j) == (upper <= 0.0)
                assert touching(packed, j, i) == (upper <= 0.0)
                seen[int(upper <= 0.0)] += 1
    assert min(seen) > 10
