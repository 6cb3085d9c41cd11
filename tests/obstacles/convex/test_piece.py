"""Pieces: balls and boxes hold them and no more, moving and packing change nothing else."""

import itertools
from dataclasses import fields

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from kinematics.arrays import Array
from kinematics.pose import from_axis_angle, transform
from obstacles.convex.piece import Piece, PieceArrays, PieceKind
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
from tests.obstacles.outline import convex_pieces, offset, owned, points_inside, rim
from tests.obstacles.solids import random_transform

COLUMNS = [item.name for item in fields(PieceArrays)]
FLOOR = HalfSpace(np.array([0.0, 0.0, 1.0]), -0.3).pieces()[0]


def assert_same(one: PieceArrays, other: PieceArrays) -> None:
    for name in COLUMNS:
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), atol=1e-12)


def test_the_ball_holds_every_point_and_touches_the_outermost() -> None:
    random = np.random.default_rng(1)
    for _ in range(10):
        for piece in convex_pieces(random):
            center, radius = piece.bounding_sphere()
            away = np.linalg.norm(points_inside(piece, random) - center, axis=1)
            assert away.max() <= radius + 1e-12
            outermost = np.linalg.norm(owned(piece, rim(piece)) - center, axis=1).max()
            assert outermost + offset(piece) == pytest.approx(radius, abs=1e-9)


@pytest.mark.parametrize(
    ("height", "radius"),
    [(0.1, 1.0), (0.8, 1.0), (1.0, 1.0), (1.0, 0.9), (2.0, 0.1)],
    ids=["flat", "blunt", "square", "just pointed", "needle"],
)
def test_the_ball_of_a_cone_is_the_least_one(height: float, radius: float) -> None:
    """Of a flat cone the ball about its base; of a pointed one that through apex and rim."""
    cone = Cone(radius, height).pieces()[0]
    center, least = cone.bounding_sphere()
    # By symmetry the best centre is on the axis: a fine search along it.
    best = minimize_scalar(
        lambda z: max(np.hypot(radius, z + height / 2.0), abs(height / 2.0 - z)),
        bounds=(-height, height), method="bounded", options={"xatol": 1e-12},
    )  # fmt: skip
    assert least == pytest.approx(best.fun, abs=1e-7)
    assert center == pytest.approx([0.0, 0.0, best.x], abs=1e-6)


def test_the_box_holds_the_piece_and_touches_it_on_all_sides() -> None:
    random = np.random.default_rng(2)
    for _ in range(10):
        for piece in convex_pieces(random):
            box, outline = piece.local_box(), rim(piece)
            wide = np.ptp(outline, axis=0) / 2.0 + offset(piece)
            np.testing.assert_allclose(box[3:], wide, atol=1e-4)
            np.testing.assert_allclose(
                box[:3], (outline.min(axis=0) + outline.max(axis=0)) / 2.0, atol=1e-4
            )
            T = np.linalg.inv(piece.T_owner_piece)
            inside = points_inside(piece, random) @ T[:3, :3].T + T[:3, 3]
            assert (np.abs(inside - box[:3]) <= box[3:] + 1e-12).all()


def test_a_capsule_has_the_radius_of_its_ends_on_all_sides() -> None:
    (capsule,) = Capsule(0.1, 0.6).pieces()
    assert capsule.local_box() == pytest.approx([0.0, 0.0, 0.0, 0.1, 0.1, 0.4])
    assert capsule.bounding_sphere()[1] == pytest.approx(0.4)


def test_a_halfspace_is_in_no_ball_and_ends_at_its_face() -> None:
    center, radius = FLOOR.bounding_sphere()
    assert radius == np.inf
    assert center[2] == pytest.approx(-0.3)
    assert np.isinf(FLOOR.local_box()[3:]).all()


def test_only_centred_boxes_without_an_offset_have_half_sizes() -> None:
    random = np.random.default_rng(3)
    half = np.array([0.1, 0.2, 0.3])
    corners = Box(2.0 * half).pieces()[0].vertices
    for order in [np.arange(8), random.permutation(8)]:
        piece = Piece(PieceKind.POLYTOPE, random_transform(random), corners[order])
        np.testing.assert_array_equal(piece.box_half_sizes(), half)
    # The eighth corner twice the seventh: all have the same sizes, but one octant is empty.
    folded = np.vstack([corners[:7], corners[6:7]])
    sheared = corners.copy()
    sheared[7, 0] += 1e-6
    wrong = {"seven": corners[:7], "folded": folded, "sheared": sheared, "aside": corners + 0.01}
    for name, points in wrong.items():
        piece = Piece(PieceKind.POLYTOPE, np.eye(4), points)
        assert piece.box_half_sizes() is None, name
    for shape in (Sphere(0.1), Cylinder(0.1, 0.2), Cone(0.1, 0.2), Capsule(0.1, 0.2)):
        assert shape.pieces()[0].box_half_sizes() is None
    # A box with rounded edges has the corners of a box.
    round_edges = Piece(PieceKind.POLYTOPE, np.eye(4), corners, 0.0, 0.0, 0.01)
    assert round_edges.box_half_sizes() is None


def test_placing_moves_and_keeps_all_else() -> None:
    random = np.random.default_rng(4)
    for piece in [*convex_pieces(random), FLOOR]:
        A, B = random_transform(random), random_transform(random)
        moved = piece.placed(B).placed(A)
        np.testing.assert_allclose(moved.T_owner_piece, A @ B @ piece.T_owner_piece, atol=1e-12)
        assert moved.vertices is piece.vertices
        assert (moved.kind, moved.radius, moved.half_height) == (
            piece.kind, piece.radius, piece.half_height
        )  # fmt: skip
        np.testing.assert_array_equal(moved.local_box(), piece.local_box())
        assert moved.surface is piece.surface
        center, radius = piece.bounding_sphere()
        new_center, new_radius = piece.placed(A).bounding_sphere()
        assert new_radius == radius
        np.testing.assert_allclose(new_center, A[:3, :3] @ center + A[:3, 3], atol=1e-12)


def test_a_piece_can_not_be_written_to() -> None:
    T, corners = np.eye(4), np.array([[0.0, 0.0, 1.0]])
    piece = Piece(PieceKind.POLYTOPE, T, corners)
    T[0, 3], corners[0, 0] = 7.0, 7.0
    assert piece.T_owner_piece[0, 3] == 0.0
    assert piece.vertices[0, 0] == 0.0
    for array in (piece.T_owner_piece, piece.vertices, piece.placed(T).T_owner_piece):
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 1.0


def test_what_is_answered_about_a_piece_may_be_written_to() -> None:
    """Cores are kept from call to call: what one caller writes no other one sees."""
    (box,) = Box(np.array([0.1, 0.2, 0.3])).pieces()
    before = box.local_box()
    box.local_box()[:] = 9.0
    np.testing.assert_array_equal(box.local_box(), before)


def test_packing_says_of_each_piece_what_it_says_itself() -> None:
    random = np.random.default_rng(5)
    pieces = [*convex_pieces(random), FLOOR, *convex_pieces(random)]
    for order in (np.arange(len(pieces)), random.permutation(len(pieces))):
        chosen = [pieces[k] for k in order]
        packed = PieceArrays.pack(chosen)
        assert len(packed) == len(chosen)
        assert packed.starts[0] == 0
        for k, piece in enumerate(chosen):
            center, radius = piece.bounding_sphere()
            assert packed.kinds[k] == piece.kind
            corners = packed.vertices[packed.starts[k] : packed.starts[k + 1]]
            np.testing.assert_array_equal(corners, piece.vertices)
            np.testing.assert_array_equal(packed.poses[k], piece.T_owner_piece)
            np.testing.assert_allclose(packed.centers[k], center, atol=1e-12)
            assert packed.radii[k] == pytest.approx(radius, abs=1e-12)
            np.testing.assert_allclose(packed.boxes[k], piece.local_box(), atol=1e-12)
            assert packed.sizes[k, :2].tolist() == [piece.radius, piece.half_height]


@pytest.mark.parametrize("cuts", [[0, 3], [1, 2, 6], [7], [0, 0, 9]])
def test_joined_blocks_are_what_packs_together(cuts: list[int]) -> None:
    first, second = (convex_pieces(np.random.default_rng(seed)) for seed in (6, 7))
    pieces = [*first, FLOOR, *second]
    ends = itertools.pairwise([0, *cuts, len(pieces)])
    blocks = [PieceArrays.pack(pieces[i:j]) for i, j in ends]
    assert_same(PieceArrays.joined(blocks), PieceArrays.pack(pieces))


def test_balls_of_a_cloud_are_those_of_its_pieces() -> None:
    random = np.random.default_rng(8)
    cloud, T = PointCloud(random.normal(size=(17, 3)), 0.07), random_transform(random)
    one_by_one = PieceArrays.pack([piece.placed(T) for piece in cloud.pieces()])
    assert_same(PieceArrays.balls(cloud.points, 0.07, T), one_by_one)


def test_no_pieces_pack_to_nothing() -> None:
    empty = PieceArrays.pack(())
    assert len(empty) == 0
    assert empty.starts.tolist() == [0]
    assert empty.vertices.shape == (0, 3)
    full = PieceArrays.pack(convex_pieces(np.random.default_rng(9)))
    assert_same(PieceArrays.joined([empty, full, empty]), full)


def test_packed_arrays_can_not_be_written_to() -> None:
    packed = PieceArrays.pack(convex_pieces(np.random.default_rng(10)))
    for name in COLUMNS:
        with pytest.raises(ValueError, match="read-only"):
            getattr(packed, name)[:] = 0


def test_equal_cores_at_other_places_do_not_mix() -> None:
    """Cores are shared by their content: a cone and a cylinder of the same sizes are two."""
    cone, cylinder = Cone(0.2, 0.3).pieces()[0], Cylinder(0.2, 0.3).pieces()[0]
    assert cone.bounding_sphere()[1] != cylinder.bounding_sphere()[1]
    turned = transform(from_axis_angle(np.array([1.0, 0.0, 0.0]), np.pi), [0.0, 0.0, 1.0])
    up, down = cone.bounding_sphere()[0], cone.placed(turned).bounding_sphere()[0]
    assert down == pytest.approx(turned[:3, :3] @ up + [0.0, 0.0, 1.0])
    assert turned_bounds(Convex(np.eye(3)).pieces()[0]) == pytest.approx([1.0, 1.0, 1.0])


def turned_bounds(piece: Piece) -> Array:
    return np.asarray(piece.vertices.max(axis=0))
