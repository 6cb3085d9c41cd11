"""Reaches of corners against brute force, and eight abreast against one after the other."""

import itertools

import numpy as np
import pytest

from planning.timing.jerk.corner_reaches import CornerLimits, fastest_reaches_kernel
from planning.timing.jerk.double_s import CONVERGED, Legs, lower_speeds_kernel

_ROUGH = 1e-4


def _time(
    legs: Legs, corners: CornerLimits, reaches: np.ndarray, window: tuple[int, int],
    ends: tuple[float, float], tolerance: float,
) -> tuple[float, np.ndarray]:  # fmt: skip
    """Time of the legs of a window with the corners between, and speeds; by numbers alone."""
    first, last = window
    rest = legs.lengths - np.append(0.0, reaches)
    rest = (rest - np.append(reaches, 0.0))[first:last]
    inner = slice(first, last - 1)
    speeds = np.empty(last - first + 1)
    speeds[0], speeds[-1] = ends
    for i, r in enumerate(reaches[inner]):
        bent = np.sqrt(corners.acceleration[inner][i] * r)
        jerk = float(corners.jerk[inner][i] * r * r) ** (1.0 / 3.0)
        speeds[i + 1] = min(corners.speed[inner][i], bent, jerk)
    part = Legs(np.ascontiguousarray(rest), np.ascontiguousarray(legs.limits[first:last]))
    time = lower_speeds_kernel(part, speeds, tolerance)
    if speeds[0] < (1.0 - _ROUGH) * ends[0] or speeds[-1] < (1.0 - _ROUGH) * ends[1]:
        return np.inf, speeds
    for r, v in zip(reaches[inner], speeds[1:-1], strict=True):
        if r > 0.0:
            time = time + 2.0 * r / v if v > 0.0 else np.inf
    return time, speeds


def _one_after_the_other(legs: Legs, corners: CornerLimits, largest: np.ndarray) -> np.ndarray:
    """The search, share by share and corner by corner."""
    k = len(largest)
    best, reaches, speeds = np.inf, np.zeros(k), np.zeros(k + 2)
    for share in range(9):
        trial = largest * share / 8
        time, found = _time(legs, corners, trial, (0, k + 1), (0.0, 0.0), _ROUGH)
        if time < best:
            best, reaches, speeds = time, trial, found
    settled = np.zeros(k, dtype=bool)
    for i in [*range(k), *range(k)]:
        if settled[i]:
            continue
        settled[i] = True
        window = max(i - 2, 0), min(i + 4, k + 1)
        ends = float(speeds[window[0]]), float(speeds[window[1]])
        best, _ = _time(legs, corners, reaches, window, ends, _ROUGH)
        known = reaches[i]
        for share in range(9):
            trial = reaches.copy()
            trial[i] = largest[i] * share / 8
            if trial[i] == known:
                continue
            time, found = _time(legs, corners, trial, window, ends, _ROUGH)
            if time < best:
                best, reaches = time, trial
                speeds[window[0] : window[1] + 1] = found
                settled[max(i - 5, 0) : i + 6] = False
                settled[i] = True
    return reaches


@pytest.mark.parametrize("seed", range(40))
def test_eight_abreast_choose_what_is_chosen_one_after_the_other(seed: int) -> None:
    rng = np.random.default_rng(seed)
    k = int(rng.integers(1, 12))
    limits = 10.0 ** rng.uniform(-0.5, 1.5, (k + 1, 3))
    if seed % 4 == 0:
        limits[:, 0] = np.inf
    legs = Legs(10.0 ** rng.uniform(-2.0, 0.5, k + 1), limits)
    corners = CornerLimits(*(10.0 ** rng.uniform(-0.5, 1.5, (3, k))))
    largest = 0.5 * np.minimum(legs.lengths[1:], legs.lengths[:-1])
    largest[rng.uniform(size=k) < 0.2] = 0.0
    found = np.zeros(k)
    fastest_reaches_kernel(legs, corners, largest, found)
    np.testing.assert_array_equal(found, _one_after_the_other(legs, corners, largest))


def test_reaches_are_nearly_the_fastest_of_a_fine_grid() -> None:
    rng = np.random.default_rng(3)
    legs = Legs(np.array([0.8, 0.5, 1.1]), rng.uniform(1.0, 8.0, (3, 3)) * [1.0, 1.0, 8.0])
    corners = CornerLimits(rng.uniform(1, 2, 2), rng.uniform(1, 3, 2), rng.uniform(8, 30, 2))
    largest = np.array([0.25, 0.25])

    def time(reaches: np.ndarray) -> float:
        return _time(legs, corners, reaches, (0, 3), (0.0, 0.0), CONVERGED)[0]

    found = np.zeros(2)
    fastest_reaches_kernel(legs, corners, largest, found)
    grid = [time(largest * shares) for shares in itertools.product(np.linspace(0, 1, 41), repeat=2)]
    assert (found <= largest).all()
    assert time(found) <= 1.01 * min(grid)
    assert time(found) < 0.97 * time(largest * 0.1)
