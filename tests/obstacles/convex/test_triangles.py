"""Triangles of pieces: closed, outward, and of the volume of the solid they draw."""

import math

import numpy as np
import pytest

from obstacles.convex.triangles import Triangles, join, piece_triangles
from obstacles.shapes.shape import (
    Box,
    Capsule,
    Cone,
    Convex,
    Cylinder,
    HalfSpace,
    Mesh,
    Shape,
    Sphere,
)

CORNERS = np.array([[0, 0, 0], [0.3, 0, 0], [0, 0.3, 0], [0, 0, 0.3]], dtype=float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


def volume(surface: Triangles) -> float:
    """Volume enclosed by a surface, positive where its triangles face outward [m^3]."""
    a, b, c = (surface.vertices[surface.faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


@pytest.mark.parametrize(
    ("shape", "expected", "least"),
    [
        (Box([0.1, 0.2, 0.3]), 0.006, 1.0),
        (Sphere(0.2), 4.0 / 3.0 * math.pi * 0.008, 0.9),
        (Cylinder(0.1, 0.4), math.pi * 0.004, 0.99),
        (Cone(0.1, 0.3), math.pi * 0.001, 0.99),
        (Capsule(0.1, 0.4), math.pi * 0.004 + 4.0 / 3.0 * math.pi * 0.001, 0.9),
        (Convex(CORNERS), 0.0045, 1.0),
        (Mesh(CORNERS, FACES), 0.0045, 1.0),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, Shape) else "",
)
def test_a_surface_encloses_its_solid(shape: Shape, expected: float, least: float) -> None:
    surface = join(piece_triangles(piece) for piece in shape.pieces())
    assert least * expected * (1 - 1e-6) <= volume(surface) <= expected * (1 + 1e-6)
    edges = np.sort(surface.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    counts = np.unique(edges, axis=0, return_counts=True)[1]
    assert (counts == 2).all()


def test_a_half_space_is_a_square_on_its_plane() -> None:
    (piece,) = HalfSpace([0.0, 0.6, 0.8], 0.5).pieces()
    surface = piece_triangles(piece)
    assert surface.vertices @ [0.0, 0.6, 0.8] == pytest.approx(np.full(4, 0.5))


def test_parts_keep_their_triangles_and_share_their_corners() -> None:
    (piece,) = Box([0.1, 0.2, 0.3]).pieces()
    one = piece_triangles(piece)
    both = join([one, Triangles(one.vertices + np.array([0.1, 0.0, 0.0]), one.faces)])
    assert len(both.faces) == 2 * len(one.faces)
    assert len(both.vertices) == 12
    assert volume(both) == pytest.approx(2 * 0.006)
