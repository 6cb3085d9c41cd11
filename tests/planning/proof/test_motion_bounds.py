"""Bounds on cells of time, against exact fractions and dense looks at moving solids."""

from fractions import Fraction

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.forward import joint_frames
from kinematics.trajectory import Trajectory
from planning.proof.motion_bounds import (
    ACCELERATION,
    JOINT_COLUMNS,
    MOVE_COLUMNS,
    MOVED,
    PIECE_COLUMNS,
    RADIUS,
    RATE,
    ROUNDING,
    SPEED,
    VALUE,
    displacement_along,
    displacement_bounds,
    enclose,
    enclose_span,
    piece_bounds,
)
from tests.planning.scenes import builtin


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
                assert abs(rate) <= row[SPEED] * allowed


def test_a_cell_without_length_strays_by_rounding_alone() -> None:
    joints = np.empty((1, JOINT_COLUMNS))
    enclose(np.array([[1.0, 2.0, 3.0, 4.0]]), 0.5, 0.0, np.empty((2, 4)), joints)
    assert joints[0, VALUE] == pytest.approx(1.0 + 1.0 + 0.75 + 0.5)
    assert joints[0, RATE] == pytest.approx(2.0 + 3.0 + 3.0)
    assert 0.0 < joints[0, RADIUS] < 1e-13
    assert 0.0 < joints[0, ROUNDING] < 1e-13


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


@pytest.mark.parametrize("jump", [0.0, 1e-3])
def test_span_encloses_several_pieces_with_their_jumps(jump: float) -> None:
    random = np.random.default_rng(5)
    for _ in range(60):
        pieces = int(random.integers(2, 9))
        motion = random_motion(random, 2, pieces, jump)
        first, last = sorted(random.choice(pieces, 2, replace=False))
        middle = int(random.integers(first + 1, last + 1))
        table, joints = np.empty((pieces, 2, PIECE_COLUMNS)), np.empty((2, JOINT_COLUMNS))
        piece_bounds(motion.breaks, motion.coefficients, table)
        at, ends = motion.breaks[middle], motion.breaks[[first, last + 1]]
        half = float(np.abs(ends - at).max())
        enclose_span(motion.coefficients, table, first, last, middle, half, joints)
        times = np.linspace(ends[0], ends[1], 200)[:-1]
        values, rates = motion.sample(times), motion.sample(times, 1)
        s = (times - at)[:, None]
        assert (np.abs(values - joints[:, VALUE]) <= joints[:, RADIUS] + 1e-12).all()
        assert (np.abs(rates) <= joints[:, SPEED] + 1e-12).all()
        bend = 0.5 * joints[:, ACCELERATION] * s**2 + joints[:, ROUNDING]
        assert (np.abs(values - joints[:, VALUE] - s * joints[:, RATE]) <= bend + 1e-12).all()


@pytest.mark.parametrize("name", ["panda", "stanford", "scara", "kr6_sixx"])
def test_no_point_of_a_ball_moves_farther_than_its_bounds(name: str) -> None:
    """Points of balls on links, seen from other links, along many directions."""
    chain = builtin(name).chain
    random = np.random.default_rng(7)
    tightest = np.inf
    for case in range(40):
        motion = random_motion(random, chain.n, 1, 0.0)
        length = motion.duration
        half = float(length / 2.0 * 10.0 ** -random.uniform(0.0, 3.0))
        at = float(random.uniform(half, length - half))
        joints = np.empty((chain.n, JOINT_COLUMNS))
        size = motion.coefficients.shape[2]
        enclose(motion.coefficients[0], at, half, np.empty((2, size)), joints)
        frames = joint_frames(chain, joints[:, VALUE])
        carrier = int(random.integers(0, chain.n))
        still = int(random.integers(-1, carrier))
        radius = float(random.uniform(0.0, 0.2))
        local = np.append(random.normal(size=3) * 0.3, 1.0)
        center = (frames[carrier] @ local)[:3]
        moves = np.zeros((chain.n, MOVE_COLUMNS))
        types = chain.joint_types
        middle = (float(center[0]), float(center[1]), float(center[2]))
        displacement_bounds(types, frames, middle, radius, carrier, joints, half, moves)
        bound = moves[still + 1, MOVED]
        offsets = random.normal(size=(12, 3))
        offsets *= radius / np.linalg.norm(offsets, axis=1, keepdims=True)
        inside = np.concatenate([offsets, np.zeros((12, 1))], axis=1)
        points = (local + inside @ np.linalg.inv(frames[carrier]).T) if radius else local[None]
        base = np.eye(4) if still < 0 else frames[still]
        start = (frames[carrier] @ points.T)[:3]
        for time in np.linspace(at - half, at + half, 15):
            then = joint_frames(chain, motion.sample([min(max(time, 0.0), length)])[0])
            seen = np.eye(4) if still < 0 else then[still]
            moved = (base @ np.linalg.inv(seen) @ then[carrier] @ points.T)[:3] - start
            farthest = float(np.linalg.norm(moved, axis=0).max())
            assert farthest <= bound + 1e-12
            if case % 3 == 0 and abs(time - at) == half and farthest > 0.0:
                tightest = min(tightest, bound / farthest)
            for towards in random.normal(size=(6, 3)):
                u = towards / np.linalg.norm(towards)
                along = displacement_along(moves, still + 1, radius, half, (u[0], u[1], u[2]))
                assert float(np.abs(u @ moved).max()) <= along + 1e-12
                assert along <= bound
    assert tightest < 2.0


def test_bound_of_a_turning_arm_is_the_arc() -> None:
    frames = np.eye(4)[None].copy()
    types = np.zeros(1, dtype=np.int64)
    for angle in (0.0, 1e-3, 0.5, 10.0):
        joints, moves = np.zeros((1, JOINT_COLUMNS)), np.zeros((1, MOVE_COLUMNS))
        joints[0, RADIUS] = joints[0, SPEED] = joints[0, RATE] = angle
        displacement_bounds(types, frames, (1.0, 0.0, 5.0), 0.1, 0, joints, 1.0, moves)
        # A point never moves farther than its circle's diameter.
        assert moves[0, MOVED] == pytest.approx(min(1.1 * angle, 2.2))
        across = displacement_along(moves, 0, 0.1, 1e-3, (0.0, 0.0, 1.0))
        assert across == pytest.approx(min(0.5 * 1.1 * angle**2, 1.1 * angle, 2.2))
