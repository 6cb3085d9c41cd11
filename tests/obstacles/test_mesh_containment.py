"""Points inside of meshes, by winding numbers, against where the solids are known to be."""

import numpy as np
import pytest
import trimesh

from kinematics.arrays import Array
from obstacles.mesh_containment import encloses, inside_box
from obstacles.piece import Piece
from obstacles.shapes import Box, Convex, HalfSpace
from tests.obstacles.arms import cup, in_cup, mesh_shape
from tests.obstacles.outline import convex_pieces, points_inside
from tests.obstacles.solids import random_transform


def group(mesh: trimesh.Trimesh) -> list[Piece]:
    return [piece for piece in mesh_shape(mesh).pieces() if piece.surface is not None]


def placed(points: Array, T: Array) -> Array:
    return np.asarray(points @ T[:3, :3].T + T[:3, 3])


def test_points_of_a_cup_are_inside_its_walls_and_not_in_its_hollow() -> None:
    random = np.random.default_rng(1)
    points = random.uniform(-0.25, 0.25, (600, 3))
    for T in (np.eye(4), random_transform(random)):
        np.testing.assert_array_equal(encloses(group(cup()), T, placed(points, T)), in_cup(points))


def test_which_way_round_the_triangles_are_does_not_matter() -> None:
    inverted = cup()
    inverted.invert()
    points = np.random.default_rng(2).uniform(-0.25, 0.25, (200, 3))
    np.testing.assert_array_equal(encloses(group(inverted), np.eye(4), points), in_cup(points))


def test_all_pieces_of_a_group_bound_it_together() -> None:
    """One alone is an open surface and encloses next to nothing of it."""
    pieces = group(cup())
    assert len(pieces) > 1
    points = np.random.default_rng(3).uniform(-0.2, 0.2, (400, 3))
    inside = in_cup(points)
    alone = [encloses([piece], np.eye(4), points) for piece in pieces]
    assert max(np.count_nonzero(own & inside) for own in alone) < 0.8 * inside.sum()


def test_a_shell_does_not_enclose_its_cavity() -> None:
    """Two cubes, the inner one turned inside out: between them is the solid."""
    outer, inner = trimesh.creation.box([2.0] * 3), trimesh.creation.box([1.0] * 3)
    inner.invert()
    triangles = np.vstack([outer.triangles, inner.triangles])
    pieces = group(trimesh.Trimesh(**trimesh.triangles.to_kwargs(triangles)))
    if not pieces:
        pytest.fail("a shell has triangles that decide")
    points = np.random.default_rng(4).uniform(-1.2, 1.2, (300, 3))
    reach = np.abs(points).max(axis=1)
    clear = (np.abs(reach - 1.0) > 1e-3) & (np.abs(reach - 0.5) > 1e-3)
    expected = (reach > 0.5) & (reach < 1.0)
    np.testing.assert_array_equal(encloses(pieces, np.eye(4), points)[clear], expected[clear])


def test_no_points_are_inside_of_anything() -> None:
    assert encloses(group(cup()), np.eye(4), np.zeros((0, 3))).shape == (0,)


@pytest.mark.parametrize("seed", range(3))
def test_the_box_has_all_points_of_its_piece(seed: int) -> None:
    random = np.random.default_rng(seed)
    T = random_transform(random)
    for piece in convex_pieces(random):
        points = points_inside(piece, random)
        frame = T @ piece.T_owner_piece
        middle = placed(piece.local_box()[:3], frame)
        # A hair inside: rounding decides about the faces themselves.
        assert inside_box(piece, frame, middle + 0.999 * (placed(points, T) - middle)).all()
        radius = piece.bounding_sphere()[1]
        beyond = middle + 2.1 * radius * np.vstack([np.eye(3), -np.eye(3)])
        assert not inside_box(piece, frame, beyond).any()


def test_the_box_is_cut_off_at_its_faces() -> None:
    (box,) = Box(np.array([0.2, 0.4, 0.6])).pieces()
    points = np.array([[0.1, 0, 0], [0.1 + 1e-9, 0, 0], [0, -0.2, 0], [0, 0, -0.31], [0, 0.2, 0.3]])
    assert inside_box(box, np.eye(4), points).tolist() == [True, False, True, False, True]
    (aside,) = Convex(np.array([[1.0, 1, 1], [2, 1, 1], [1, 3, 1], [1, 1, 4]])).pieces()
    points = np.array([[1.5, 2.0, 2.0], [0.9, 2.0, 2.0], [2.0, 3.0, 4.0]])
    assert inside_box(aside, np.eye(4), points).tolist() == [True, False, True]


def test_points_that_are_nowhere_are_in_no_box() -> None:
    """A half-space among the obstacles has no point: infinity stands for it."""
    (box,) = Box(np.full(3, 0.2)).pieces()
    lost = np.array([[np.inf, np.inf, np.inf], [np.nan, 0.0, 0.0], [0.0, 0.0, -np.inf]])
    turned = random_transform(np.random.default_rng(5))
    for T in (np.eye(4), turned):
        assert not inside_box(box, T, lost).any()


def test_the_box_of_a_halfspace_is_everything_finite() -> None:
    (floor,) = HalfSpace(np.array([0.0, 0.0, 1.0]), 0.0).pieces()
    assert inside_box(floor, np.eye(4), np.random.default_rng(6).normal(size=(5, 3))).all()
