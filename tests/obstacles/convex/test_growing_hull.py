"""A hull that grows point by point has scipy's volume."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from kinematics.arrays import Array
from obstacles.convex.growing_hull import GrowingHull, add_point, begin_hull, empty_hull

#: What a volume may lack: points nearer than ``SIGHT`` to a hull are left out.
SIGHT = 1e-6


def grown(points: Array) -> tuple[GrowingHull, list[float]]:
    """The hull of points, and its volume after each of them."""
    hull = empty_hull(len(points), len(points))
    volumes = [begin_hull(hull, points, np.arange(len(points)), len(points))]
    if volumes[0] > 0.0:
        for i in range(len(points)):
            volumes.append(volumes[-1] + add_point(hull, points, i, SIGHT))
    return hull, volumes


def draw(kind: str, random: np.random.Generator) -> Array:
    points = random.normal(size=(random.integers(5, 200), 3))
    if kind == "sphere":
        return np.asarray(points / np.linalg.norm(points, axis=1, keepdims=True))
    if kind == "grid":
        return np.round(2.0 * points) / 2.0
    if kind == "prism":
        turn = random.integers(0, 24, len(points)) * np.pi / 12.0
        return np.column_stack([np.cos(turn), np.sin(turn), random.integers(0, 3, len(points))])
    return points


@pytest.mark.parametrize("kind", ["normal", "sphere", "grid", "prism"])
def test_its_volume_is_that_of_the_hull_and_never_shrinks(kind: str) -> None:
    random = np.random.default_rng(1)
    compared = 0
    for _ in range(150):
        points = draw(kind, random)
        _, volumes = grown(points)
        if volumes[0] > 0.0:
            assert volumes == sorted(volumes)
            assert volumes[-1] == pytest.approx(ConvexHull(points).volume, rel=1e-5)
            compared += 1
    assert compared > 120


@pytest.mark.parametrize("rank", [0, 1, 2])
def test_what_is_flat_has_no_volume(rank: int) -> None:
    random = np.random.default_rng(3)
    axes = np.linalg.qr(random.normal(size=(3, 3)))[0]
    points = random.normal(size=(30, rank)) @ axes[:rank] + 1.0
    assert grown(points)[1] == [0.0]
    assert grown(points[:3])[1] == [0.0]
