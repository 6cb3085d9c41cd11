"""What a direction proves does not depend on who is first, nor on where the pair is looked at."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kinematics.arrays import Array
from kinematics.pose import transform
from obstacles.convex.piece import Piece, PieceKind
from tests.planning.proof.collision.test_separating_direction import proved
from tests.properties import directions, numbers, transforms

LENGTHS = st.floats(1e-3, 1.0)


def _round(kind: PieceKind) -> st.SearchStrategy[Piece]:
    return st.builds(
        lambda T, radius, half: Piece(kind, T, np.zeros((0, 3)), radius, half),
        transforms, LENGTHS, LENGTHS,
    )  # fmt: skip


PIECES = st.one_of(
    st.builds(
        lambda T, points, rounding: Piece(PieceKind.POLYTOPE, T, points, offset_radius=rounding),
        transforms, st.integers(1, 6).flatmap(lambda k: numbers((k, 3))), st.floats(0.0, 0.5),
    ),
    _round(PieceKind.CYLINDER),
    _round(PieceKind.CONE),
)  # fmt: skip


@given(PIECES, PIECES, directions)
def test_the_other_way_round_the_same_is_proved(a: Piece, b: Piece, u: Array) -> None:
    assert proved([a, b], u) == pytest.approx(proved([b, a], -u), abs=1e-12)


@given(PIECES, PIECES, directions, transforms)
def test_a_rigid_motion_of_all_changes_nothing(a: Piece, b: Piece, u: Array, T: Array) -> None:
    moved = proved([a.placed(T), b.placed(T)], T[:3, :3] @ u)
    assert moved == pytest.approx(proved([a, b], u), abs=1e-12)


@given(PIECES, PIECES, directions, st.floats(1e-3, 1e3))
def test_only_the_direction_counts_not_its_length(a: Piece, b: Piece, u: Array, k: float) -> None:
    assert proved([a, b], k * u) == pytest.approx(proved([a, b], u), abs=1e-12)


@given(PIECES, PIECES, directions, st.floats(0.0, 5.0))
def test_moving_apart_along_the_direction_proves_as_much_more(
    a: Piece, b: Piece, u: Array, far: float
) -> None:
    T = transform(None, far * u)
    assert proved([a, b.placed(T)], u) == pytest.approx(proved([a, b], u) + far, abs=1e-12)


@given(PIECES, PIECES, directions, st.floats(0.0, 0.3))
def test_rounding_is_taken_off(a: Piece, b: Piece, u: Array, more: float) -> None:
    thick = Piece(
        b.kind, b.T_owner_piece, b.vertices, b.radius, b.half_height, b.offset_radius + more
    )
    assert proved([a, thick], u) == pytest.approx(proved([a, b], u) - more, abs=1e-12)
