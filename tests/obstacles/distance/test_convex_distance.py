"""Distances that FCL proposes and a plane proves: near the true one, and never above it."""

import itertools

import numpy as np
import pytest

from kinematics.pose import transform
from obstacles.convex.piece import Piece
from obstacles.distance.fcl_solid import Separation, fcl_solid, separation
from obstacles.distance.signed_distance import (
    ACCURACY,
    convex_distance,
    proved_distance,
    signed_distance,
)
from obstacles.shapes.shape import Box, Capsule, HalfSpace, Sphere
from tests.obstacles.outline import convex_pieces
from tests.obstacles.solids import KINDS, coal_distance, random_solid, random_transform


def distance(a: Piece, b: Piece) -> float:
    return convex_distance(a, a.T_owner_piece, b, b.T_owner_piece)


@pytest.mark.parametrize(("one", "other"), list(itertools.combinations_with_replacement(KINDS, 2)))
def test_it_is_the_distance_of_coal(one: str, other: str) -> None:
    random = np.random.default_rng(1)
    apart = 0
    for _ in range(12):
        T_a, T_b = random_transform(random, 0.6), random_transform(random, 0.6)
        a, coal_a = random_solid(random, one, T_a)
        b, coal_b = random_solid(random, other, T_b)
        expected = coal_distance(coal_a, T_a, coal_b, T_b)
        if expected <= 1e-6:
            assert convex_distance(a, T_a, b, T_b) <= 1e-6
            continue
        apart += 1
        assert convex_distance(a, T_a, b, T_b) == pytest.approx(expected, abs=1e-6)
    assert apart > 2


@pytest.mark.parametrize("seed", range(3))
def test_it_is_a_lower_bound_whichever_comes_first(seed: int) -> None:
    for a, b in itertools.combinations(convex_pieces(np.random.default_rng(seed)), 2):
        _, upper = signed_distance(a, a.T_owner_piece, b, b.T_owner_piece)
        assert distance(a, b) <= upper + 1e-12
        assert distance(a, b) == pytest.approx(distance(b, a), abs=1e-6)


def test_a_wrong_proposal_costs_time_and_no_truth() -> None:
    """Too large, in a wrong direction, or none: our own distance is answered instead."""
    (a,), (b,) = Sphere(0.1).pieces(), Box(np.full(3, 0.2)).pieces()
    T_a, T_b = np.eye(4), transform(None, [0.5, 0.0, 0.0])
    one, other = fcl_solid(a), fcl_solid(b)
    one.move(T_a)
    other.move(T_b)
    right = separation(one, other)
    assert right is not None
    lies = [
        right,
        None,
        right._replace(distance=right.distance + 0.1),
        Separation(right.distance, right.other, right.nearest),
        Separation(right.distance, np.zeros(3), np.array([0.0, 1.0, 0.0])),
        Separation(0.0, np.zeros(3), np.array([1.0, 1.0, 1.0])),
    ]
    for lie in lies:
        answer = proved_distance(lie, a, T_a, b, T_b)
        assert answer <= 0.3 + 1e-12
        assert answer == pytest.approx(0.3, abs=ACCURACY) or lie is lies[-1]
    # A distance that is proposed too small is believed where a plane proves as much: it is true.
    assert proved_distance(lies[-1], a, T_a, b, T_b) > 0.0


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_boxes_right_beside_each_other_are_as_far_apart_as_their_faces(axis: int) -> None:
    """FCL may take two corners for the nearest points, 7 mm too far apart at 2.8 m."""
    (box,) = Box(np.full(3, 0.2)).pieces()
    moved = box.placed(transform(None, 3.0 * np.eye(3)[axis]))
    assert distance(box, moved) == pytest.approx(2.8, abs=1e-9)
    assert distance(moved, box) == pytest.approx(2.8, abs=1e-9)


@pytest.mark.parametrize("gap", [0.2, 1e-5, -0.05])
def test_halfspaces_have_a_closed_form(gap: float) -> None:
    (floor,) = HalfSpace(np.array([0.0, 0.0, 1.0]), 0.5).pieces()
    (capsule,) = Capsule(0.1, 0.4).pieces()
    raised = capsule.placed(transform(None, [1.0, 2.0, 0.5 + 0.3 + gap]))
    assert distance(raised, floor) == pytest.approx(gap, abs=1e-12)
    assert distance(floor, raised) == pytest.approx(gap, abs=1e-12)


def test_overlaps_are_negative_by_their_depth() -> None:
    (box,) = Box(np.full(3, 1.0)).pieces()
    for depth in (0.01, 0.2, 0.5):
        moved = box.placed(transform(None, [1.0 - depth, 0.0, 0.1]))
        assert distance(box, moved) == pytest.approx(-depth, abs=1e-6)
