"""Equations of closed forms against brute force: every solution and no other, nearest turns."""

import numpy as np
import pytest

from compiled.kernel import kernel
from compiled.simd import choose, load, store
from kinematics.arrays import Array
from kinematics.ik.closed_form.refine import near_kernel
from kinematics.ik.closed_form.subproblem import (
    cosine_kernel,
    elbow_kernel,
    orient_kernel,
    wrist_constants,
)
from kinematics.pose import from_axis_angle

#: Angles at which functions are sampled for the number of their zeros.
GRID = np.linspace(-np.pi, np.pi, 20_001)


def sign_changes(values: Array) -> int:
    """How often neighbouring values differ in sign."""
    return int(np.count_nonzero(np.diff(np.sign(values)) != 0))


def random_rotation(rng: np.random.Generator) -> Array:
    return from_axis_angle(rng.normal(size=3), rng.uniform(0.0, np.pi))


def turn_z(c: float, s: float) -> Array:
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def test_cosine_equation_has_the_zeros_of_its_graph() -> None:
    rng = np.random.default_rng(0)
    for _ in range(200):
        a, b, d = rng.normal(size=3)
        status, c, s, cd, sd = cosine_kernel(a, b, d, 0.0)
        graph = a * np.cos(GRID) + b * np.sin(GRID) - d
        assert (status == 1) == (sign_changes(graph) == 2)
        for side in (1.0, -1.0) if status == 1 else ():
            x = np.arctan2(s, c) + side * np.arctan2(sd, cd)
            assert abs(a * np.cos(x) + b * np.sin(x) - d) < 1e-14


@pytest.mark.parametrize("gap", [1e-12, 1e-9, 1e-6])
def test_cosine_equation_near_its_double_zero(gap: float) -> None:
    # |d| is the amplitude but for a little: two zeros that nearly meet, or none.
    status, c, s, cd, sd = cosine_kernel(0.6, 0.8, 1.0 - gap, 0.0)
    assert status == 1
    assert np.arctan2(sd, cd) == pytest.approx(np.arccos(1.0 - gap), rel=1e-3)
    assert np.arctan2(s, c) == pytest.approx(np.arctan2(0.8, 0.6))
    assert cosine_kernel(0.6, 0.8, 1.0 + gap, 0.0)[0] == 0
    assert cosine_kernel(0.6, 0.8, 1.0 + gap, 2.0 * gap)[0] == 1


def test_cosine_equation_without_an_amplitude_holds_for_all_angles_or_none() -> None:
    assert cosine_kernel(0.0, 0.0, 0.0, 0.0)[0] == 2
    assert cosine_kernel(0.0, 0.0, 1e-3, 0.0)[0] == 0


@pytest.mark.parametrize("reach", ["inside", "outside", "stretched"])
def test_elbow_closes_the_triangle_on_both_sides(reach: str) -> None:
    rng = np.random.default_rng(1)
    for _ in range(100):
        a, b = rng.normal(size=2), rng.normal(size=2)
        longest, shortest = (
            np.linalg.norm(a) + np.linalg.norm(b),
            abs(np.linalg.norm(a) - np.linalg.norm(b)),
        )
        length = {
            "inside": rng.uniform(shortest + 1e-3, longest - 1e-3),
            "outside": longest * 1.01,
            "stretched": longest * (1.0 - 1e-13),
        }[reach]
        angle = rng.uniform(-np.pi, np.pi)
        p = length * np.array([np.cos(angle), np.sin(angle)])
        bends = []
        for side in (1.0, -1.0):
            status, cx, sx, cy, sy = elbow_kernel(p[0], p[1], a[0], a[1], b[0], b[1], side, 1e-12)
            assert (status == 0) == (reach == "outside")
            if status == 0:
                continue
            reached = turn_z(cx, sx)[:2, :2] @ (a + turn_z(cy, sy)[:2, :2] @ b)
            tolerance = 1e-9 if reach == "stretched" else 1e-12
            np.testing.assert_allclose(reached, p, atol=tolerance)
            bends.append(np.arctan2(sy, cy))
        if reach == "inside":
            # Two different bends, as many as the graph of the distance has.
            distance = np.hypot(
                a[0] + np.cos(GRID) * b[0] - np.sin(GRID) * b[1],
                a[1] + np.sin(GRID) * b[0] + np.cos(GRID) * b[1],
            )
            assert sign_changes(distance - length) == 2
            assert abs(np.sin(0.5 * (bends[0] - bends[1]))) > 1e-4


@pytest.mark.parametrize("tilt", [1.0, 1e-3, 1e-6, 1e-9, 0.0])
def test_wrists_reach_every_rotation_on_both_sides(tilt: float) -> None:
    # R = Rz(a) B Rz(b) C Rz(c) with the middle joint near and at the straight wrist, b = 0.
    rng = np.random.default_rng(2)
    quarter = from_axis_angle(np.array([1.0, 0.0, 0.0]), 0.5 * np.pi)
    B, C = quarter, quarter.T
    row = np.zeros((2, 14))
    row[0, 1:13] = np.column_stack([B, np.zeros(3)]).ravel()
    row[1, 1:13] = np.column_stack([C, np.zeros(3)]).ravel()
    constants = wrist_constants(B, C)
    for _ in range(50):
        a, c = rng.uniform(-np.pi, np.pi, 2)
        M = (
            turn_z(np.cos(a), np.sin(a)) @ B @ turn_z(np.cos(tilt), np.sin(tilt)) @ C
            @ turn_z(np.cos(c), np.sin(c))
        )  # fmt: skip
        for side in (1.0, -1.0):
            status, ca, sa, cb, sb, cc, sc = orient_kernel(
                row[0], row[1], constants, tuple(M[:, 0]), tuple(M[:, 2]), side, 1e-14
            )
            assert status == (2 if tilt == 0.0 else 1)
            reached = turn_z(ca, sa) @ B @ turn_z(cb, sb) @ C @ turn_z(cc, sc)
            np.testing.assert_allclose(reached, M, atol=2e-9)
            assert abs(np.arctan2(sb, cb)) == pytest.approx(tilt, rel=1e-6, abs=1e-12)


def test_a_wrist_between_skew_axes_cannot_reach_every_rotation() -> None:
    rng = np.random.default_rng(3)
    solvable = 0
    for _ in range(200):
        B, C, M = random_rotation(rng), random_rotation(rng), random_rotation(rng)
        row = np.zeros((2, 14))
        row[0, 1:13] = np.column_stack([B, np.zeros(3)]).ravel()
        row[1, 1:13] = np.column_stack([C, np.zeros(3)]).ravel()
        # m_z = u . Rz(b) v decides whether some b exists.
        heights = [(B @ turn_z(np.cos(b), np.sin(b)) @ C)[2, 2] for b in GRID[::20]]
        exists = min(heights) < M[2, 2] < max(heights)
        status = orient_kernel(
            row[0], row[1], wrist_constants(B, C), tuple(M[:, 0]), tuple(M[:, 2]), 1.0, 0.0
        )[0]
        assert (status != 0) == exists
        solvable += exists
    assert 20 < solvable < 180


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
