"""FCL's solids of our pieces: their distances are those of the pieces, wherever they are moved."""

import itertools

import fcl
import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.pose import transform
from obstacles.convex.piece import Piece
from obstacles.distance.fcl_solid import (
    UNITS,
    FclSolid,
    fcl_solid,
    separation,
)
from obstacles.distance.signed_distance import signed_distance
from obstacles.shapes.shape import HalfSpace
from tests.obstacles.outline import convex_pieces


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
