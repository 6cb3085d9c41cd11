"""Balls that cover a polytope: on every level, no more than asked for, tighter with more."""

import numpy as np
import pytest

from kinematics.arrays import Array
from obstacles.convex.sphere_cover import cover
from tests.obstacles.polytopes import Polytope, inside, polytope, random_polytope

#: Columns of what is answered.
CENTER, RADIUS, DEPTH, AFTER = slice(0, 3), 3, 4, 5
BAR = polytope(np.array([[x, y, z] for x in (0, 4) for y in (0, 0.1) for z in (0, 0.2)]))


def balls(shape: Polytope, most: int, enough: float = 0.0) -> Array:
    return np.asarray(cover(shape.corners, shape.edges, shape.planes, most, enough))


def finest(rows: Array) -> Array:
    return np.asarray(rows[rows[:, AFTER] == np.arange(len(rows)) + 1])


def covered(rows: Array, points: Array) -> Array:
    """Whether some ball holds each of the points, with 1e-12 m for rounding."""
    away = np.linalg.norm(points[:, None] - rows[None, :, CENTER], axis=2)
    return np.asarray((away <= rows[:, RADIUS] + 1e-12).any(axis=1))


@pytest.mark.parametrize("most", [1, 2, 5, 16])
def test_the_finest_balls_hold_every_point(most: int) -> None:
    random = np.random.default_rng(1)
    for shape in [BAR, *(random_polytope(random) for _ in range(6))]:
        rows = balls(shape, most)
        points = np.vstack([shape.corners, inside(random, shape.corners, 1000)])
        assert covered(finest(rows), points).all()
        assert len(finest(rows)) <= most


def test_every_ball_of_the_levels_above_holds_what_those_below_it_hold() -> None:
    """What a walk leaves out with a ball lies in it."""
    random = np.random.default_rng(2)
    for shape in [BAR, *(random_polytope(random) for _ in range(5))]:
        rows = balls(shape, 12)
        points = inside(random, shape.corners, 1500)
        assert covered(rows[:1], points).all()
        # Going down: each point that is in the polytope is on some way from the top to a leaf.
        for p in points[:200]:
            node, reached = 0, False
            while node < len(rows):
                if np.linalg.norm(rows[node, CENTER] - p) > rows[node, RADIUS] + 1e-12:
                    node = int(rows[node, AFTER])
                    continue
                reached |= rows[node, AFTER] == node + 1
                node += 1
            assert reached


def test_rows_are_a_tree_of_halves() -> None:
    rows = balls(random_polytope(np.random.default_rng(3)), 13)
    leaves = len(finest(rows))
    assert len(rows) == 2 * leaves - 1
    assert rows[0, AFTER] == len(rows)

    def leaves_below(node: int) -> int:
        after = int(rows[node, AFTER])
        if after == node + 1:
            return 1
        middle = int(rows[node + 1, AFTER])
        assert int(rows[middle, AFTER]) == after
        one, other = leaves_below(node + 1), leaves_below(middle)
        assert abs(one - other) <= 1
        return one + other

    assert leaves_below(0) == leaves
