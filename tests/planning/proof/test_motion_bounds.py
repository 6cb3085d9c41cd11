"""Joints enclosed on cells of time, against exact fractions and dense samples."""

from fractions import Fraction

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.trajectory.trajectory import Trajectory
from planning.proof.motion_bounds import (
    ACCELERATION,
    BOW,
    BOW_ROUNDING,
    JERK,
    JOINT_COLUMNS,
    PIECE_COLUMNS,
    RADIUS,
    RATE,
    ROUNDING,
    SPEED,
    VALUE,
    enclose,
    enclose_span,
    piece_bounds,
)


def exact(coefficients: Array, time: float) -> list[Fraction]:
    """Values and rates of a piece at a time, without rounding."""
    t = Fraction(time)
    answer = []
    for row in coefficients:
        c = [Fraction(float(value)) for value in row]
        answer.append(sum(a * t**k for k, a in enumerate(c)))
        answer.append(sum(k * a * t ** (k - 1) for k, a in enumerate(c) if k))
    return [Fraction(value) for value in answer]


def test_enclosure_holds_exactly_also_where_powers_cancel() -> None:
    random = np.random.default_rng(3)
    for case in range(60):
        n, size = 2, int(random.integers(1, 18))
        # Large numbers that cancel about some time: most digits of the value are lost.
        around = float(random.uniform(0.0, 40.0)) if case % 2 else 0.0
        coefficients = np.zeros((n, size))
        for j in range(n):
            roots = around + random.normal(size=size - 1)
            coefficients[j] = np.polynomial.polynomial.polyfromroots(roots)[:size]
        at, half = around + float(random.uniform(0.0, 2.0)), float(random.uniform(0.0, 0.5))
        half = min(half, at)
        joints = np.empty((n, JOINT_COLUMNS))
        enclose(coefficients, at, half, np.empty((2, size)), joints)
        for time in np.linspace(at - half, at + half, 9):
            found = exact(coefficients, float(time))
            s = Fraction(float(time)) - Fraction(at)
            # The times are rounded too: so little that a fraction of the bound is left.
            allowed = Fraction(1) + Fraction(1, 10**9)
            for j in range(n):
                value, rate = found[2 * j : 2 * j + 2]
                row = [Fraction(float(x)) for x in joints[j]]
                assert abs(value - row[VALUE]) <= row[RADIUS] * allowed
                first = row[VALUE] + s * row[RATE]
                bend = row[ACCELERATION] * s * s / 2 + row[ROUNDING]
                assert abs(value - first) <= bend * allowed
                second = first + row[BOW] * s * s / 2
                twist = row[JERK] * abs(s) ** 3 / 6 + row[BOW_ROUNDING]
                assert abs(value - second) <= twist * allowed
                assert abs(rate) <= row[SPEED] * allowed


def test_a_cell_without_length_strays_by_rounding_alone() -> None:
    joints = np.empty((1, JOINT_COLUMNS))
    enclose(np.array([[1.0, 2.0, 3.0, 4.0]]), 0.5, 0.0, np.empty((2, 4)), joints)
    assert joints[0, VALUE] == pytest.approx(1.0 + 1.0 + 0.75 + 0.5)
    assert joints[0, RATE] == pytest.approx(2.0 + 3.0 + 3.0)
    assert 0.0 < joints[0, RADIUS] < 1e-13
    assert 0.0 < joints[0, ROUNDING] <= joints[0, BOW_ROUNDING] < 1e-13
    assert joints[0, BOW] == pytest.approx(6.0 + 12.0)
    assert joints[0, JERK] == pytest.approx(24.0)


def random_motion(random: np.random.Generator, n: int, pieces: int, jump: float) -> Trajectory:
    """Pieces of random degree that go on from each other but for jumps."""
    size = int(random.integers(2, 8))
    breaks = np.concatenate([[0.0], np.cumsum(random.uniform(0.02, 0.4, pieces))])
    c = np.zeros((pieces, n, size))
    value, rate = random.uniform(-1.5, 1.5, n), random.normal(size=n)
    for i in range(pieces):
        length = breaks[i + 1] - breaks[i]
        c[i] = random.normal(size=(n, size)) * 0.2 / length ** np.arange(size)
        c[i, :, 0] = value + jump * random.normal(size=n)
        c[i, :, 1] = rate + jump * random.normal(size=n)
        rows = [np.polynomial.Polynomial(row) for row in c[i]]
        value = np.array([row(length) for row in rows])
        rate = np.array([row.deriv()(length) for row in rows])
    return Trajectory(tuple(f"j{j}" for j in range(n)), breaks, c)


def enclosed_span(random: np.random.Generator, motion: Trajectory) -> tuple[Array, float, Array]:
    """What ``enclose_span`` tells of some pieces about a break of theirs, the break, their ends."""
    pieces, n = motion.coefficients.shape[:2]
    first, last = sorted(random.choice(pieces, 2, replace=False))
    middle = int(random.integers(first + 1, last + 1))
    table, joints = np.empty((pieces, n, PIECE_COLUMNS)), np.empty((n, JOINT_COLUMNS))
    piece_bounds(motion.breaks, motion.coefficients, table)
    at, ends = float(motion.breaks[middle]), motion.breaks[[first, last + 1]]
    half = float(np.abs(ends - at).max())
    enclose_span(motion.coefficients, table, first, last, middle, half, joints)
    return joints, at, ends


@pytest.mark.parametrize("jump", [0.0, 1e-3])
def test_span_encloses_several_pieces_with_their_jumps(jump: float) -> None:
    random = np.random.default_rng(5)
    for _ in range(60):
        pieces = int(random.integers(2, 9))
        motion = random_motion(random, 2, pieces, jump)
        joints, at, ends = enclosed_span(random, motion)
        times = np.linspace(ends[0], ends[1], 200)[:-1]
        values, rates = motion.sample(times), motion.sample(times, 1)
        s = (times - at)[:, None]
        assert (np.abs(values - joints[:, VALUE]) <= joints[:, RADIUS] + 1e-12).all()
        assert (np.abs(rates) <= joints[:, SPEED] + 1e-12).all()
        bend = 0.5 * joints[:, ACCELERATION] * s**2 + joints[:, ROUNDING]
        assert (np.abs(values - joints[:, VALUE] - s * joints[:, RATE]) <= bend + 1e-12).all()


def smooth_motion(random: np.random.Generator, n: int, pieces: int, jump: float) -> Trajectory:
    """Quintic pieces that go on from each other up to accelerations, but for jumps of these."""
    lengths = random.uniform(0.02, 0.4, pieces)
    c = random.normal(size=(pieces, n, 6)) * 0.1 / 0.4 ** np.arange(6)
    c[0, :, 0] = random.uniform(-1.5, 1.5, n)
    for i in range(1, pieces):
        for j in range(n):
            row = np.polynomial.Polynomial(c[i - 1, j])
            c[i, j, 0], c[i, j, 1] = row(lengths[i - 1]), row.deriv()(lengths[i - 1])
            c[i, j, 2] = 0.5 * row.deriv(2)(lengths[i - 1]) * (1.0 + jump * random.normal())
    breaks = np.concatenate([[0.0], np.cumsum(lengths)])
    return Trajectory(tuple(f"j{j}" for j in range(n)), breaks, c)


@pytest.mark.parametrize(("jump", "smooth"), [(0.0, True), (1e-13, True), (0.1, False)])
def test_a_span_is_told_to_second_order_where_accelerations_go_on(
    jump: float, smooth: bool
) -> None:
    random = np.random.default_rng(6)
    for _ in range(40):
        pieces = int(random.integers(2, 9))
        motion = smooth_motion(random, 2, pieces, jump)
        joints, at, ends = enclosed_span(random, motion)
        assert (np.isfinite(joints[:, JERK]) == smooth).all()
        if not smooth:
            continue
        times = np.linspace(ends[0], ends[1], 300)[:-1]
        s = (times - at)[:, None]
        second = joints[:, VALUE] + s * joints[:, RATE] + 0.5 * s**2 * joints[:, BOW]
        twist = joints[:, JERK] * np.abs(s) ** 3 / 6.0 + joints[:, BOW_ROUNDING]
        assert (np.abs(motion.sample(times) - second) <= twist + 1e-12).all()
        # Jumps that are rounding take nothing off it.
        assert (joints[:, BOW_ROUNDING] < 1e-9).all()
