"""Motions from state to state: their ends, their limits and their duration, against the package."""

import numpy as np
import pytest
from ruckig import InputParameter, Ruckig
from ruckig import Trajectory as Phases

from kinematics.errors import InvalidOption, InvalidTrajectory
from planning.timing.jerk.state_to_state import JointState, state_to_state
from planning.timing.options import TimingFailed

LIMITS = np.array([[800.0], [2000.0], [20000.0]])
REST = JointState(np.zeros(1))


def random_states(
    rng: np.random.Generator, n: int, limits: np.ndarray
) -> tuple[JointState, JointState]:
    """Two states that keep the limits, some of their joints at rest."""
    states = []
    for _ in range(2):
        speeds = rng.uniform(-0.6, 0.6, n) * limits[0] * (rng.random(n) < 0.7)
        spare = np.sqrt(0.7 * limits[0] * limits[2])
        pushes = rng.uniform(-1.0, 1.0, n) * np.minimum(limits[1], spare) * (rng.random(n) < 0.7)
        states.append(JointState(rng.uniform(-2.0, 2.0, n), speeds, pushes))
    return states[0], states[1]


def package_duration(start: JointState, end: JointState, limits: np.ndarray) -> float:
    """The package's own answer, asked without any change of units."""
    wanted = InputParameter(len(start.position))
    wanted.current_position, wanted.current_velocity, wanted.current_acceleration = start.rows
    wanted.target_position, wanted.target_velocity, wanted.target_acceleration = end.rows
    wanted.max_velocity, wanted.max_acceleration, wanted.max_jerk = limits
    motion = Phases(len(start.position))
    Ruckig(len(start.position)).calculate(wanted, motion)
    return float(motion.duration)


@pytest.mark.parametrize("synchronization", ["phase", "time"])
def test_a_motion_has_both_states_keeps_its_limits_and_takes_the_least_time(
    synchronization: str,
) -> None:
    rng = np.random.default_rng(5)
    for _ in range(60):
        n = int(rng.integers(1, 8))
        limits = np.stack([rng.uniform(0.5, 3, n), rng.uniform(2, 20, n), rng.uniform(20, 500, n)])
        start, end = random_states(rng, n, limits)
        names = [f"j{i}" for i in range(n)]
        motion = state_to_state(names, start, end, limits, synchronization)  # type: ignore[arg-type]
        for order in range(3):
            ends = motion.sample([0.0, motion.duration], order)
            assert ends[0].tolist() == start.rows[order].tolist()
            np.testing.assert_allclose(ends[1], end.rows[order], rtol=0, atol=1e-9)
            assert np.abs(motion.jumps(order)).max(initial=0.0) < 1e-9
        for order in (1, 2, 3):
            assert (motion.peaks(order).value / limits[order - 1]).max() <= 1.0 + 1e-9
        if synchronization == "time":
            least = package_duration(start, end, limits)
            assert motion.duration == pytest.approx(least, rel=1e-7)


@pytest.mark.parametrize("seed", range(60))
def test_joints_that_rest_to_rounding_take_no_time(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 8))
    limits = np.stack([rng.uniform(0.5, 3, n), rng.uniform(2, 20, n), rng.uniform(20, 500, n)])
    start, end = random_states(rng, n, limits)
    still = rng.random(n) < 0.5
    still[0] = False
    tiny = 10.0 ** rng.uniform(-16, -8)

    def rounded(state: JointState, noise: float) -> JointState:
        rows = np.where(still, noise * rng.normal(size=(3, n)), state.rows)
        rows[0] += np.where(still, start.position, 0.0)
        return JointState(*rows)

    begin, target = rounded(start, tiny), rounded(end, tiny * (rng.random() < 0.5))
    motion = state_to_state([f"j{i}" for i in range(n)], begin, target, limits)
    exact = package_duration(rounded(start, 0.0), rounded(end, 0.0), limits)
    assert motion.duration == pytest.approx(exact, rel=1e-4, abs=1e-4)
    for order in range(2):
        ends = motion.sample([0.0, motion.duration], order)
        np.testing.assert_allclose(ends[0], begin.rows[order], rtol=0, atol=1e-10 * limits[0].max())
        np.testing.assert_allclose(ends[1], target.rows[order], rtol=0, atol=1e-9)
    for order in (1, 2, 3):
        assert (motion.peaks(order).value / limits[order - 1]).max() <= 1.0 + 1e-9


def test_phases_that_miss_the_target_are_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    solve = Ruckig.calculate

    def other(self: Ruckig, wanted: InputParameter, motion: Phases) -> object:
        wanted.target_position = [place + 0.1 for place in wanted.target_position]
        return solve(self, wanted, motion)

    monkeypatch.setattr("planning.timing.jerk.state_to_state._STEPS", 0)
    monkeypatch.setattr("planning.timing.jerk.state_to_state.Ruckig.calculate", other)
    with pytest.raises(TimingFailed, match="phases end"):
        state_to_state(["a"], REST, JointState(np.array([1.0])), LIMITS)


def test_a_velocity_beyond_its_limit_is_refused_and_not_lowered() -> None:
    start = JointState(np.zeros(1), np.array([1200.0]))
    with pytest.raises(InvalidOption, match=r"from: the velocity of joint 'j' is 1200, .* 800"):
        state_to_state(["j"], start, JointState(np.array([500.0])), LIMITS)


def test_an_acceleration_that_leads_beyond_the_velocity_limit_is_refused() -> None:
    # At the largest jerk 2000 units/s^2 are taken back in 0.1 s, which adds 100 units/s.
    fast = np.array([701.0])
    with pytest.raises(InvalidOption, match="from: the velocity that the acceleration leads to"):
        state_to_state(["j"], JointState(np.zeros(1), fast, np.array([2000.0])), REST, LIMITS)
    with pytest.raises(InvalidOption, match="to: the velocity that the acceleration leads to"):
        state_to_state(["j"], REST, JointState(np.ones(1), fast, np.array([-2000.0])), LIMITS)
    slow = JointState(np.zeros(1), np.array([699.0]), np.array([2000.0]))
    state_to_state(["j"], slow, JointState(np.ones(1)), LIMITS)


@pytest.mark.parametrize(
    ("start", "end"),
    [
        ((0.0, 700.0, 2000.0), (500.0, 0.0, 0.0)),
        ((0.0, 0.0, 0.0), (500.0, 700.0, -2000.0)),
        ((0.0, 800.0, 0.0), (500.0, 800.0, 0.0)),
        ((0.0, -800.0, 0.0), (500.0, -700.0, 2000.0)),
        ((0.0, -700.0, -2000.0), (500.0, 800.0, 0.0)),
    ],
)
def test_states_at_their_very_limits_are_taken(
    start: tuple[float, ...], end: tuple[float, ...]
) -> None:
    # Taken back at the largest jerk, 2000 units/s^2 add 100 units/s: exactly the limit.
    first, last = (JointState(*(np.array([value]) for value in row)) for row in (start, end))
    motion = state_to_state(["j"], first, last, LIMITS)
    for order in range(3):
        told = motion.sample([0.0, motion.duration], order)[:, 0]
        np.testing.assert_allclose(told, [start[order], end[order]], rtol=0, atol=1e-7)
    for order in (1, 2, 3):
        assert (motion.peaks(order).value / LIMITS[order - 1]).max() <= 1.0 + 1e-9


def test_a_motion_from_rest_to_rest_takes_the_time_of_its_closed_form() -> None:
    # Four phases of the largest jerk: x = 2 j (T/4)^3.
    motion = state_to_state(["j"], REST, JointState(np.ones(1)), [[np.inf], [1e3], [32.0]])
    assert motion.duration == pytest.approx(4.0 * (1.0 / 64.0) ** (1.0 / 3.0), rel=1e-9)


def test_joints_at_rest_move_in_phase_and_one_without_a_way_stands_still() -> None:
    end = JointState(np.array([1.0, 0.0, -0.25]))
    limits = np.array([[1.0] * 3, [4.0] * 3, [40.0] * 3])
    motion = state_to_state("abc", JointState(np.zeros(3)), end, limits)
    q = motion.sample(np.linspace(0.0, motion.duration, 101))
    assert (q[:, 1] == 0.0).all()
    np.testing.assert_allclose(q[:, 2], -0.25 * q[:, 0], atol=1e-12)


def test_equal_states_at_rest_stay_and_moving_ones_come_round_again() -> None:
    assert state_to_state(["j"], REST, REST, LIMITS).pieces == 1
    moving = JointState(np.zeros(1), np.ones(1))
    motion = state_to_state(["j"], moving, moving, LIMITS)
    assert motion.duration > 0.0
    assert motion.extrema(1).minimum[0] < 0.0
    np.testing.assert_allclose(motion.sample([motion.duration], 1), [[1.0]], atol=1e-9)


@pytest.mark.parametrize(
    "limits",
    [[[1.0], [0.0], [1.0]], [[1.0], [np.inf], [1.0]], [[1.0], [1.0]], [[1.0], [1.0], [np.nan]]],
)
def test_limits_that_bind_nothing_are_refused(limits: list[list[float]]) -> None:
    with pytest.raises(InvalidOption, match="positive numbers"):
        state_to_state(["j"], REST, JointState(np.ones(1)), limits)


def test_states_of_other_lengths_are_refused() -> None:
    with pytest.raises(InvalidTrajectory, match="1 position"):
        JointState(np.zeros(1), np.zeros(2))
    with pytest.raises(InvalidTrajectory, match="finite"):
        JointState(np.array([np.nan]))
    with pytest.raises(InvalidTrajectory, match="to has 2 joint"):
        state_to_state(["j"], REST, JointState(np.zeros(2)), LIMITS)


def test_a_failure_of_the_package_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise RuntimeError

    monkeypatch.setattr("planning.timing.jerk.state_to_state.Ruckig", lambda _: fail)
    with pytest.raises(TimingFailed, match="no motion from state to state: AttributeError"):
        state_to_state(["j"], REST, JointState(np.ones(1)), LIMITS)
