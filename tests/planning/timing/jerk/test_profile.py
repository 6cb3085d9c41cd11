"""Phases of constant jerk between known states, by integrating them; ratios by numpy."""

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from kinematics.arrays import Array, Indices
from planning.timing.jerk.jerk_limited import phases_kernel, ratios_kernel
from planning.timing.path.blend import blend, largest_reaches
from planning.timing.path.path import JointPath, compose_pieces_kernel


def states(seed: int, count: int = 9) -> Array:
    """Places, speeds and accelerations that cells of some length can join."""
    rng = np.random.default_rng(seed)
    places = np.concatenate([[0.0], np.cumsum(rng.uniform(0.05, 0.3, count - 1))])
    speeds = rng.uniform(0.3, 1.5, count)
    return np.column_stack([places, speeds, rng.uniform(-0.5, 0.5, count)])


def join(rows: Array) -> Array:
    phases = np.full((2 * (len(rows) - 1), 5), np.nan)
    assert phases_kernel(rows, phases)
    return phases


def after(phase: Array) -> Array:
    """Place, speed and acceleration at the end of a phase."""
    s = Polynomial(phase[:4])
    return np.array([s.deriv(k)(phase[4]) if k else s(phase[4]) for k in range(3)])


@pytest.mark.parametrize("seed", range(6))
def test_two_phases_of_equal_length_lead_from_each_state_to_the_next(seed: int) -> None:
    rows = states(seed)
    phases = join(rows)
    for i in range(len(rows) - 1):
        first, second = phases[2 * i], phases[2 * i + 1]
        assert first[4] == second[4] > 0.0
        np.testing.assert_allclose([first[0], first[1], 2.0 * first[2]], rows[i], atol=1e-14)
        middle = [second[0], second[1], 2.0 * second[2]]
        np.testing.assert_allclose(after(first), middle, atol=1e-12)
        np.testing.assert_allclose(after(second), rows[i + 1], atol=1e-10)


def test_at_constant_speed_the_phases_have_neither_acceleration_nor_jerk() -> None:
    phases = join(np.array([[0.0, 2.0, 0.0], [1.0, 2.0, 0.0]]))
    np.testing.assert_allclose(phases[:, 4], 0.25)
    np.testing.assert_allclose(phases[:, 2:4], 0.0, atol=1e-15)


@pytest.mark.parametrize(
    "rows",
    [
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]],
        [[0.0, 0.1, -50.0], [1.0, 0.1, 50.0]],
        [[0.0, 1.0, 0.0], [0.0, 1.0, 0.0]],
        [[0.0, 1.0, np.nan], [1.0, 1.0, 0.0]],
    ],
    ids=["standing", "square below none", "no way", "not a number"],
)
def test_states_that_no_phases_join_are_refused(rows: list[list[float]]) -> None:
    assert not phases_kernel(np.array(rows), np.empty((2, 5)))


def curve() -> JointPath:
    waypoints = np.random.default_rng(3).uniform(-1.0, 1.0, (4, 3))
    return blend(waypoints, 0.8 * largest_reaches(waypoints), smooth=True)


def on(path: JointPath) -> tuple[Array, Indices]:
    """Phases along a whole path, four cells a piece, and the pieces they are on."""
    shares = np.arange(4) / 4.0
    starts = path.breaks[:-1, None] + path.lengths[:, None] * shares
    places = np.append(starts.ravel(), path.breaks[-1])
    rng = np.random.default_rng(4)
    speeds, rates = rng.uniform(0.8, 1.2, len(places)), rng.uniform(-0.1, 0.1, len(places))
    return join(np.column_stack([places, speeds, rates])), np.repeat(np.arange(len(starts)), 4)


def composed(path: JointPath, phases: Array, pieces: Indices) -> Array:
    """The joints as polynomials of time, one a phase."""
    local, owners = phases.copy(), np.repeat(pieces, 2)
    local[:, 0] -= path.breaks[owners]
    degree = path.coefficients.shape[2] - 1
    out = np.zeros((len(phases), path.n, 3 * degree + 1))
    work = np.empty((2, 3 * degree + 1))
    compose_pieces_kernel(path.coefficients, owners, local, 3, work, out)
    return out


def test_the_joints_follow_the_path_exactly() -> None:
    path = curve()
    phases, pieces = on(path)
    out = composed(path, phases, pieces)
    for phase, c in zip(phases, out, strict=True):
        t = np.linspace(0.0, phase[4], 7)
        places = np.clip(Polynomial(phase[:4])(t), 0.0, path.length)
        np.testing.assert_allclose(
            np.polynomial.polynomial.polyval(t, c.T).T, path.sample(places), atol=1e-9
        )


def test_ratios_are_the_largest_at_the_ends_of_the_phases() -> None:
    path = curve()
    phases, pieces = on(path)
    limits = np.random.default_rng(5).uniform(0.5, 5.0, (3, 3))
    ratios = np.empty((3, len(pieces)))
    ratios_kernel(path.coefficients, pieces, path.breaks, phases, limits, ratios)
    out = composed(path, phases, pieces)
    for i in range(len(pieces)):
        for order in (1, 2, 3):
            worst = 0.0
            for k in (2 * i, 2 * i + 1):
                for joint in range(3):
                    rate = Polynomial(out[k, joint]).deriv(order)
                    peak = max(abs(rate(0.0)), abs(rate(phases[k, 4])))
                    worst = max(worst, peak / limits[order - 1, joint])
            assert ratios[order - 1, i] == pytest.approx(worst, rel=1e-6)
