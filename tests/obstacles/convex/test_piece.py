"""Pieces: balls and boxes hold them and no more, moving and packing change nothing else."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from kinematics.arrays import Array
from kinematics.pose import from_axis_angle, transform
from obstacles.convex.piece import Piece
from obstacles.shapes.shape import (
    Capsule,
    Cone,
    Convex,
    Cylinder,
    HalfSpace,
)
from tests.obstacles.outline import convex_pieces, offset, owned, points_inside, rim
from tests.obstacles.solids import random_transform

FLOOR = HalfSpace(np.array([0.0, 0.0, 1.0]), -0.3).pieces()[0]


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
