"""Packed pieces: rows say what the pieces are, and packing behind others changes no distance."""

import itertools

import numpy as np

from obstacles.distance.piece_set import (
    PieceSet,
)
from obstacles.distance.signed_distance import signed_distance
from obstacles.distance.triangles.distance import touching
from tests.obstacles.outline import convex_pieces
from tests.obstacles.solids import random_transform


def test_touching_is_a_signed_distance_of_at_most_zero() -> None:
    random = np.random.default_rng(10)
    seen = [0, 0]
    for _ in range(4):
        pieces = [p.placed(random_transform(random, 0.15)) for p in convex_pieces(random)]
        packed = PieceSet.of(pieces)
        for (i, a), (j, b) in itertools.combinations(enumerate(pieces), 2):
            lower, upper = signed_distance(a, a.T_owner_piece, b, b.T_owner_piece)
            if upper <= 0.0 or lower > 0.0:
                assert touching(packed, i, j) == (upper <= 0.0)
                assert touching(packed, j, i) == (upper <= 0.0)
                seen[int(upper <= 0.0)] += 1
    assert min(seen) > 10
