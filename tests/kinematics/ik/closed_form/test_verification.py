"""Verification of candidates in SIMD lanes, beside numpy and one by one."""

import numpy as np
import pytest

from compiled.kernel import kernel
from compiled.simd import choose, load, store
from kinematics.arrays import Array
from kinematics.frame import IDENTITY
from kinematics.ik.closed_form.refine import angle_kernel, miss_kernel, near_kernel
from kinematics.ik.numeric.dls_step import frame_kernel
from kinematics.pose import from_axis_angle, transform

TURN = 2.0 * np.pi


@kernel
def angles_kernel(c: Array, s: Array, out: Array) -> None:
    for i in range(0, c.shape[0], 8):
        store(out, i, angle_kernel(load(c, i), load(s, i)))


@kernel
def one_angle_kernel(c: float, s: float) -> float:
    return angle_kernel(c, s)


@kernel
def turns_near_kernel(
    angles: Array,
    lower: float,
    upper: float,
    seed: float,
    out: Array,
    inside: Array,
    snapped: Array,
) -> None:
    best, fits, put = near_kernel(load(angles, 0), lower, upper, seed)
    store(out, 0, best)
    store(inside, 0, choose(fits, 1.0, 0.0))
    store(snapped, 0, choose(put, 1.0, 0.0))


@kernel
def one_near_kernel(
    angle: float, lower: float, upper: float, seed: float
) -> tuple[float, bool, bool]:
    return near_kernel(angle, lower, upper, seed)


@kernel
def one_miss_kernel(T: Array) -> tuple[float, float]:
    return miss_kernel(IDENTITY, frame_kernel(T))


def test_angles_are_those_of_atan2_in_lanes_and_alone() -> None:
    rng = np.random.default_rng(1)
    at = rng.uniform(-np.pi, np.pi, 4000)
    at[:64] = np.arange(64) * np.pi / 8 + rng.choice([0.0, 1e-9, -1e-9], 64)
    c, s = np.cos(at), np.sin(at)
    c[64:72], s[64:72] = [1.0, -1.0, 0.0, 0.0, -1.0, 1.0, 0.6, -0.6], [0, 0, 1, -1, 0, 0, 0.8, -0.8]
    out = np.empty(len(at))
    angles_kernel(c, s, out)
    assert np.abs(out - np.arctan2(s, c)).max() < 1e-15
    assert all(one_angle_kernel(c[k], s[k]) == out[k] for k in range(len(at)))


def nearest(angle: float, lower: float, upper: float, seed: float) -> tuple[float, bool, bool]:
    """All whole turns, tried one by one: what is on a limit but for rounding is inside."""
    copies = angle + TURN * np.arange(-9, 10)
    inside = copies[(copies >= lower - 1e-6) & (copies <= upper + 1e-6)]
    if len(inside):
        best = inside[np.abs(inside - seed).argmin()]
        return float(np.clip(best, lower, upper)), True, not lower <= best <= upper
    return float(copies[np.abs(copies - seed).argmin()]), False, False


def test_nearest_turns_are_those_of_trying_all() -> None:
    rng = np.random.default_rng(2)
    out, inside, snapped = np.empty(8), np.empty(8), np.empty(8)
    seen = set()
    for _ in range(4000):
        lower, upper = np.sort(rng.uniform(-7.0, 7.0, 2))
        if rng.random() < 0.1:
            lower = upper - rng.choice([0.0, 1e-7, 1e-5])
        seed = rng.uniform(lower, upper)
        lower = -np.inf if rng.random() < 0.1 else lower
        upper = np.inf if rng.random() < 0.1 else upper
        angles = rng.uniform(-np.pi, np.pi, 8)
        for limit in (lower, upper):
            if np.isfinite(limit):
                # Less and more than what is put onto a limit, outside and inside.
                angles[rng.integers(8)] = limit + rng.choice([-9e-6, -9e-7, 0.0, 9e-7, 9e-6])
        turns_near_kernel(angles, lower, upper, seed, out, inside, snapped)
        for k, angle in enumerate(angles):
            alone = one_near_kernel(angle, lower, upper, seed)
            assert alone == (out[k], inside[k] == 1.0, snapped[k] == 1.0)
            best, fits, put = nearest(angle, lower, upper, seed)
            assert alone[1] == fits
            assert abs(alone[0] - best) <= 1e-12
            # What is on a limit within rounding of the sums is either.
            if min(abs(best - lower), abs(best - upper)) > 1e-12:
                assert alone[2] == put
            assert not fits or lower <= alone[0] <= upper
            seen.add((fits, put))
    assert seen == {(True, False), (True, True), (False, False)}


@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-7, 1e-3])
def test_the_miss_of_a_frame_is_distance_and_angle(size: float) -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        axis, away = rng.normal(size=3), size * rng.normal(size=3)
        T = transform(from_axis_angle(axis / np.linalg.norm(axis), size), away)
        position, orientation = one_miss_kernel(T)
        assert position == pytest.approx(float(np.linalg.norm(away)), rel=1e-12)
        assert orientation == pytest.approx(2.0 * np.sin(0.5 * size), rel=1e-3, abs=1e-16)
