"""Contacts: depth, direction and point of overlapping solids, by closed forms and by Qhull."""

import itertools

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from kinematics.arrays import Array
from kinematics.pose import transform
from obstacles.convex.piece import Piece
from obstacles.shapes.shape import Box, Capsule, Convex, Cylinder, HalfSpace, Shape, Sphere
from tests.obstacles.collision.test_proximity import found as contact
from tests.obstacles.outline import convex_pieces
from tests.obstacles.solids import random_transform


def at(shape: Shape, place: list[float] | Array, T: Array | None = None) -> Piece:
    (piece,) = shape.pieces()
    return piece.placed(transform(None, place) @ (np.eye(4) if T is None else T))


def polytope_depth(a: Array, b: Array) -> float:
    """Signed distance of hulls that overlap, by all faces of their Minkowski difference."""
    differences = (a[:, None] - b[None]).reshape(-1, 3)
    return float(ConvexHull(differences).equations[:, 3].max())


@pytest.mark.parametrize("distance", [0.05, 0.2, 0.29, 0.31, 1.0])
def test_balls(distance: float) -> None:
    random = np.random.default_rng(1)
    for _ in range(10):
        towards = random.normal(size=3)
        towards /= np.linalg.norm(towards)
        place = random.normal(size=3)
        value, n, point = contact(
            at(Sphere(0.1), place + distance * towards), at(Sphere(0.2), place)
        )
        assert value == pytest.approx(distance - 0.3, abs=1e-9)
        np.testing.assert_allclose(n, towards, atol=1e-7)
        np.testing.assert_allclose(point, place + 0.2 * towards, atol=1e-7)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_boxes_part_along_their_shallowest_side(axis: int, sign: float) -> None:
    shift = np.array([0.05, -0.03, 0.02])
    shift[axis] = sign * 0.9
    value, n, point = contact(at(Box(np.ones(3)), shift), at(Box(np.ones(3)), np.zeros(3)))
    assert value == pytest.approx(-0.1)
    np.testing.assert_allclose(n, sign * np.eye(3)[axis], atol=1e-9)
    assert point[axis] == pytest.approx(0.5 * sign)


def test_polytopes_are_as_deep_as_their_minkowski_difference() -> None:
    random = np.random.default_rng(2)
    for _ in range(20):
        a = at(Convex(random.normal(size=(12, 3))), random.normal(size=3) * 0.3)
        b = at(Convex(random.normal(size=(9, 3))), np.zeros(3), random_transform(random, 0.1))
        corners = [p.vertices @ p.T_owner_piece[:3, :3].T + p.T_owner_piece[:3, 3] for p in (a, b)]
        assert contact(a, b)[0] == pytest.approx(polytope_depth(*corners), abs=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_moved_out_by_its_depth_it_touches_no_more(seed: int) -> None:
    random = np.random.default_rng(10 + seed)
    overlaps = 0
    for a, b in itertools.combinations(convex_pieces(random), 2):
        near = a.placed(transform(None, 0.6 * (b.T_owner_piece[:3, 3] - a.T_owner_piece[:3, 3])))
        depth, n, _ = contact(near, b)
        if depth > -1e-3:
            continue
        overlaps += 1
        out = near.placed(transform(None, (-depth + 1e-6) * n))
        assert contact(out, b)[0] > -1e-9
        # Half of the way is not enough.
        assert contact(near.placed(transform(None, -0.5 * depth * n)), b)[0] < 0.0
    assert overlaps > 3


def test_concentric_solids_part_by_the_shortest_way() -> None:
    box, ball = Box(np.array([0.2, 0.4, 0.6])), Sphere(0.05)
    value, n, _ = contact(at(ball, np.zeros(3)), at(box, np.zeros(3)))
    assert value == pytest.approx(-0.15)
    assert np.abs(n) == pytest.approx([1.0, 0.0, 0.0])
    assert contact(at(ball, np.zeros(3)), at(ball, np.zeros(3)))[0] == pytest.approx(-0.1)


def test_crossing_capsules_part_across_both() -> None:
    turn = np.eye(4)
    turn[:3, :3] = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]
    along_z, along_x = at(Capsule(0.1, 1.0), np.zeros(3)), at(Capsule(0.1, 1.0), [0, 0.05, 0], turn)
    value, n, _ = contact(along_x, along_z)
    assert value == pytest.approx(-0.15)
    np.testing.assert_allclose(n, [0.0, 1.0, 0.0], atol=1e-7)


@pytest.mark.parametrize("height", [-0.05, 0.0, 0.05])
def test_a_halfspace_is_left_upwards(height: float) -> None:
    floor = at(HalfSpace(np.array([0.0, 0.0, 1.0]), 0.0), np.zeros(3))
    for shape in (Sphere(0.1), Box(np.full(3, 0.2)), Cylinder(0.1, 0.2)):
        solid = at(shape, [0.3, 0.2, 0.1 + height])
        value, n, point = contact(solid, floor)
        assert value == pytest.approx(height, abs=1e-12)
        np.testing.assert_allclose(n, [0.0, 0.0, 1.0])
        assert point[2] == pytest.approx(0.0, abs=1e-12)
        value, n, point = contact(floor, solid)
        assert value == pytest.approx(height, abs=1e-12)
        np.testing.assert_allclose(n, [0.0, 0.0, -1.0])
        # The point is always of the second solid: its lowest one.
        assert point[2] == pytest.approx(height, abs=1e-12)


def test_flat_pieces_have_a_depth_where_their_difference_has_one() -> None:
    """A segment through a square is left sideways; a square in its own plane at once."""
    square = at(Convex(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])), np.zeros(3))
    needle = Convex(np.array([[0.4, 0.5, -1.0], [0.4, 0.5, 1.0]]))
    assert contact(at(needle, np.zeros(3)), square)[0] == pytest.approx(-0.4)
    assert contact(at(needle, [0, 0, 0.9]), square)[0] == pytest.approx(-0.1)
    assert contact(at(needle, [0, 0, 1.5]), square)[0] == pytest.approx(0.5)
    assert contact(square, square)[0] == pytest.approx(0.0, abs=1e-9)


def test_the_deepest_point_lies_on_the_surface_around_the_core() -> None:
    """A box holds the axis of a capsule: its way out is the axis' depth and the radius."""
    capsule = at(Capsule(0.1, 0.4), np.zeros(3))
    value, n, point = contact(at(Box(np.ones(3)), [0.45, 0.0, 0.0]), capsule)
    assert value == pytest.approx(-0.15)
    np.testing.assert_allclose(n, [1.0, 0.0, 0.0], atol=1e-9)
    assert point[0] == pytest.approx(0.1)
    assert abs(point[2]) <= 0.2 + 1e-9
