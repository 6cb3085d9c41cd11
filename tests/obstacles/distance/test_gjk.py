"""Separation of convex pieces, against coal and closed forms."""

import itertools

import coal
import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.pose import transform
from obstacles.convex.piece import Piece, PieceKind
from obstacles.distance.gjk import BETWEEN, CLOSER, FARTHER, STILL, separation
from obstacles.distance.piece_set import CENTER, Pair, PieceSet
from tests.obstacles.solids import (
    KINDS,
    NO_VERTICES,
    coal_distance,
    random_solid,
    random_transform,
)


def compare(
    a: Piece, b: Piece, near: float = -np.inf, far: float = np.inf, axis: Array | None = None
) -> tuple[int, float, float]:
    rows, corners, tables, _ = PieceSet.of([a, b])
    towards = rows[0, CENTER : CENTER + 3] - rows[1, CENTER : CENTER + 3]
    if axis is not None:
        towards = np.array(axis)
    return separation(
        Pair(rows, 0, rows, 1), corners, tables, near, far, STILL, towards, np.empty((8, 3))
    )


@pytest.mark.parametrize("kinds", list(itertools.combinations_with_replacement(KINDS, 2)))
def test_distance_is_that_of_coal(kinds: tuple[str, str]) -> None:
    random = np.random.default_rng(sum(map(ord, "".join(kinds))))
    apart = 0
    for _ in range(60):
        T_a, T_b = (random_transform(random, 0.6) for _ in range(2))
        (a, coal_a), (b, coal_b) = (
            random_solid(random, kind, T) for kind, T in zip(kinds, (T_a, T_b), strict=True)
        )
        expected = coal_distance(coal_a, T_a, coal_b, T_b)
        _, lower, upper = compare(a, b)
        assert lower <= upper
        if expected > 1e-7:
            apart += 1
            assert lower == pytest.approx(expected, abs=2e-8)
            assert upper == pytest.approx(expected, abs=2e-8)
        else:
            assert lower <= 1e-7
    assert apart > 5


@pytest.mark.parametrize("gap", [1e-9, 1e-6, 1e-3, 1.0, 100.0])
def test_box_face_to_box_face(gap: float) -> None:
    signs = np.array(list(itertools.product((-1, 1), repeat=3))) * 0.5
    a = Piece(PieceKind.POLYTOPE, np.eye(4), signs)
    b = Piece(PieceKind.POLYTOPE, transform(None, [1.0 + gap, 0.2, -0.1]), signs)
    _, lower, upper = compare(a, b)
    # The direction v / |v| is off by the digits of a metre over the gap; the bound then is by the
    # same angle times a metre, and always to the safe side.
    assert gap - (1e-15 / gap + 1e-13) <= lower <= gap + 1e-15
    assert upper == pytest.approx(gap, abs=1e-13, rel=1e-12)


@pytest.mark.parametrize("kinds", list(itertools.product(KINDS, repeat=2)))
def test_bounds_hold_from_any_first_direction(kinds: tuple[str, str]) -> None:
    random = np.random.default_rng(3)
    for _ in range(20):
        (a, coal_a), (b, coal_b) = (
            random_solid(random, kind, random_transform(random, 0.8)) for kind in kinds
        )
        truth = coal_distance(coal_a, a.T_owner_piece, coal_b, b.T_owner_piece)
        threshold = random.uniform(0.0, 1.0)
        start = random.normal(size=3)
        verdict, lower, upper = compare(a, b, near=0.0, far=threshold, axis=start)
        assert lower <= max(truth, 0.0) + 1e-7
        if truth > 1e-7:
            assert upper >= truth - 1e-7
        if verdict == FARTHER:
            assert truth > threshold - 1e-7
        elif verdict == CLOSER:
            assert truth <= 1e-7
        else:
            assert verdict == BETWEEN
            assert -1e-7 < truth <= threshold + 1e-7


def test_halfspace_distance_is_that_of_the_lowest_point() -> None:
    random = np.random.default_rng(4)
    for kind in KINDS:
        for _ in range(20):
            T_floor = random_transform(random)
            floor = Piece(PieceKind.HALFSPACE, T_floor, NO_VERTICES)
            solid, other = random_solid(random, kind, random_transform(random))
            # A very large box under the plane stands for the half-space.
            size = 200.0
            T_box = T_floor @ transform(None, [0.0, 0.0, -size / 2.0])
            expected = coal_distance(coal.Box(size, size, size), T_box, other, solid.T_owner_piece)
            for pair in ((floor, solid), (solid, floor)):
                _, lower, upper = compare(*pair)
                assert lower == upper
                if expected > 1e-6:
                    assert lower == pytest.approx(expected, abs=1e-6)
                else:
                    assert lower <= 1e-6


def test_deep_overlap_and_coincident_centres_are_closer() -> None:
    random = np.random.default_rng(5)
    for kinds in itertools.product(KINDS, repeat=2):
        T = random_transform(random)
        (a, _), (b, _) = (random_solid(random, kind, T) for kind in kinds)
        verdict, lower, _ = compare(a, b, near=0.0, far=1.0, axis=np.zeros(3))
        assert verdict == CLOSER
        assert lower <= 0.0


def test_flat_and_segment_like_polytopes() -> None:
    square = Piece(
        PieceKind.POLYTOPE, np.eye(4), np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
    )
    segment = Piece(
        PieceKind.POLYTOPE, transform(None, [0.1, 0.2, 0.3]), np.array([[0, 0, 0], [0, 0, 1.0]])
    )
    assert compare(square, segment)[1:] == pytest.approx((0.3, 0.3))
    crossing = Piece(PieceKind.POLYTOPE, np.eye(4), np.array([[0, 0, -1.0], [0, 0, 1.0]]))
    assert compare(square, crossing, near=0.0, far=1.0)[0] == CLOSER
