"""Pieces: balls and boxes hold them and no more, moving and packing change nothing else."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from obstacles.shapes.shape import (
    Capsule,
    Cone,
    HalfSpace,
)
from tests.obstacles.outline import convex_pieces, offset, owned, points_inside, rim

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
