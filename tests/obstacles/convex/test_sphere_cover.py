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


def excess(rows: Array) -> float:
    """How far the finest balls reach beyond the polytope at most [m]."""
    leaves = finest(rows)
    return float((leaves[:, RADIUS] - leaves[:, DEPTH]).max())


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


def test_depths_are_distances_of_centres_from_the_faces() -> None:
    random = np.random.default_rng(4)
    for shape in [BAR, *(random_polytope(random) for _ in range(6))]:
        rows = balls(shape, 8)
        heights = rows[:, CENTER] @ shape.planes[:, :3].T - shape.planes[:, 3]
        np.testing.assert_allclose(rows[:, DEPTH], -heights.max(axis=1), atol=1e-12)
        # Centres are in the polytope, to rounding.
        assert (rows[:, DEPTH] >= -1e-12).all()


def test_more_balls_reach_less_far_beyond() -> None:
    random = np.random.default_rng(5)
    for shape in [BAR, *(random_polytope(random) for _ in range(4))]:
        beyond = [excess(balls(shape, most)) for most in (1, 4, 16, 64)]
        assert beyond == sorted(beyond, reverse=True)
        assert beyond[-1] < 0.5 * beyond[0]


def test_where_it_is_enough_no_more_balls_are_made() -> None:
    wanted = 0.2
    rows = balls(BAR, 64, wanted)
    assert excess(rows) <= wanted
    assert len(finest(rows)) < 64
    assert excess(balls(BAR, len(finest(rows)) // 2)) > wanted


def test_a_bar_is_covered_by_balls_along_it() -> None:
    """Not by ever smaller ones at its corners: their excess is that of equal slices."""
    leaves = finest(balls(BAR, 8))
    assert len(leaves) == 8
    middles = np.sort(leaves[:, 0])
    np.testing.assert_allclose(middles, 0.25 + 0.5 * np.arange(8), atol=0.06)


def test_a_triangle_without_inside_is_covered_flat() -> None:
    corners = np.array([[0.0, 0.0, 0.3], [1.0, 0.0, 0.3], [0.0, 1.0, 0.3]])
    edges = np.array([[0, 1], [1, 2], [2, 0]])
    rows = np.asarray(cover(corners, edges, np.zeros((0, 4)), 8, 0.0))
    points = inside(np.random.default_rng(6), corners, 500)
    assert covered(finest(rows), points).all()
    assert not rows[:, DEPTH].any()


def test_a_point_is_one_ball_of_no_radius() -> None:
    none = np.zeros((0, 4))
    rows = cover(np.array([[1.0, 2.0, 3.0]]), np.zeros((0, 2), dtype=np.int64), none, 8, 0.0)
    assert rows.tolist() == [[1.0, 2.0, 3.0, 0.0, 0.0, 1.0]]


def test_moving_and_scaling_the_polytope_moves_and_scales_the_balls() -> None:
    shape = random_polytope(np.random.default_rng(7))
    shift = np.array([0.25, -0.5, 1.0])
    planes = shape.planes.copy()
    planes[:, 3] = 2.0 * (planes[:, 3] + planes[:, :3] @ shift)
    moved = Polytope(2.0 * (shape.corners + shift), shape.edges, planes, 8.0 * shape.volume)
    one, other = balls(shape, 6), balls(moved, 6)
    assert excess(other) == pytest.approx(2.0 * excess(one), rel=0.05)
    assert len(one) == len(other)
