"""Joints, frames and extrema on cells of time against fractions, roots and pinocchio."""

from fractions import Fraction

import numpy as np
import pinocchio as pin
import pytest

from kinematics.arrays import Array
from kinematics.forward import frames_kernel, joint_frames
from kinematics.robots import builtin_chain, builtin_urdf
from kinematics.trajectory.trajectory import Trajectory
from planning.proof.extrema import extrema, jumps, largest_jump, to_bernstein
from planning.proof.joint_frames import forward_kernel
from planning.proof.limits.limit_uses import (
    AT,
    BEYOND,
    EXCESS,
    JOINT,
    JUMPING,
    LIMITED,
    RATIO,
    UNLIMITED,
    limit_uses,
    motion_uses,
)
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
from planning.proof.relative_motion import axis_motion, relative_motion
from tests.dynamics.samples import pinocchio_model, random_chain


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


NAMES = ["panda", "stanford"]


def frames_at(model: pin.Model, q: Array, n: int) -> Array:
    """Frames of the first n joints in the base frame, (n + 1, 4, 4), the base itself last."""
    data = model.createData()
    pin.forwardKinematics(model, data, np.concatenate([q, np.zeros(model.nq - n)]))
    poses = [data.oMi[k + 1].homogeneous for k in range(n)]
    return np.array([*poses, np.eye(4)])


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("outwards", [True, False])
def test_points_axes_and_turns_stay_within_their_bounds(name: str, outwards: bool) -> None:
    chain, random = builtin_chain(name), np.random.default_rng(3)
    model, n = pin.buildModelFromXML(builtin_urdf(name)), chain.n
    tightest = np.inf
    for _ in range(40):
        c = random.normal(size=(n, 5)) * 0.5 ** np.arange(5)
        half, at = float(10.0 ** random.uniform(-3.0, -0.5)), 0.5
        joints = np.empty((n, JOINT_COLUMNS))
        enclose(c, at, half, np.empty((2, 5)), joints)
        pair = sorted(random.choice(np.arange(-1, n), 2, replace=False).tolist())
        reference, carrier = pair if outwards else pair[::-1]
        frames = frames_at(model, joints[:, VALUE], n)
        local, axis = random.normal(size=3) * 0.3, random.normal(size=3)
        axis /= np.linalg.norm(axis)
        point = (frames[carrier] @ np.append(local, 1.0))[:3]
        direction = frames[carrier][:3, :3] @ axis
        ours = joint_frames(chain, joints[:, VALUE])
        asked = (chain.joint_types, ours)
        spread = relative_motion(*asked, tuple(point.tolist()), carrier, reference, joints, half)
        swung, bent = axis_motion(
            *asked, tuple(direction.tolist()), carrier, reference, joints, half
        )
        for s in np.linspace(-half, half, 21):
            q = np.array([np.polynomial.polynomial.polyval(at + s, row) for row in c])
            then = frames_at(model, q, n)
            X = frames[reference] @ np.linalg.inv(then[reference]) @ then[carrier]
            moved = (X @ np.append(local, 1.0))[:3] - point
            assert np.linalg.norm(moved) <= spread.moved + 1e-9
            linear = moved - s * np.array(spread.velocity)
            assert np.linalg.norm(linear) <= spread.bend + 1e-9
            turn = pin.log3(X[:3, :3] @ frames[carrier][:3, :3].T)
            assert np.linalg.norm(turn) <= spread.turned + 1e-9
            swing = X[:3, :3] @ axis - direction
            assert np.linalg.norm(swing) <= swung + 1e-9
            rate = np.cross(spread.turn_rate, direction)
            assert np.linalg.norm(swing - s * rate) <= bent + 1e-9
            if abs(s) == half and np.linalg.norm(moved) > 1e-6:
                tightest = min(tightest, spread.moved / float(np.linalg.norm(moved)))
    assert tightest < 1.5


@pytest.mark.parametrize("seed", range(8))
def test_frames_are_those_of_pinocchio_and_of_the_planners(seed: int) -> None:
    chain = random_chain(seed, 1 + seed)
    model = pinocchio_model(chain)
    data = model.createData()
    rng = np.random.default_rng(seed)
    own, planners = np.zeros((2, chain.n, 4, 4))
    for _ in range(20):
        q = rng.uniform(-3.0, 3.0, chain.n)
        forward_kernel(chain.joint_types, chain.offsets, q, own)
        frames_kernel(chain.model, q, planners)
        assert np.array_equal(own, planners)
        pin.forwardKinematics(model, data, q)
        for j in range(chain.n):
            expected = data.oMi[j + 1].homogeneous[:3]
            np.testing.assert_allclose(own[j, :3], expected, atol=1e-13)


def by_roots(p: np.polynomial.Polynomial, length: float) -> tuple[float, float]:
    """Least and largest value of a polynomial on [0, length], by numpy."""
    slope = p.deriv().trim()
    roots = slope.roots() if len(slope.coef) > 1 else np.zeros(0)
    real = roots.real[np.abs(roots.imag) < 1e-6 * (1.0 + np.abs(roots))]
    places = [0.0, length, *(t for t in real if 0.0 < t < length)]
    values = [float(p(t)) for t in places]
    return min(values), max(values)


@pytest.mark.parametrize("size", [1, 2, 3, 4, 6, 9])
@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_extrema_are_those_of_the_roots(size: int, order: int) -> None:
    random = np.random.default_rng(10 * size + order)
    for _ in range(60):
        m, n = int(random.integers(1, 5)), 3
        breaks = np.concatenate([[0.0], np.cumsum(10.0 ** random.uniform(-2.0, 1.0, m))])
        lengths = np.diff(breaks)[:, None, None]
        c = random.normal(size=(m, n, size)) / lengths ** np.arange(size)
        found = extrema(breaks, c, order)
        for j in range(n):
            ends = [
                by_roots(np.polynomial.Polynomial(c[i, j]).deriv(order), float(lengths[i, 0, 0]))
                for i in range(m)
            ]
            low, high = min(a for a, _ in ends), max(b for _, b in ends)
            size_of = max(abs(low), abs(high), 1e-300)
            assert found.maximum[j] == pytest.approx(high, rel=1e-9, abs=1e-9 * size_of)
            assert found.minimum[j] == pytest.approx(low, rel=1e-9, abs=1e-9 * size_of)
            # From outside, and hardly so.
            assert high - 1e-12 * size_of <= found.upper[j] <= high + 1e-8 * size_of
            assert low - 1e-8 * size_of <= found.lower[j] <= low + 1e-12 * size_of
            motion = Trajectory(("a", "b", "c"), breaks, c)
            at = motion.sample([min(found.time_of_maximum[j], breaks[-1])], order)[0, j]
            before = motion.sample([max(found.time_of_maximum[j] - 1e-9, 0.0)], order)[0, j]
            assert max(at, before) == pytest.approx(high, abs=1e-5 * size_of)


def test_a_narrow_peak_is_found() -> None:
    # 1 - (1e4 (t - 0.3))^2 (...) between 0 and 1: a peak that samples of a thousandth miss.
    t = np.polynomial.Polynomial([-0.3, 1.0])
    p = 1.0 - 1e8 * t**2 + 1e15 * t**4
    c: Array = np.array(p.coef, dtype=np.float64)[None, None]
    found = extrema(np.array([0.0, 0.3001]), c, 0)
    assert found.maximum[0] == pytest.approx(max(1.0, float(p(0.0)), float(p(0.3001))), rel=1e-6)
    dip = extrema(np.array([0.0, 0.3001]), -c, 0)
    assert dip.minimum[0] == pytest.approx(-found.maximum[0], rel=1e-12)


def test_bernstein_coefficients_are_the_control_points() -> None:
    b = np.empty(6)
    count = to_bernstein(np.array([1.0, 2.0, -3.0, 4.0]), 2.0, 0, b)
    # Of 1 + 4 u - 12 u^2 + 32 u^3 by hand.
    np.testing.assert_allclose(b[:count], [1.0, 1.0 + 4.0 / 3.0, 1.0 + 8.0 / 3.0 - 4.0, 25.0])


def test_jumps_of_every_order() -> None:
    c = np.zeros((2, 1, 4))
    c[0, 0] = [1.0, 2.0, 3.0, 4.0]
    c[1, 0] = [10.0 + 1e-3, 20.0 + 2e-3, 30.0, 4.0]
    motion = Trajectory(("a",), np.array([0.0, 1.0, 2.0]), c)
    # At t = 1 the first piece has value 10, velocity 20, acceleration 30, jerk 24.
    for order, jump in enumerate((1e-3, 2e-3, 60.0 - 30.0, 0.0)):
        assert jumps(motion, order)[0, 0] == pytest.approx(jump, abs=1e-12)
        largest = largest_jump(motion.breaks, motion.coefficients, order)
        assert largest == pytest.approx(abs(jump), abs=1e-12)


def test_the_largest_jump_is_no_number_where_some_jump_is_none() -> None:
    c, breaks = np.zeros((3, 2, 2)), np.arange(4.0)
    c[1, 1, 0], c[2, 0, 0] = np.nan, 3.0
    assert np.isnan(largest_jump(breaks, c, 0))
    assert largest_jump(breaks, c, 1) == 0.0
    assert largest_jump(breaks[:2], c[:1], 0) == 0.0


def test_uses_of_limits_are_those_of_the_extrema() -> None:
    """Position and derivatives at once, with limits on both sides, on one or on none."""
    random = np.random.default_rng(8)
    for _ in range(40):
        m, n, size = int(random.integers(1, 5)), 4, int(random.integers(1, 8))
        breaks = np.concatenate([[0.0], np.cumsum(10.0 ** random.uniform(-1.0, 0.5, m))])
        motion = Trajectory(tuple("abcd"), breaks, random.normal(size=(m, n, size)))
        lower = -random.uniform(0.1, 5.0, (4, n))
        upper = np.where(np.arange(4)[:, None] == 0, lower + random.uniform(0.1, 9.0, n), -lower)
        lower[0, 1], upper[0, 2], lower[1:, 3], upper[1:, 3] = -np.inf, np.inf, -np.inf, np.inf
        found = limit_uses(motion, lower, upper)
        for order in range(4):
            ends = extrema(breaks, motion.coefficients, order)
            np.testing.assert_array_equal(found.highest[order, :, 0], ends.maximum)
            np.testing.assert_array_equal(found.lowest[order, :, 0], -ends.minimum)
            half = 0.5 * (upper[order] - lower[order])
            both = np.isfinite(half)
            middle = 0.5 * (upper[order][both] + lower[order][both])
            ratios = np.zeros(n)
            ratios[both] = np.maximum(ends.maximum[both] - middle, middle - ends.minimum[both])
            ratios[both] /= half[both]
            use = found.uses[order]
            assert use[RATIO] == pytest.approx(ratios.max(), rel=1e-12)
            assert use[JOINT] == np.argmax(ratios)
            at = motion.sample([min(use[AT], breaks[-1])], order)[0, int(use[JOINT])]
            before = motion.sample([max(use[AT] - 1e-9, 0.0)], order)[0, int(use[JOINT])]
            extreme = ends.maximum[int(use[JOINT])], ends.minimum[int(use[JOINT])]
            near = [abs(value - end) for value in (at, before) for end in extreme]
            assert ratios.max() == 0.0 or min(near) <= 1e-5 * (1.0 + np.abs(extreme).max())
            excess = np.maximum(lower[order] - ends.lower, ends.upper - upper[order])
            if order:
                excess[both] /= half[both]
            assert use[EXCESS] == pytest.approx(excess.max(), rel=1e-9, abs=1e-12)
            assert use[BEYOND] == np.argmax(excess)


def test_equal_uses_of_a_limit_are_told_of_the_first_instant_and_joint() -> None:
    """A motion from rest to rest speeds up as hard as it slows down: rounding does not choose."""
    random = np.random.default_rng(5)
    for _ in range(50):
        step = random.uniform(0.05, 2.0) * random.choice([-1.0, 1.0])
        rest_to_rest = np.array([0.0, 0.0, 0.0, 10.0, -15.0, 6.0]) * step
        rest_to_rest[3:] *= 1.0 + 1e-15 * random.integers(-4, 5, 3)
        coefficients = np.stack([rest_to_rest, rest_to_rest * (1.0 + 1e-15)])[None]
        motion = Trajectory(("a", "b"), np.array([0.0, 1.0]), coefficients)
        limit = np.full((3, 2), 9.0)
        found = limit_uses(motion, -limit, limit)
        assert found.uses[2, JOINT] == 0
        assert found.uses[2, AT] == pytest.approx(0.5 - np.sqrt(3.0) / 6.0, rel=1e-6)
        # Pieces that push equally hard: the first of them.
        pushes = step * (1.0 + 1e-15 * random.integers(-4, 5, 5))[:, None, None]
        motion = Trajectory(("a",), np.arange(6.0), pushes * np.array([0.0, 0.0, 0.5]))
        found = limit_uses(motion, -limit[:, :1], limit[:, :1])
        assert found.uses[2, AT] == 0.0


def test_what_is_no_number_is_beyond_all_limits() -> None:
    motion = Trajectory(("a", "b"), np.array([0.0, 1.0]), np.zeros((1, 2, 2)))
    bound = np.array([[5.0, 5.0], [0.0, 1.0]])
    found = limit_uses(motion, -bound, bound)
    # A joint that may not move and does not: no share of its limit can be told.
    assert found.uses[1, EXCESS] == np.inf
    assert found.uses[1, BEYOND] == 0


def any_motion(random: np.random.Generator) -> Trajectory:
    breaks = np.concatenate([[0.0], np.cumsum(random.uniform(0.1, 1.0, 3))])
    return Trajectory(tuple("abcd"), breaks, random.normal(size=(3, 4, 6)))


@pytest.mark.parametrize("seed", range(4))
def test_limits_of_a_motion_are_used_as_its_derivatives_tell(seed: int) -> None:
    random = np.random.default_rng(seed)
    motion = any_motion(random)
    n = motion.n
    limits = random.uniform(0.5, 3.0, (5, n))
    limits[0] = -limits[1]
    limits[2, 0], limits[4] = np.inf, (np.nan if seed % 2 else limits[4])
    used = motion_uses(motion, limits, np.inf)
    assert used.limited.tolist() == [LIMITED, LIMITED, LIMITED, UNLIMITED if seed % 2 else LIMITED]
    upper = np.where(np.isfinite(limits[1:]), limits[1:], np.inf)
    lower = -upper
    lower[0] = limits[0]
    orders = 3 if seed % 2 else 4
    expected = limit_uses(motion, lower[:orders], upper[:orders])
    for name in expected._fields:
        np.testing.assert_array_equal(getattr(used.found, name), getattr(expected, name))
    np.testing.assert_array_equal(used.lower, lower)
    np.testing.assert_array_equal(used.upper, upper)


def test_jerk_is_not_looked_at_where_the_acceleration_jumps() -> None:
    motion = any_motion(np.random.default_rng(0))
    limits = np.ones((5, motion.n))
    assert motion_uses(motion, limits, -1.0).limited.tolist() == [
        LIMITED,
        LIMITED,
        LIMITED,
        JUMPING,
    ]
