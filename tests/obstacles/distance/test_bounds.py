"""Cheap bounds: below coal's distances on every pair, and planes that prove them."""

import itertools

import numpy as np
import pytest

from obstacles.convex.piece import Piece, PieceKind
from obstacles.distance.bounds import balls_apart, quick_bound
from obstacles.distance.piece_set import PieceSet
from tests.obstacles.solids import KINDS, NO_VERTICES, coal_distance, random_solid, random_transform


@pytest.mark.parametrize(("one", "other"), list(itertools.combinations_with_replacement(KINDS, 2)))
def test_no_bound_is_above_the_distance(one: str, other: str) -> None:
    random = np.random.default_rng(1)
    for _ in range(20):
        T_a, T_b = random_transform(random, 0.6), random_transform(random, 0.6)
        a, coal_a = random_solid(random, one, T_a)
        b, coal_b = random_solid(random, other, T_b)
        distance = max(coal_distance(coal_a, T_a, coal_b, T_b), 0.0)
        rows = PieceSet.of([a, b]).rows
        bound, n = quick_bound(rows, 0, rows, 1, np.inf)
        assert bound <= distance + 1e-7
        assert balls_apart(rows, 0, 1) <= bound + 1e-12
        early, _ = quick_bound(rows, 0, rows, 1, -np.inf)
        assert early <= bound + 1e-12
        if bound > 0.0:
            assert np.linalg.norm(n) == pytest.approx(1.0)


def test_of_boxes_face_to_face_it_is_the_distance_from_the_ball_of_the_other() -> None:
    corners = np.array(list(itertools.product((-1.0, 1.0), repeat=3))) * [0.5, 0.5, 0.1]
    flat = Piece(PieceKind.POLYTOPE, np.eye(4), corners)
    above = np.eye(4)
    above[2, 3] = 1.0
    ball = Piece(PieceKind.POLYTOPE, above, np.zeros((1, 3)), offset_radius=0.2)
    rows = PieceSet.of([ball, flat]).rows
    bound, n = quick_bound(rows, 0, rows, 1, np.inf)
    assert bound == pytest.approx(0.7)
    assert n == pytest.approx((0.0, 0.0, 1.0))


def test_of_a_half_space_it_is_the_height_of_the_ball() -> None:
    floor = Piece(PieceKind.HALFSPACE, np.eye(4), NO_VERTICES)
    above = np.eye(4)
    above[:3, 3] = 3.0, -2.0, 0.5
    ball = Piece(PieceKind.POLYTOPE, above, np.zeros((1, 3)), offset_radius=0.2)
    rows = PieceSet.of([floor, ball]).rows
    bound, n = quick_bound(rows, 0, rows, 1, np.inf)
    assert bound == pytest.approx(0.3)
    assert n == pytest.approx((0.0, 0.0, -1.0))
