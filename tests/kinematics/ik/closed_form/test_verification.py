"""Verification of candidates in SIMD lanes, beside numpy and one by one."""

import numpy as np

from compiled.kernel import kernel
from compiled.simd import choose, load, store
from kinematics.arrays import Array
from kinematics.ik.closed_form.refine import near_kernel

TURN = 2.0 * np.pi


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
