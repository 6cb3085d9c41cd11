"""Signed distances: closed forms, separating axes, and coal where solids are apart."""

import itertools

import fcl
import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.pose import align_z, transform
from obstacles.convex.piece import Piece, PieceKind
from obstacles.distance.fcl_solid import (
    UNITS,
    FclSolid,
    fcl_solid,
    separation,
)
from obstacles.distance.signed_distance import halfspace_distance, plane_bound, signed_distance
from obstacles.shapes.shape import HalfSpace
from tests.obstacles.outline import convex_pieces
from tests.obstacles.solids import (
    KINDS,
    NO_VERTICES,
    random_solid,
    random_transform,
)

SIGNS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])


def box(size: Array) -> Piece:
    return Piece(PieceKind.POLYTOPE, np.eye(4), SIGNS * size / 2.0)


def ball(radius: float) -> Piece:
    return Piece(PieceKind.POLYTOPE, np.eye(4), np.zeros((1, 3)), offset_radius=radius)


def cylinder(radius: float, half_height: float) -> Piece:
    return Piece(PieceKind.CYLINDER, np.eye(4), NO_VERTICES, radius, half_height)


def cone(radius: float, half_height: float) -> Piece:
    return Piece(PieceKind.CONE, np.eye(4), NO_VERTICES, radius, half_height)


def separating_axes(a: Array, T_a: Array, b: Array, T_b: Array) -> float:
    """Depth of two overlapping boxes of half sizes a and b: least overlap over the 15 axes."""
    A, B, gap = T_a[:3, :3], T_b[:3, :3], T_b[:3, 3] - T_a[:3, 3]
    axes = [*A.T, *B.T, *(np.cross(u, v) for u in A.T for v in B.T)]
    depths = []
    for axis in axes:
        length = np.linalg.norm(axis)
        if length > 1e-9:
            n = axis / length
            depths.append(float(np.abs(n @ A) @ a + np.abs(n @ B) @ b - abs(n @ gap)))
    return min(depths)


def test_overlapping_boxes_by_their_separating_axes() -> None:
    random = np.random.default_rng(12)
    for trial in range(40):
        a, b = random.uniform(0.1, 1.0, 3), random.uniform(0.1, 1.0, 3)
        T_a, T_b = random_transform(random, 0.1), random_transform(random, 0.1)
        if trial % 3 == 0:
            T_b[:3, :3] = T_a[:3, :3]
        expected = separating_axes(a / 2.0, T_a, b / 2.0, T_b)
        if expected > 0.0:
            lower, upper = signed_distance(box(a), T_a, box(b), T_b)
            assert lower == pytest.approx(-expected, abs=1e-7)
            assert upper == pytest.approx(-expected, abs=1e-7)


def test_a_ball_in_a_cylinder_or_cone() -> None:
    random = np.random.default_rng(13)
    for _ in range(25):
        radius, half = random.uniform(0.2, 1.0, 2)
        direction = random.normal(size=2)
        x, y = 0.9 * random.uniform() * radius * direction / np.linalg.norm(direction)
        z = 0.9 * random.uniform(-1.0, 1.0) * half
        T = transform(None, [x, y, z])
        expected = min(radius - np.hypot(x, y), half - abs(z)) + 0.05
        lower, upper = signed_distance(cylinder(radius, half), np.eye(4), ball(0.05), T)
        # The way out through the round side, from near the axis, has no one direction.
        assert lower <= -expected + 1e-9
        assert lower == pytest.approx(-expected, abs=2e-4)
        assert upper >= -expected - 1e-9
        slope = np.array([2.0 * half, radius]) / np.hypot(2.0 * half, radius)
        inside = float(slope @ [-np.hypot(x, y), half - z])
        if inside > 0.0:
            expected = min(inside, half + z) + 0.05
            lower, _ = signed_distance(cone(radius, half), np.eye(4), ball(0.05), T)
            assert lower == pytest.approx(-expected, abs=2e-4)


def test_coaxial_cylinders_are_bounded_although_no_direction_is_nearest() -> None:
    lower, upper = signed_distance(cylinder(0.3, 1.0), np.eye(4), cylinder(0.2, 1.0), np.eye(4))
    assert lower - 1e-12 <= -0.5 <= upper + 1e-12
    assert upper - lower < 1e-3


def test_solids_without_inside() -> None:
    square = Piece(PieceKind.POLYTOPE, np.eye(4), SIGNS * [0.5, 0.5, 0.0])
    needle = Piece(PieceKind.POLYTOPE, np.eye(4), np.array([[0.0, 0, -1], [0, 0, 1]]))
    point = Piece(PieceKind.POLYTOPE, np.eye(4), np.zeros((1, 3)))
    here, off = np.eye(4), transform(None, [0.0, 0.0, 0.25])
    aside = transform(None, [0.75, 0.0, 0.0])
    for a, T_a, b, T_b, expected in [
        (square, here, square, off, 0.25),
        (square, here, square, here, 0.0),
        (square, here, needle, off, -0.5),  # pierced: out sideways
        (square, here, needle, aside, 0.25),
        (needle, here, needle, aside, 0.75),
        (needle, here, needle, here, 0.0),
        (point, here, point, here, 0.0),
        (point, here, point, off, 0.25),
        (point, off, square, here, 0.25),
    ]:
        for bound in signed_distance(a, T_a, b, T_b):
            assert bound == pytest.approx(expected, abs=1e-9)


def test_the_halfspace_by_its_lowest_point() -> None:
    random = np.random.default_rng(15)
    for _ in range(50):
        n, offset = random.normal(size=3), random.normal()
        n /= np.linalg.norm(n)
        T_h = transform(align_z(n), offset * n)
        T = random_transform(random)
        center, axis = T[:3, 3], T[:3, 2]
        across = float(np.linalg.norm(np.cross(axis, n)))
        height = float(n @ center) - offset
        lowest = 0.3 * across + 0.5 * abs(float(axis @ n))
        assert halfspace_distance(cylinder(0.3, 0.5), T, T_h) == pytest.approx(height - lowest)
        assert halfspace_distance(ball(0.3), T, T_h) == pytest.approx(height - 0.3)
        reach = float(np.abs(n @ T[:3, :3]) @ [0.1, 0.2, 0.3])
        size = np.array([0.2, 0.4, 0.6])
        assert halfspace_distance(box(size), T, T_h) == pytest.approx(height - reach)
        up = 0.5 * float(axis @ n)
        expected = height + min(up, -up - 0.3 * across)
        assert halfspace_distance(cone(0.3, 0.5), T, T_h) == pytest.approx(expected)


def test_no_direction_proves_more_than_there_is() -> None:
    random = np.random.default_rng(16)
    for kind_a, kind_b in itertools.product(KINDS, KINDS):
        T_a, T_b = random_transform(random), random_transform(random)
        a, _ = random_solid(random, kind_a, T_a)
        b, _ = random_solid(random, kind_b, T_b)
        _, upper = signed_distance(a, T_a, b, T_b)
        sizes = [np.array([p.radius, p.half_height]) for p in (a, b)]
        for n in [*random.normal(size=(30, 3)), np.zeros(3), np.full(3, np.nan)]:
            bound = plane_bound(
                int(a.kind), a.vertices, sizes[0], T_a, int(b.kind), b.vertices, sizes[1], T_b, n
            )
            assert bound - a.offset_radius - b.offset_radius <= upper + 1e-12


def moved(piece: Piece, T: Array | None = None) -> FclSolid:
    solid = fcl_solid(piece)
    solid.move(piece.T_owner_piece if T is None else T)
    return solid


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


def test_a_halfspace_is_refused() -> None:
    (floor,) = HalfSpace(np.array([0.0, 0.0, 1.0]), 0.0).pieces()
    with pytest.raises(ValueError, match="half-space"):
        fcl_solid(floor)
