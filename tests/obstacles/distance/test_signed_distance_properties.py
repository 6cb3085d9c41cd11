"""Distances of convex pieces: symmetric, the same wherever they are looked at, by closed forms."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kinematics.arrays import Array
from obstacles.convex.piece import Piece, PieceKind
from obstacles.distance.signed_distance import ACCURACY, convex_distance, signed_distance
from obstacles.shapes.shape import Box, Capsule, Cylinder, Sphere
from tests.properties import numbers, transforms

#: Two bounds of one distance are this far apart at most [m].
APART = 1e-6
LENGTHS = st.floats(0.02, 0.8)
SHAPES = st.one_of(
    st.builds(Box, numbers(3).map(lambda size: np.abs(size) + 0.02)),
    st.builds(Sphere, LENGTHS),
    st.builds(Capsule, LENGTHS, LENGTHS),
    st.builds(Cylinder, LENGTHS, LENGTHS),
).map(lambda shape: shape.pieces()[0])


@given(SHAPES, SHAPES, transforms, transforms)
def test_distance_is_symmetric(a: Piece, b: Piece, T_a: Array, T_b: Array) -> None:
    here, there = signed_distance(a, T_a, b, T_b), signed_distance(b, T_b, a, T_a)
    assert here[0] <= there[1] + APART
    assert there[0] <= here[1] + APART
    assert here[0] <= here[1]


@given(SHAPES, SHAPES, transforms, transforms, transforms)
def test_a_rigid_motion_of_both_changes_nothing(
    a: Piece, b: Piece, T_a: Array, T_b: Array, T: Array
) -> None:
    before, after = signed_distance(a, T_a, b, T_b), signed_distance(a, T @ T_a, b, T @ T_b)
    assert before[0] == pytest.approx(after[0], abs=APART)
    assert before[1] == pytest.approx(after[1], abs=APART)


@given(SHAPES, SHAPES, transforms, transforms)
def test_fcl_and_the_planes_agree(a: Piece, b: Piece, T_a: Array, T_b: Array) -> None:
    lower, upper = signed_distance(a, T_a, b, T_b)
    proved = convex_distance(a, T_a, b, T_b)
    assert proved <= upper + ACCURACY
    assert proved >= lower - ACCURACY


@given(LENGTHS, LENGTHS, transforms, transforms)
def test_balls_are_as_far_apart_as_their_centres_less_their_radii(
    r: float, s: float, T_a: Array, T_b: Array
) -> None:
    a, b = (Piece(PieceKind.POLYTOPE, np.eye(4), np.zeros((1, 3)), offset_radius=k) for k in (r, s))
    expected = float(np.linalg.norm(T_a[:3, 3] - T_b[:3, 3])) - r - s
    lower, upper = signed_distance(a, T_a, b, T_b)
    assert lower == pytest.approx(expected, abs=APART)
    assert upper == pytest.approx(expected, abs=APART)
