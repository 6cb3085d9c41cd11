"""Limits of timed motions, and the jets that enclose torques and the tool's speed."""

from collections.abc import Callable
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynamics.model.body import Bodies, bodies
from dynamics.model.payload import with_payload
from kinematics.arrays import Array
from kinematics.forward import joint_frames
from kinematics.model.chain import Chain, Limits
from kinematics.robots import builtin_chain
from kinematics.trajectory.trajectory import Extrema, Peaks, Trajectory, stay
from planning.proof.limits.effort import effort_uses, tool_speed_use, torque_use
from planning.proof.limits.effort_bounds import HALF, JET, MIDDLE, effort_bounds_kernel
from planning.proof.limits.jet import (
    Jet,
    JetVector,
    add,
    constant_vector,
    cross,
    cross_constant,
    multiply,
    plus,
    scale,
    sine_cosine,
    size,
    weighted_sum,
)
from planning.proof.limits.limits import check_continuity, check_limits
from planning.values.limits import EffortLimits, MotionLimits
from tests.planning.pinocchio_arm import PinocchioArm

NAMES = ("a", "b")


def limits(position: float = 10.0) -> Limits:
    two = np.full(2, np.inf)
    return Limits(np.full(2, -position), np.full(2, position), two, two, two, two)


def swing(height: float = 1.0, length: float = 2.0) -> Trajectory:
    """Joint b goes to ``height`` and back: a cubic up and its mirror image down, at rest between.

    Velocity peaks at 1.5 height / length, acceleration at 6 height / length^2, jerk is
    12 height / length^3.
    """
    up = np.array([0.0, 0.0, 3.0 / length**2, -2.0 / length**3]) * height
    down = np.array([height, 0.0, -3.0 * height / length**2, 2.0 * height / length**3])
    c = np.zeros((2, 2, 4))
    c[0, 1], c[1, 1] = up, down
    return Trajectory(NAMES, np.array([0.0, length, 2.0 * length]), c)


PEAKS = {"velocity": 1.5 / 2.0, "acceleration": 6.0 / 4.0}


@pytest.mark.parametrize("name", PEAKS)
def test_a_limit_just_above_the_peak_holds_and_one_just_below_does_not(name: str) -> None:
    peak = PEAKS[name]
    for share in (1.0 + 1e-8, 1.0, 1.0 - 1e-8):
        bound = np.array([np.inf, peak * share])
        reports, wrong, _ = check_limits(swing(), limits(), MotionLimits({name: bound}))
        assert reports[name].worst_ratio == pytest.approx(1.0 / share, rel=1e-10)
        assert reports[name].joint == "b"
        assert bool(wrong) is (share < 1.0)
        if wrong:
            assert wrong[0].kind == name
            assert wrong[0].details["limit"] == bound[1]
    if name == "velocity":
        assert reports[name].time == pytest.approx(1.0, abs=1e-3)


def test_the_time_of_a_violation_is_when_the_limit_is_left() -> None:
    bound = np.array([np.inf, 0.5])
    _, wrong, _ = check_limits(swing(), limits(), MotionLimits({"velocity": bound}))
    # 6 t / 4 - 6 t^2 / 8 = 0.5 first at t = 1 - sqrt(1 / 3).
    assert wrong[0].time == pytest.approx(1.0 - np.sqrt(1.0 / 3.0), abs=1e-9)


def test_positions_are_held_to_both_ends_of_their_range() -> None:
    for bound, is_wrong in ((1.0, False), (1.0 - 1e-6, True)):
        for height in (1.0, -1.0):
            reports, wrong, _ = check_limits(swing(height), limits(bound), MotionLimits())
            assert bool(wrong) is is_wrong
            assert reports["position"].worst_ratio == pytest.approx(1.0 / bound, rel=1e-9)
            if wrong:
                assert wrong[0].kind == "position"
                assert wrong[0].details["joint"] == "b"
                assert wrong[0].time == pytest.approx(2.0, abs=5e-3)


def test_jerk_has_no_bound_where_the_acceleration_jumps() -> None:
    # From -6 / 4 to -6 / 4: no jump in the middle of the swing, one of a polygon.
    smooth = check_limits(swing(), limits(), MotionLimits({"jerk": np.full(2, 2.0)}))
    assert smooth[0]["jerk"].worst_ratio == pytest.approx(12.0 / 8.0 / 2.0)
    assert not smooth[1]
    c = np.zeros((2, 2, 3))
    c[0, 0], c[1, 0] = [0.0, 0.0, 1.0], [1.0, 2.0, -1.0]
    jerky = Trajectory(NAMES, np.array([0.0, 1.0, 2.0]), c)
    reports, wrong, _ = check_limits(jerky, limits(), MotionLimits({"jerk": np.full(2, 2.0)}))
    assert "jerk" not in reports
    assert wrong[0].kind == "jerk"
    assert wrong[0].details == {"joint": "a", "jump": pytest.approx(4.0)}


def _steps(random: np.random.Generator, jerk: float, jump: float) -> Trajectory:
    """Pieces of constant jerk of joint b, the acceleration of which jumps once; a rests."""
    pieces = int(random.integers(2, 6))
    breaks = np.concatenate([[0.0], np.cumsum(random.uniform(0.2, 1.0, pieces))])
    jerks = jerk * random.choice([-1.0, 1.0], pieces) * random.uniform(0.1, 0.9, pieces)
    jerks[random.integers(pieces)] = jerk
    at = int(random.integers(1, pieces))
    c = np.zeros((pieces, 2, 4))
    q, v, a = random.normal(size=3)
    for i, length in enumerate(np.diff(breaks)):
        a += jump if i == at else 0.0
        c[i, 1] = q, v, a / 2.0, jerks[i] / 6.0
        t = np.array([1.0, length, length**2 / 2.0, length**3 / 6.0])
        q, v, a = t @ [q, v, a, jerks[i]], t[:3] @ [v, a, jerks[i]], a + jerks[i] * length
    return Trajectory(NAMES, breaks, c)


@pytest.mark.parametrize("seed", range(8))
def test_a_jump_of_the_acceleration_is_told_and_the_jerk_beside_it_is_held_to(seed: int) -> None:
    random = np.random.default_rng(seed)
    free = np.full(2, np.inf)
    known = Limits(-free, free, free, free, np.array([np.inf, 1.0]), free)
    for jump in (0.0, float(random.choice([-1.0, 1.0]) * random.uniform(1e-5, 3.0))):
        for jerk in (0.99, 1.01):
            motion = _steps(random, jerk, jump)
            for bounds, holds in (({}, True), ({"jerk": known.jerk}, True), ({}, False)):
                wanted = MotionLimits(bounds, None, holds)
                reports, wrong, told = check_limits(motion, known, wanted)
                fast, jumps = [jerk > 1.0], [jump != 0.0]
                refused = (fast if holds else []) + (jumps if bounds else [])
                assert len(wrong) == sum(refused)
                assert len(wrong) + len(told) == sum(fast + jumps)
                assert {one.kind for one in wrong + told} <= {"jerk"}
                assert all(one.message.endswith("proved but for jerk") for one in told)
                assert ("jerk" in reports) is (jump == 0.0)
    # A joint that no limit of jerk is known of may jump.
    other = Limits(-free, free, free, free, np.array([1.0, np.inf]), free)
    assert check_limits(motion, other, MotionLimits({"jerk": other.jerk}))[1:] == ([], [])


@pytest.mark.parametrize(("order", "name"), [(0, "position"), (1, "velocity")])
def test_jumps_between_pieces_are_violations(order: int, name: str) -> None:
    assert not check_continuity(swing())[1]
    c = np.array(swing().coefficients)
    c[1, 0, order] = 1e-6
    continuity, wrong = check_continuity(Trajectory(NAMES, swing().breaks, c))
    assert continuity[name] == pytest.approx(1e-6)
    assert wrong[0].kind == "continuity"
    assert wrong[0].details["quantity"] == name
    assert wrong[0].time == 2.0


def test_peaks_that_lie_are_not_believed(monkeypatch: pytest.MonkeyPatch) -> None:
    """What planners scale time by may be wrong: the proof has extrema of its own."""
    told = Trajectory.peaks, Trajectory.extrema, Trajectory.piece_extrema

    def peaks(self: Trajectory, derivative: int = 0) -> Peaks:
        value, time = told[0](self, derivative)
        return Peaks(value / 1.05, time)

    def ends(self: Trajectory, derivative: int = 0) -> Extrema:
        low, low_time, high, high_time = told[1](self, derivative)
        return Extrema(low / 1.05, low_time, high / 1.05, high_time)

    def piece_ends(self: Trajectory, derivative: int = 0) -> tuple[Array, Array]:
        low, high = told[2](self, derivative)
        return low / 1.05, high / 1.05

    monkeypatch.setattr(Trajectory, "peaks", peaks)
    monkeypatch.setattr(Trajectory, "extrema", ends)
    monkeypatch.setattr(Trajectory, "piece_extrema", piece_ends)
    bound = np.array([np.inf, PEAKS["velocity"] / 1.04])
    _, wrong, _ = check_limits(swing(), limits(1.0 / 1.04), MotionLimits({"velocity": bound}))
    assert {violation.kind for violation in wrong} == {"velocity", "position"}
    assert wrong[1].time == pytest.approx(1.0 - np.sqrt(1.0 - 1.0 / 1.04), abs=1e-6)


def test_torque_and_tool_speed_are_reported_and_refused() -> None:
    chain = builtin_chain("planar_rr")
    c = np.zeros((1, 2, 2))
    c[0, 0] = [0.0, 1.0]
    turn = Trajectory(chain.joint_names, np.array([0.0, 1.0]), c)
    reach = float(np.linalg.norm(chain.offsets[1, :3, 3]))
    reach += float(np.linalg.norm(chain.tip.T_joint_link[:3, 3]))
    for share, is_wrong in ((1.001, False), (0.999, True)):
        loads = EffortLimits(chain, None, reach * share)
        reports, wrong, _ = check_limits(turn, chain.limits, MotionLimits({}, loads))
        assert reports["tool_speed"].worst_ratio == pytest.approx(1.0 / share, rel=1.1e-3)
        assert [violation.kind == "tool_speed" for violation in wrong] == [True] * is_wrong


@pytest.mark.parametrize("length", [2.2e-311, 1e-200, 1e-12, 1.0])
def test_huge_motions_in_no_time_are_refused_with_a_time_inside(length: float) -> None:
    rows = np.array([[8.8e11, -4.0e11, 1.2e-38, -9.6e11], [0.0, -1.1e-308, 8.0e11, 1e-310]])
    names = ("joint_1", "joint_2")
    motion = Trajectory(names, np.array([0.0, length]), rows[None])
    _, wrong, _ = check_limits(motion, limits(), MotionLimits({}))
    assert wrong[0].kind == "position"
    assert 0.0 <= wrong[0].time <= length


EFFORT_NAMES = ["panda", "ur5e", "kr6_sixx"]


def motion_of(chain: Chain, random: np.random.Generator) -> Trajectory:
    breaks = np.concatenate([[0.0], np.cumsum(random.uniform(0.05, 0.5, 4))])
    coefficients = random.uniform(-1.0, 1.0, (4, chain.n, 6))
    return Trajectory(chain.joint_names, breaks, coefficients)


@pytest.mark.parametrize("name", EFFORT_NAMES)
def test_bounds_lie_above_pinocchio_and_near_it(name: str) -> None:
    chain, arm, random = builtin_chain(name), PinocchioArm(name), np.random.default_rng(4)
    for _ in range(3):
        motion = motion_of(chain, random)
        # The pieces do not meet: each is looked at up to its end.
        times = np.concatenate(
            [
                np.linspace(a, b - 1e-12, 500)
                for a, b in zip(motion.breaks[:-1], motion.breaks[1:], strict=True)
            ]
        )
        v, a = (motion.sample(times, order) for order in (1, 2))
        effort = random.uniform(5.0, 100.0, chain.n)
        friction, motor = chain.viscous_friction * v, chain.motor_inertia * a
        ratios = np.abs(arm.torques(motion, times) + friction + motor) / effort
        use = torque_use(chain, motion, effort)
        assert ratios.max() <= use.ratio * (1.0 + 1e-9)
        assert use.ratio <= 1.005 * ratios.max()
        assert use.reached <= use.ratio
        assert use.joint == int(np.argmax(ratios.max(axis=0)))
        speeds = arm.tip_speeds(motion, times)
        bound = tool_speed_use(chain, motion, 0.5)
        assert speeds.max() / 0.5 <= bound.ratio * (1.0 + 1e-9)
        assert bound.ratio <= 1.005 * speeds.max() / 0.5


@pytest.mark.parametrize("share", [1.0 - 1e-6, 1.0 + 1e-6])
def test_a_millionth_decides(share: float) -> None:
    """A limit just above what a motion takes is kept, and one just below it is not."""
    chain, random = builtin_chain("ur5e"), np.random.default_rng(7)
    motion = motion_of(chain, random)
    free = torque_use(chain, motion, np.full(chain.n, 1e6))
    finest = torque_use(chain, motion, np.full(chain.n, 1e6 * free.ratio))
    # Bounds of limits that are just kept are as sharp as that needs.
    exact = 1e6 * free.ratio * finest.reached
    use = torque_use(chain, motion, np.full(chain.n, exact / share))
    assert (use.ratio <= 1.0 + 1e-9) is (share < 1.0)


def test_what_is_carried_counts() -> None:
    chain = builtin_chain("ur5e")
    loaded = with_payload(chain, 3.0, (0.0, 0.0, 0.1))
    q = np.array([0.0, -0.2, 0.3, 0.0, 0.0, 0.0])
    still = stay(chain.joint_names, q)
    effort = np.full(chain.n, 100.0)
    bare, heavy = (torque_use(robot, still, effort).ratio for robot in (chain, loaded))
    torques = PinocchioArm("ur5e").torque(q, 0.0 * q, 0.0 * q)
    assert bare == pytest.approx(np.abs(torques).max() / 100.0, rel=1e-6)
    assert heavy > bare + 0.05


def test_a_still_tool_has_no_speed_and_what_is_not_limited_is_not_told() -> None:
    chain = builtin_chain("panda")
    still = stay(chain.joint_names, np.zeros(7))
    uses = effort_uses(EffortLimits(chain, None, 0.3), still)
    assert set(uses) == {"tool_speed"}
    assert uses["tool_speed"].ratio <= 1e-6
    assert effort_uses(EffortLimits(chain), still) == {}


#: A function of time with its jet: |x''| <= X everywhere.
Known = tuple[Jet, Callable[[Array], Array]]

numbers = st.floats(-3.0, 3.0).map(lambda x: round(x, 3))
halves = st.sampled_from([1e-6, 1e-3, 0.1, 0.7, 2.0])


@st.composite
def functions(draw: st.DrawFn) -> Known:
    """A parabola or a wave of the largest curvature X: x_0 + x_1 s + X (1 - cos w s) / w^2."""
    x0, x1, curvature = draw(numbers), draw(numbers), abs(draw(numbers))
    w, sign = draw(st.sampled_from([0.0, 0.5, 3.0])), draw(st.sampled_from([1.0, -1.0]))

    def value(s: Array) -> Array:
        rest = 0.5 * s * s if w == 0.0 else (1.0 - np.cos(w * s)) / w**2
        return np.asarray(x0 + x1 * s + sign * curvature * rest)

    return (x0, x1, curvature, 0.0), value


vectors = st.tuples(functions(), functions(), functions())


def times(h: float) -> Array:
    return np.linspace(-h, h, 41)


def assert_encloses(jet: Jet, values: Array, h: float) -> None:
    s = times(h)
    bound = 0.5 * jet[2] * s * s + jet[3] + 1e-13 * (1.0 + np.abs(values))
    assert (np.abs(values - jet[0] - jet[1] * s) <= bound).all()


def jets(v: tuple[Known, Known, Known]) -> JetVector:
    return v[0][0], v[1][0], v[2][0]


def sampled(v: tuple[Known, Known, Known], h: float) -> Array:
    return np.array([f(times(h)) for _, f in v])


@given(functions(), halves)
def test_the_size_is_not_exceeded_and_reached_by_a_parabola(x: Known, h: float) -> None:
    jet, f = x
    assert np.abs(f(times(h))).max() <= size(jet, h) + 1e-12
    reached = abs(jet[0]) + abs(jet[1]) * h + 0.5 * jet[2] * h * h
    assert size(jet, h) == pytest.approx(reached)


@given(functions(), functions(), halves)
def test_products_enclose_products(x: Known, y: Known, h: float) -> None:
    product = multiply(x[0], y[0], h)
    assert_encloses(product, x[1](times(h)) * y[1](times(h)), h)
    assert multiply(y[0], x[0], h)[:2] == pytest.approx(product[:2])
    assert multiply(y[0], x[0], h)[2] == pytest.approx(product[2])


@given(functions(), functions())
def test_at_an_instant_the_curvature_of_a_product_is_that_of_leibniz(x: Known, y: Known) -> None:
    """X |y_0| + 2 |x_1 y_1| + |x_0| Y: not more than it must be."""
    (a, da, dda, _), (b, db, ddb, _) = x[0], y[0]
    expected = dda * abs(b) + 2.0 * abs(da * db) + abs(a) * ddb
    assert multiply(x[0], y[0], 0.0)[2] == pytest.approx(expected)


@given(functions(), halves)
def test_sine_and_cosine_enclose_theirs(x: Known, h: float) -> None:
    sine, cosine = sine_cosine(x[0], h)
    assert_encloses(sine, np.sin(x[1](times(h))), h)
    assert_encloses(cosine, np.cos(x[1](times(h))), h)
    # sin x and cos x turn by x': their curvature is that of x and the square of its rate.
    assert sine[2] == cosine[2] == pytest.approx(x[0][2] + (abs(x[0][1]) + x[0][2] * h) ** 2)


@given(functions(), functions(), numbers, halves)
def test_sums_and_multiples_enclose_theirs(x: Known, y: Known, k: float, h: float) -> None:
    s = times(h)
    assert_encloses(add(x[0], y[0]), x[1](s) + y[1](s), h)
    assert_encloses(scale(k, x[0]), k * x[1](s), h)
    assert scale(k, x[0])[2] >= 0.0
    assert add(x[0], scale(-1.0, x[0]))[:2] == (0.0, 0.0)


@given(vectors, vectors, halves)
def test_vector_products_enclose_theirs(
    u: tuple[Known, Known, Known], v: tuple[Known, Known, Known], h: float
) -> None:
    expected = np.cross(sampled(u, h), sampled(v, h), axis=0)
    for jet, values in zip(cross(jets(u), jets(v), h), expected, strict=True):
        assert_encloses(jet, values, h)
    for jet, values in zip(plus(jets(u), jets(v)), sampled(u, h) + sampled(v, h), strict=True):
        assert_encloses(jet, values, h)


@given(vectors, numbers, numbers, numbers, halves)
def test_products_with_constant_vectors_enclose_theirs(
    v: tuple[Known, Known, Known], a: float, b: float, c: float, h: float
) -> None:
    k, values = np.array([a, b, c]), sampled(v, h)
    assert_encloses(weighted_sum(a, b, c, jets(v)), k @ values, h)
    expected = np.cross(values, k[:, None], axis=0)
    for jet, row in zip(cross_constant(jets(v), a, b, c), expected, strict=True):
        assert_encloses(jet, row, h)
    # As with the vector that does not change.
    general = cross(jets(v), constant_vector(a, b, c), h)
    for special, jet in zip(cross_constant(jets(v), a, b, c), general, strict=True):
        assert special[:3] == pytest.approx(jet[:3], abs=1e-12)


def test_a_constant_does_not_move() -> None:
    for jet, value in zip(constant_vector(1.0, -2.0, 0.0), (1.0, -2.0, 0.0), strict=True):
        assert jet == (value, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("magnitude", [1e-8, 1.0, 1e8])
def test_rounding_is_within_the_error_told(magnitude: float) -> None:
    """Of sums of a dozen products, against rational numbers."""
    random = np.random.default_rng(1)
    for _ in range(200):
        total: Jet = (0.0, 0.0, 0.0, 0.0)
        exact = Fraction(0)
        for a, b in random.normal(size=(12, 2)) * magnitude:
            total = add(total, multiply((a, 0.0, 0.0, 0.0), (b, 0.0, 0.0, 0.0), 0.0))
            exact += Fraction(float(a)) * Fraction(float(b))
        assert abs(Fraction(total[0]) - exact) <= Fraction(total[3])
        assert total[3] <= 1e-13 * 12 * 25 * magnitude**2


@given(functions(), functions(), halves)
def test_errors_of_factors_are_errors_of_the_product(x: Known, y: Known, h: float) -> None:
    """Any function within e of x, and within f of y: their product is enclosed."""
    e, f = 1e-3, 2e-3
    product = multiply((*x[0][:3], e), (*y[0][:3], f), h)
    for left in (-e, e):
        for right in (-f, f):
            values = (x[1](times(h)) + left) * (y[1](times(h)) + right)
            assert_encloses(product, values, h)
    sine, _ = sine_cosine((*x[0][:3], e), h)
    assert_encloses(sine, np.sin(x[1](times(h)) + e), h)


JET_NAMES = ["panda", "ur5e", "kr6_sixx"]


def derivatives(coefficients: Array) -> Array:
    """Coefficients (m, n, k) of position, velocity and acceleration, shape (3, m, n, k)."""
    k = coefficients.shape[2]
    padded, c = np.zeros((3, *coefficients.shape)), coefficients
    for order in range(3):
        padded[order, :, :, : c.shape[2]] = c
        c = c[:, :, 1:] * np.arange(1.0, c.shape[2])
    assert c.shape[2] == k - 3
    return padded


def bounds(
    chain: Chain, coefficients: Array, intervals: Array, robot: Bodies | None = None
) -> tuple[Array, Array]:
    torques = np.empty((len(intervals), chain.n, JET))
    velocities = np.empty((len(intervals), 3, JET))
    tip = np.array(chain.tip.T_joint_link[:3, 3])
    effort_bounds_kernel(
        robot or bodies(chain), tip, derivatives(coefficients), intervals, torques, velocities
    )
    return torques, velocities


def motion(chain: Chain, random: np.random.Generator) -> Array:
    """Two pieces of degree four about the home position, shape (2, n, 5)."""
    c = random.normal(size=(2, chain.n, 5)) * 0.5 ** np.arange(5)
    c[:, :, 0] = random.uniform(-1.0, 1.0, (2, chain.n))
    return c


def states(c: Array, times: Array) -> tuple[Array, Array, Array]:
    rows = [np.polynomial.Polynomial(row) for row in c]
    q, v, a = (np.array([row.deriv(order)(times) for row in rows]).T for order in range(3))
    return q, v, a


@pytest.mark.parametrize("name", JET_NAMES)
@pytest.mark.parametrize("half", [1e-4, 1e-2, 0.2])
def test_torques_and_speeds_are_enclosed(name: str, half: float) -> None:
    chain, arm, random = builtin_chain(name), PinocchioArm(name), np.random.default_rng(1)
    c = motion(chain, random)
    intervals = np.array([[0, 0.3, half], [1, 0.5, half]])
    torques, velocities = bounds(chain, c, intervals)
    s = np.linspace(-half, half, 21)
    for k, (piece, middle, _) in enumerate(intervals):
        q, v, a = states(c[int(piece)], middle + s)
        exact = arm.torques_at(q, v, a)
        x, slope, curvature, error = torques[k].T
        rest = np.abs(exact - x - np.outer(s, slope))
        assert (rest <= 0.5 * np.outer(s * s, curvature) + error + 1e-9).all()
        # The tip's velocity in the last joint's axes: as long as in the base's.
        speeds = arm.tip_speeds_at(q, v)
        x, slope, curvature, error = velocities[k].T
        linear = x + np.outer(s, slope)
        spread = np.linalg.norm(0.5 * np.outer(s * s, curvature) + error, axis=1)
        assert (np.abs(np.linalg.norm(linear, axis=1) - speeds) <= spread + 1e-9).all()


@pytest.mark.parametrize("name", JET_NAMES)
def test_in_an_instant_they_are_the_values(name: str) -> None:
    chain, arm, random = builtin_chain(name), PinocchioArm(name), np.random.default_rng(2)
    c = motion(chain, random)
    torques, velocities = bounds(chain, c, np.array([[0, 0.4, 0.0]]))
    q, v, a = states(c[0], np.array([0.4]))
    np.testing.assert_allclose(torques[0, :, 0], arm.torques_at(q, v, a)[0], atol=1e-9)
    frame = joint_frames(chain, q[0])[-1]
    ahead, behind = (
        joint_frames(chain, states(c[0], np.array([t]))[0][0])[-1] @ chain.tip.T_joint_link
        for t in (0.4 + 1e-6, 0.4 - 1e-6)
    )
    velocity = frame[:3, :3].T @ (ahead[:3, 3] - behind[:3, 3]) / 2e-6
    np.testing.assert_allclose(velocities[0, :, 0], velocity, atol=1e-6)
    # Rounding of a few dozen operations.
    assert (torques[0, :, 3] < 1e-6).all()


@pytest.mark.parametrize("name", JET_NAMES)
def test_slopes_are_those_of_differences(name: str) -> None:
    chain, arm = builtin_chain(name), PinocchioArm(name)
    c = motion(chain, np.random.default_rng(3))
    torques, _ = bounds(chain, c, np.array([[1, 0.2, 1e-3]]))
    step = 1e-4
    after, before = (
        arm.torques_at(*states(c[1], np.array([t])))[0] for t in (0.2 + step, 0.2 - step)
    )
    np.testing.assert_allclose(
        torques[0, :, 1], (after - before) / (2.0 * step), rtol=1e-4, atol=1e-3
    )


def test_curvature_is_bounded_and_not_by_much_more_than_there_is() -> None:
    chain, arm = builtin_chain("ur5e"), PinocchioArm("ur5e")
    c = motion(chain, np.random.default_rng(4))
    torques, _ = bounds(chain, c, np.array([[0, 0.3, 1e-4]]))
    step = 1e-3
    values = [arm.torques_at(*states(c[0], np.array([0.3 + k * step])))[0] for k in (-1, 0, 1)]
    second = np.abs(values[0] - 2.0 * values[1] + values[2]) / step**2
    assert (torques[0, :, 2] >= second * (1.0 - 1e-3) - 1e-3).all()
    assert (torques[0, :, 2] <= 100.0 * (second.max() + 1.0)).all()


def test_halves_are_bounded_no_wider_than_the_whole() -> None:
    chain = builtin_chain("panda")
    c = motion(chain, np.random.default_rng(5))
    whole, half = np.array([[0, 0.3, 0.2]]), np.array([[0, 0.2, 0.1], [0, 0.4, 0.1]])
    wide, narrow = bounds(chain, c, whole), bounds(chain, c, half)
    for one, both in zip(wide, narrow, strict=True):
        assert (both[:, :, 2] <= one[:, :, 2] * (1.0 + 1e-9)).all()


def test_motors_and_friction_add_to_the_torques() -> None:
    """Rotor inertia times acceleration, and viscous friction times velocity, joint by joint."""
    chain, random = builtin_chain("ur5e"), np.random.default_rng(6)
    inertia, friction = random.uniform(0.1, 1.0, (2, chain.n))
    driven = bodies(chain)._replace(motor_inertia=inertia, viscous_friction=friction)
    c, interval = motion(chain, random), np.array([[0, 0.4, 1e-3]])
    bare, loaded = (bounds(chain, c, interval, robot)[0][0] for robot in (None, driven))
    _, v, a = states(c[0], np.array([0.4]))
    np.testing.assert_allclose(
        loaded[:, 0] - bare[:, 0], inertia * a[0] + friction * v[0], atol=1e-9
    )
    jerk = np.array([np.polynomial.Polynomial(row).deriv(3)(0.4) for row in c[0]])
    np.testing.assert_allclose(
        loaded[:, 1] - bare[:, 1], inertia * jerk + friction * a[0], atol=1e-9
    )
    assert (loaded[:, 2] >= bare[:, 2]).all()


def test_columns_are_where_they_are_read() -> None:
    assert (MIDDLE, HALF, JET) == (1, 2, 4)
