"""Bounds of pairs of boxes and triangles, against their corners along the direction they tell."""

import numpy as np
import pytest

from kinematics.arrays import Array
from obstacles.distance.box_pairs import (
    box_of,
    from_first,
    gap_in_first,
    gap_in_second,
    triangle_gap,
    write_view,
)
from obstacles.distance.piece_set import HALF, KIND, MIDDLE, POSE, WIDTH, CoreKind
from tests.obstacles.solids import random_transform

NODES = np.zeros((0, 10))
SIGNS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)


def desk_of(random: np.random.Generator, reach: float) -> tuple[Array, Array]:
    """Two boxes anywhere on a desk, and how the second is seen from the first."""
    desk, view = np.zeros((2, WIDTH)), np.zeros(WIDTH)
    for row in desk:
        row[KIND] = CoreKind.POLYTOPE
        row[MIDDLE : MIDDLE + 3] = random.normal(size=3) * 0.1
        row[HALF : HALF + 3] = random.uniform(0.0, 0.4, 3) * random.integers(0, 2, 3)
        row[POSE : POSE + 12] = random_transform(random, reach)[:3].reshape(12)
    write_view(desk, view)
    return desk, view


def placed(row: Array, points: Array) -> Array:
    T = row[POSE : POSE + 12].reshape(3, 4)
    return np.asarray(points @ T[:, :3].T + T[:, 3])


def corners_of(row: Array) -> Array:
    return placed(row, row[MIDDLE : MIDDLE + 3] + SIGNS * row[HALF : HALF + 3])


def turned(row: Array, n: tuple[float, float, float]) -> Array:
    return np.asarray(row[POSE : POSE + 12].reshape(3, 4)[:, :3] @ n)


def parted(a: Array, b: Array, n: Array) -> float:
    """How far points are apart along n or against it."""
    return float(max((a @ n).min() - (b @ n).max(), (b @ n).min() - (a @ n).max()))


def test_boxes_are_as_far_apart_as_is_told_along_the_direction_that_is_told() -> None:
    random, positive = np.random.default_rng(3), 0
    for k in range(400):
        desk, view = desk_of(random, 0.2 + 0.002 * k)
        a, b = box_of(desk, 0, NODES, -1), box_of(desk, 1, NODES, -1)
        own, others = corners_of(desk[0]), corners_of(desk[1])
        for side, gap_in in ((0, gap_in_first), (1, gap_in_second)):
            gap, n = gap_in(view, a, b)
            if gap > 0.0:
                positive += 1
                assert np.linalg.norm(n) == pytest.approx(1.0, abs=1e-12)
                assert parted(own, others, turned(desk[side], n)) >= gap - 1e-12
    assert positive > 300


@pytest.mark.parametrize("thin", [1.0, 1e-3, 1e-9, 0.0])
def test_triangles_are_as_far_apart_as_is_told_however_thin(thin: float) -> None:
    random, positive = np.random.default_rng(6), 0
    for _ in range(400):
        desk, view = desk_of(random, 0.6)
        corners = random.normal(size=(6, 3)) * 0.3
        for first in (0, 3):
            middle = 0.5 * (corners[first] + corners[first + 1])
            corners[first + 2] = middle + thin * corners[first + 2]
        gap, n = triangle_gap(view, corners, 0, 3)
        axis = np.zeros(3)
        from_first(desk, n, axis)
        if gap > 0.0:
            positive += 1
            own, others = placed(desk[0], corners[:3]), placed(desk[1], corners[3:])
            apart = (own @ axis).min() - (others @ axis).max()
            assert apart == pytest.approx(gap, abs=1e-12)
    assert positive > 100 or thin == 0.0
