"""Witnesses prove no more than is true, and the best one proves all of it."""

import itertools

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.pose import transform
from obstacles.convex.piece import Piece, PieceArrays, PieceKind
from obstacles.distance.signed_distance import halfspace_distance, signed_distance
from planning.proof.collision.separating_direction import direction, gap, highest, rounding_bound
from tests.obstacles.solids import KINDS, NO_VERTICES, coal_distance, random_solid, random_transform


def proved(pieces: list[Piece], u: Array) -> float:
    """What u proves of the first two pieces' distance; minus infinity where it is no direction."""
    arrays = PieceArrays.pack(pieces)
    columns = np.ascontiguousarray(arrays.vertices.T)
    some, n = direction(arrays.kinds, arrays.poses, 0, 1, (u[0], u[1], u[2]))
    if not some:
        return -np.inf
    found, _ = gap(arrays.kinds, arrays.sizes, columns, arrays.starts, arrays.poses, 0, 1, n)
    return float(found)


@pytest.mark.parametrize(("one", "other"), list(itertools.combinations_with_replacement(KINDS, 2)))
def test_no_direction_proves_more_than_the_distance(one: str, other: str) -> None:
    random = np.random.default_rng(10 * KINDS.index(one) + KINDS.index(other))
    sharpest = -np.inf
    for _ in range(4):
        T_a, T_b = random_transform(random), random_transform(random)
        (a, coal_a), (b, coal_b) = random_solid(random, one, T_a), random_solid(random, other, T_b)
        distance = coal_distance(coal_a, T_a, coal_b, T_b)
        if distance <= 0.0:
            distance = signed_distance(a, T_a, b, T_b)[1]
        towards = T_b[:3, 3] - T_a[:3, 3]
        for spread in (0.0, 0.3, 3.0):
            for u in towards + spread * random.normal(size=(20, 3)):
                found = proved([a, b], u)
                assert found <= distance + 1e-7
                sharpest = max(sharpest, found - distance)
    assert sharpest > -0.05


def test_best_direction_proves_the_distance() -> None:
    ball = Piece(PieceKind.POLYTOPE, np.eye(4), np.zeros((1, 3)), offset_radius=0.1)
    T = transform(None, [3.0, 4.0, 0.0])
    other = Piece(PieceKind.POLYTOPE, T, np.zeros((1, 3)), offset_radius=0.2)
    assert proved([ball, other], np.array([3.0, 4.0, 0.0])) == pytest.approx(4.7)
    assert proved([ball, other], np.array([-3.0, -4.0, 0.0])) == pytest.approx(-5.3)


@pytest.mark.parametrize("kind", KINDS)
def test_halfspace_is_proved_from_its_normal_whatever_is_proposed(kind: str) -> None:
    random = np.random.default_rng(2)
    for _ in range(10):
        T, H = random_transform(random), random_transform(random)
        solid, _ = random_solid(random, kind, T)
        ground = Piece(PieceKind.HALFSPACE, H, NO_VERTICES)
        true = halfspace_distance(solid, T, H)
        assert proved([ground, solid], random.normal(size=3)) == pytest.approx(true, abs=1e-12)
        assert proved([solid, ground], random.normal(size=3)) == -np.inf


@pytest.mark.parametrize("u", [[0, 0, 0], [np.nan, 0, 1], [np.inf, 0, 0], [0, -np.inf, np.inf]])
def test_what_is_no_direction_proves_nothing(u: list[float]) -> None:
    ball = Piece(PieceKind.POLYTOPE, np.eye(4), np.zeros((1, 3)), offset_radius=0.1)
    T = np.eye(4)
    T[0, 3] = 1.0
    assert proved([ball, Piece(PieceKind.POLYTOPE, T, np.zeros((1, 3)))], np.array(u)) == -np.inf


def test_rounding_grows_with_lengths_and_stays_far_below_what_is_decided() -> None:
    assert 0.0 < rounding_bound(7, 3.0) < 1e-12
    assert rounding_bound(7, 6.0) == pytest.approx(2.0 * rounding_bound(7, 3.0))


@pytest.mark.parametrize("count", [0, 1, 7, 8, 9, 15, 16, 17, 40, 133])
def test_the_highest_of_some_columns_is_that_of_all_their_products(count: int) -> None:
    random = np.random.default_rng(count)
    for _ in range(20):
        columns, (x, y, z) = random.normal(size=(3, count + 9)), random.normal(size=3)
        start = int(random.integers(0, 9))
        products = np.array([x, y, z]) @ columns[:, start : start + count]
        found = highest(columns, start, start + count, x, y, z)
        assert found == pytest.approx(products.max(initial=-np.inf), rel=1e-14, abs=1e-15)
