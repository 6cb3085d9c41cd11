"""Fewest waypoints: how many stay, and that the lines through them keep to the path."""

import itertools

import numpy as np
import pytest

from kinematics.arrays import Array, Indices
from planning.timing.path.simplification import fewest_waypoints, leg_stands_kernel

KINDS = ("smooth", "noisy", "repeated", "there and back", "corners", "loop")


def recorded(rng: np.random.Generator, k: int, kind: str) -> Array:
    """A path of k waypoints, shape (k, n)."""
    n, u = int(rng.integers(2, 8)), np.linspace(0.0, 1.0, k)[:, None]
    bend = 0.3 * np.sin(u * rng.uniform(0.0, 20.0, n) + rng.uniform(0.0, 6.0, n))
    points = rng.uniform(-2.0, 2.0, n) + u * rng.uniform(-1.0, 1.0, n) + bend
    if kind == "noisy":
        points += rng.normal(0.0, 5e-4, points.shape)
    elif kind == "repeated":
        points = np.repeat(points, rng.integers(1, 4, k), axis=0)[:k]
    elif kind == "there and back":
        points = np.concatenate([points[: k // 2], points[: k - k // 2][::-1]])
    elif kind == "corners":
        ends = rng.uniform(-1.0, 1.0, (6, n))
        legs = itertools.pairwise(ends)
        points = np.concatenate([a + np.linspace(0, 1, k // 5)[:, None] * (b - a) for a, b in legs])
    elif kind == "loop":
        points = np.concatenate([points, points[:1]])[-k:]
    return np.ascontiguousarray(points)


def fewest(points: Array, within: float) -> int:
    """The least number of waypoints, by a dynamic programme over all pairs."""
    best = np.full(len(points), len(points) + 1)
    best[0] = 1
    for first in range(len(points) - 1):
        for last in range(first + 1, len(points)):
            shorter = best[first] + 1 < best[last]
            if shorter and leg_stands_kernel(points, first, last, within, np.inf):
                best[last] = best[first] + 1
    return int(best[-1])


def matched_distance(points: Array, numbers: Indices, count: int = 9) -> float:
    """Largest distance of any joint between the path and the line, at samples of both, in order.

    Each leg is matched with its part of the path by the least largest distance over all ways to go
    on along both, sample by sample (the discrete Frechet distance), which is a little too large.
    """
    most = 0.0
    for first, last in itertools.pairwise(numbers):
        part = points[first : last + 1]
        shares = np.linspace(0.0, 1.0, count * (last - first) + 1)
        line = part[0] + shares[:, None] * (part[-1] - part[0])
        at = np.linspace(0.0, last - first, len(shares))
        path = np.stack([np.interp(at, np.arange(len(part)), row) for row in part.T], axis=-1)
        away = np.abs(path[:, None] - line[None]).max(axis=2)
        reached = np.maximum.accumulate(away[0])
        for row in away[1:]:
            through = np.minimum(reached, np.append(np.inf, reached[:-1]))
            for i, (own, before) in enumerate(zip(row, through, strict=True)):
                through[i] = max(own, min(before, through[i - 1] if i else np.inf))
            reached = through
        most = max(most, float(reached[-1]))
    return most


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(4))
def test_the_number_is_the_least_or_nearly(kind: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    for k, most in ((60, 1.0), (400, 1.0), (700, 1.1)):
        points = recorded(rng, k, kind)
        within = 10.0 ** rng.uniform(-4.0, -1.5)
        numbers, deviation = fewest_waypoints(points, within)
        assert {numbers[0], numbers[-1]} == {0, len(points) - 1}
        assert (np.diff(numbers) > 0).all()
        assert deviation <= within
        assert len(numbers) <= most * fewest(points, within)


@pytest.mark.parametrize("kind", KINDS)
def test_the_line_keeps_to_the_path_in_its_order(kind: str) -> None:
    rng = np.random.default_rng(7)
    for _ in range(3):
        points = recorded(rng, 60, kind)
        within = 10.0 ** rng.uniform(-3.0, -1.5)
        numbers, deviation = fewest_waypoints(points, within)
        step = np.abs(np.diff(points, axis=0)).max(initial=0.0) / 9
        step += max(
            np.abs(points[b] - points[a]).max() / (9 * (b - a))
            for a, b in itertools.pairwise(numbers)
        )
        assert matched_distance(points, numbers) <= deviation + step


def test_shared_places_are_passed_as_often_as_they_are() -> None:
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]])
    twice = np.concatenate([square, square[1:]])
    assert fewest_waypoints(twice, 0.1)[0].tolist() == list(range(9))
    # Within half the diagonal a leg without length stands for a loop, and beyond for no less.
    assert fewest_waypoints(twice, 1.0)[0].tolist() == [0, 8]
    still = np.zeros((5, 3))
    numbers, deviation = fewest_waypoints(still, 0.0)
    assert (numbers.tolist(), deviation) == ([0, 4], 0.0)
    assert fewest_waypoints(still[:1], 0.0)[0].tolist() == [0]


def test_jitter_along_a_line_is_left_out_within_half_of_it() -> None:
    back = np.array([[0.0], [0.5], [0.498], [1.0]])
    # Each of the two is a thousandth from the middle between them.
    assert fewest_waypoints(back, 1.001e-3)[0].tolist() == [0, 3]
    assert len(fewest_waypoints(back, 0.999e-3)[0]) > 2
    assert fewest_waypoints(back, 1.001e-3, 2.0)[0].tolist() == [0, 3]


@pytest.mark.parametrize("kind", KINDS)
def test_twenty_thousand_waypoints_are_simplified(kind: str) -> None:
    points = recorded(np.random.default_rng(2), 20_000, kind)
    for within in (1e-6, 1e-3, 1.0):
        numbers, deviation = fewest_waypoints(points, within)
        assert deviation <= within
        assert len(numbers) >= 2
