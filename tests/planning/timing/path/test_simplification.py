"""Polylines that stand for sampled paths: how near they are, and what they leave out."""

import itertools

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from kinematics.arrays import Array
from planning.timing.path.blend import blend
from planning.timing.path.path import JointPath
from planning.timing.path.simplification import simplified_polyline, written_unit


def sampled_path(rng: np.random.Generator) -> Array:
    """A curve with a corner or two, sampled and rounded, shape (k, n)."""
    n, parts = int(rng.integers(1, 8)), []
    start = rng.uniform(-1.0, 1.0, n)
    for _ in range(int(rng.integers(1, 4))):
        u = np.linspace(0.0, 1.0, int(rng.integers(5, 150)))[:, None]
        bend = 0.2 * np.sin(u * rng.uniform(0.0, 6.0, n)) * (rng.random() < 0.7)
        parts.append(start + u * rng.uniform(-1.0, 1.0, n) + bend)
        start = parts[-1][-1]
    return np.asarray(np.concatenate(parts).round(int(rng.integers(3, 7))))


def dense(points: Array, count: int = 12) -> Array:
    """Points on all legs of a polyline, in their order."""
    shares = np.linspace(0.0, 1.0, count, endpoint=False)[:, None]
    legs = [a + shares * (b - a) for a, b in itertools.pairwise(points)]
    return np.concatenate([*legs, points[-1:]])


def are_near_in_order(a: Array, b: Array, most: float) -> bool:
    """Whether the discrete Frechet distance of two rows of points is at most a number."""
    free, numbers = cdist(a, b) <= most, np.arange(len(b))
    reached = np.logical_and.accumulate(free[0])
    for row in free[1:]:
        seeds = row & (reached | np.append(False, reached[:-1]))
        blocked = np.maximum.accumulate(np.where(row, -1, numbers))
        reached = row & (np.maximum.accumulate(np.where(seeds, numbers, -1)) > blocked)
    return bool(reached[-1])


def sampled(path: JointPath, count: int) -> Array:
    return path.sample(np.linspace(0.0, path.breaks[-1], count).clip(max=path.breaks[-1]))


@pytest.mark.parametrize("seed", range(16))
@pytest.mark.parametrize("smooth", [False, True])
def test_the_rounded_line_follows_the_path_within_the_tolerance(seed: int, smooth: bool) -> None:
    rng = np.random.default_rng(seed)
    points = sampled_path(rng)
    tolerance = float(rng.choice([1e-3, 5e-3, 2e-2]))
    line = simplified_polyline(points, tolerance, smooth)
    np.testing.assert_array_equal(line.corners, points[line.numbers])
    assert {line.numbers[0], line.numbers[-1]} == {0, len(points) - 1}
    assert line.deviation <= 0.9 * tolerance
    given = dense(points, max(1200 // len(points), 2))
    curve = sampled(blend(line.corners, line.reaches, smooth), 1200)
    spacing = np.linalg.norm(np.diff(given, axis=0), axis=1).max()
    spacing += np.linalg.norm(np.diff(curve, axis=0), axis=1).max()
    assert are_near_in_order(given, curve, tolerance + spacing)
    assert not are_near_in_order(given, curve[::-1], tolerance + spacing)
    # At places, not in their order, with finer samples.
    fine = dense(points, max(20_000 // len(points), 2))
    step = np.linalg.norm(np.diff(fine, axis=0), axis=1).max()
    assert cdist(curve, fine).min(axis=1).max() <= np.hypot(tolerance, step) * (1.0 + 1e-9)


@pytest.mark.parametrize("seed", range(10))
def test_rounding_leaves_out_what_is_on_a_line(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, decimals = int(rng.integers(1, 8)), int(rng.integers(3, 9))
    start, way = rng.uniform(-1.0, 1.0, n), rng.uniform(0.3, 1.0, n)
    shares = np.sort(np.concatenate([[0.0, 1.0], rng.random(60)]))[:, None]
    points = (start + shares * way).round(decimals)
    line = simplified_polyline(points, 0.0, smooth=True)
    assert line.rounding == pytest.approx(np.sqrt(n) * 10.0**-decimals, rel=1e-12)
    assert line.numbers.tolist() == [0, len(points) - 1]
    assert line.deviation <= line.rounding
    # A corner of many units stays, and is a stop.
    bent = np.concatenate([points, points[-1] + 0.5 * np.roll(way, 1) * [[-1.0]]]).round(decimals)
    line = simplified_polyline(bent, 0.0, smooth=True)
    assert line.numbers.tolist() == [0, len(points) - 1, len(points)]
    assert line.reaches.tolist() == [0.0]


def test_the_unit_is_that_of_rounded_numbers() -> None:
    rng = np.random.default_rng(0)
    for decimals in range(3, 11):
        assert written_unit(rng.uniform(-1, 1, (40, 4)).round(decimals)) == 10.0**-decimals
    for exact in ([[0.0, 0.5], [1.0, 0.25], [1.5, 2.0]], rng.uniform(-1, 1, (40, 4))):
        assert written_unit(np.array(exact)) == 0.0
    # Steps of a unit: no rounded path.
    assert written_unit(np.array([[0.0, 0.0], [0.001, 0.003], [0.004, 0.002]])) == 0.0


def test_ways_back_stay() -> None:
    back = np.array([[0.0], [1.0], [0.2], [1.2]])
    line = simplified_polyline(back, 1e-3, smooth=False)
    np.testing.assert_array_equal(line.corners, back)
    assert not line.reaches.any()
    # Within the tolerance they are noise.
    noise = np.array([[0.0], [0.5], [0.4995], [1.0]])
    assert simplified_polyline(noise, 1e-3, smooth=False).numbers.tolist() == [0, 3]
    loop = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]])
    assert len(simplified_polyline(loop, 0.5, smooth=True).corners) > 2


def test_loops_within_the_tolerance_leave_no_corner_twice() -> None:
    turn = np.linspace(0.0, 2.0 * np.pi, 30)
    loop = 4e-4 * np.stack([np.cos(turn) - 1.0, np.sin(turn)], axis=-1)
    assert len(simplified_polyline(loop, 1e-3, smooth=True).corners) == 1
    through = np.concatenate([[[-1.0, 0.0]], loop, [[0.0, 1.0]]])
    line = simplified_polyline(through, 1e-3, smooth=True)
    assert len(line.corners) == 3
    assert np.isfinite(line.reaches).all()


def test_sparse_paths_are_as_they_are() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        points = rng.uniform(-1.0, 1.0, (6, 3)).round(4)
        for tolerance in (0.0, 0.01):
            line = simplified_polyline(points, tolerance, smooth=True)
            np.testing.assert_array_equal(line.corners, points)
            assert line.left_out == 0
            assert bool(line.reaches.any()) is (tolerance > 0.0)
