"""Cheap bounds: below coal's distances on every pair, and planes that prove them."""

import itertools

import numpy as np
import pytest

from obstacles.distance.bounds import balls_apart, quick_bound
from obstacles.distance.piece_set import PieceSet
from tests.obstacles.solids import KINDS, coal_distance, random_solid, random_transform


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
