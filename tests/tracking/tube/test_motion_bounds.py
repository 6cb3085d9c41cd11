"""Every instant of a motion is within its bounds, and the bounds are tight."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import BPoly, CubicHermiteSpline

from dynamics.model.body import scale_masses
from tests.dynamics.samples import planar_rr
from tests.tracking.samples import constant, slider
from tracking.controllers.computed_torque import ComputedTorque
from tracking.controllers.independent_joint import IndependentJoint
from tracking.simulation.references import sine
from tracking.simulation.simulation import SimulationOptions, simulate
from tracking.tube.motion_bounds import (
    SHARES,
    Quantity,
    bound_step,
    empty_bounds,
    hermite_polynomials,
    raise_peaks,
)


@pytest.mark.parametrize("period", [0.37, 1.0])
@pytest.mark.parametrize("tolerance", [1e-3, 1e-4, 1e-8])
@pytest.mark.parametrize("has_tube", [True, False])
def test_the_largest_error_between_samples_is_not_missed(
    period: float, tolerance: float, has_tube: bool
) -> None:
    """An oscillator of 1 rad/s and damping 0.1: the overshoot has a closed form."""
    w, zeta = 6.0, 0.1
    chain = slider(1.0)
    controller = IndependentJoint(chain, np.array([w**2]), np.array([2 * zeta * w]), np.ones(1))
    options = SimulationOptions(
        saturate=False,
        sample_period=period,
        relative_tolerance=tolerance,
        absolute_tolerance=tolerance * 1e-2,
        tube=has_tube,
    )
    result = simulate(
        controller,
        constant(chain, np.zeros(1), 2.0),
        options,
        initial_position=[0.0],
        initial_velocity=[1.0],
    )
    wd = w * np.sqrt(1.0 - zeta**2)
    t = np.arctan2(wd, zeta * w) / wd
    peak = np.exp(-zeta * w * t) * np.sin(wd * t) / wd
    assert np.abs(result.tracking_error).max() < 0.95 * peak
    if has_tube:
        bound = result.max_tracking_error[0] + result.bounds.global_error[0, 0]
        assert peak <= bound
    # What the integrator is off adds up over the steps.
    assert result.max_tracking_error[0] == pytest.approx(peak, rel=max(1e-5, 10.0 * tolerance))


def test_velocities_and_positions_are_bounded_in_every_cell() -> None:
    chain = slider(2.0, friction=1.0)
    controller = IndependentJoint(chain, np.array([50.0]), np.array([4.0]), np.ones(1))
    path = constant(chain, np.array([0.3]), 1.0)
    options = SimulationOptions(saturate=False, control_period=5e-3, tube=True)
    result = simulate(controller, path, options, initial_position=[0.0])
    fine = simulate(
        controller,
        path,
        SimulationOptions(saturate=False, control_period=5e-3, sample_period=7e-4),
        initial_position=[0.0],
    )
    bounds = result.bounds
    assert bounds.visited_cells().tolist() == list(range(len(bounds.lower)))
    cells = np.minimum((fine.times / bounds.cell).astype(int), len(bounds.lower) - 1)
    for quantity, values in (
        (Quantity.ERROR, fine.tracking_error),
        (Quantity.POSITION, fine.position),
        (Quantity.VELOCITY, fine.velocity),
    ):
        assert (bounds.lower[cells, quantity] <= values + 1e-7).all()
        assert (bounds.upper[cells, quantity] >= values - 1e-7).all()
        width = bounds.upper[:, quantity] - bounds.lower[:, quantity]
        assert width.max() < 0.05
    np.testing.assert_allclose(bounds.peak_torque, np.abs(fine.torque).max(axis=0), rtol=1e-6)


def test_bounds_hold_over_implicit_steps() -> None:
    mass, b, Kp = 1e-3, 1e2, 50.0
    chain = slider(mass, b)
    controller = IndependentJoint(chain, np.array([Kp]), np.array([1.0]), np.array([mass]))
    path = constant(chain, np.zeros(1), 2.0)
    options = SimulationOptions(saturate=False, tube=True)
    result = simulate(controller, path, options, initial_position=[1.0])
    assert result.implicit_steps > 0
    exact = solve_ivp(
        lambda _, x: [x[1], (-Kp * x[0] - (b + 1.0) * x[1]) / mass],
        (0.0, 2.0),
        [1.0, 0.0],
        method="Radau",
        rtol=1e-10,
        atol=1e-12,
        t_eval=np.linspace(0.0, 2.0, 777),
    )
    cells = np.minimum((exact.t / result.bounds.cell).astype(int), len(result.bounds.lower) - 1)
    low, high = result.bounds.lower[cells], result.bounds.upper[cells]
    slack = 1e-6 + result.bounds.global_error[0]
    for quantity, row, sign in ((Quantity.POSITION, 0, 1.0), (Quantity.ERROR, 0, -1.0)):
        value = sign * exact.y[row]
        assert (low[:, quantity, 0] <= value + slack).all()
        assert (high[:, quantity, 0] >= value - slack).all()
        assert (high[:, quantity] - low[:, quantity]).max() < 0.01


def test_a_polynomial_is_bounded_in_the_cells_it_passes_and_in_no_other() -> None:
    bounds = empty_bounds(1.0, 1)
    rng = np.random.default_rng(3)
    motion, reference = rng.normal(size=(2, 8)), rng.normal(size=(1, 5))
    t, h, start = 0.2, 0.31, 0.1
    bound_step(bounds, reference, start, motion, t, h)
    first, last = bounds.visited_cells()[[0, -1]]
    assert (first, last) == (int(t / bounds.cell), int((t + h) / bounds.cell))
    times = np.linspace(t, t + h, 5000)
    u = (times - t) / h
    position, velocity = (np.polynomial.polynomial.polyval(u, row) for row in motion)
    error = np.polynomial.polynomial.polyval(times - start, reference[0]) - position
    cells = np.clip((times / bounds.cell).astype(int), first, last)
    for quantity, value in (
        (Quantity.ERROR, error),
        (Quantity.POSITION, position),
        (Quantity.VELOCITY, velocity),
    ):
        low, high = bounds.lower[cells, quantity, 0], bounds.upper[cells, quantity, 0]
        assert (low <= value + 1e-12).all()
        assert (value <= high + 1e-12).all()
        # Bounds are as wide as the polynomial changes in a cell, and little more.
        change = np.abs(np.diff(value)).max() * 5000 * bounds.cell / h
        assert (high - low).max() < 1.2 * change


def test_long_and_short_motions_have_a_bounded_number_of_cells() -> None:
    assert len(empty_bounds(0.01, 2).lower) == 1000
    assert len(empty_bounds(5.0, 2).lower) == 5000
    assert len(empty_bounds(1e5, 2).lower) == 20_000
    assert (empty_bounds(1.0, 2).max_error == 0.0).all()


def test_peaks_without_cells_are_those_with_cells() -> None:
    chain = planar_rr()
    wrong = scale_masses(chain, 1.2)
    controller = ComputedTorque(wrong, np.array(100.0), np.array(12.0))
    path = sine(chain, [0.1, 0.2], 0.4, [0.5, 1.3], 0.2, 2.0)
    for period in (None, 2e-3):
        options = SimulationOptions(saturate=False, control_period=period, sample_period=0.5)
        whole = simulate(controller, path, options, robot=chain)
        cells = simulate(controller, path, replace(options, tube=True), robot=chain)
        assert not whole.bounds.has_cells
        np.testing.assert_allclose(whole.max_tracking_error, cells.max_tracking_error, rtol=1e-4)
        for quantity in Quantity:
            low = cells.bounds.lower[cells.bounds.visited_cells(), quantity].min(axis=0)
            high = cells.bounds.upper[cells.bounds.visited_cells(), quantity].max(axis=0)
            one = whole.bounds.lower[0, quantity], whole.bounds.upper[0, quantity]
            np.testing.assert_allclose(one, (low, high), rtol=2e-3, atol=1e-5)


def test_hermite_polynomials_are_those_of_scipy() -> None:
    rng = np.random.default_rng(2)
    x, end, before, after = rng.normal(size=(4, 4))
    before[:2], after[:2] = x[2:], end[2:]
    out = np.zeros((4, 8))
    h = 0.3
    hermite_polynomials(before, after, h, x, end, out)
    u = np.linspace(0.0, 1.0, 9)
    for i in range(2):
        ends = [[x[i], x[2 + i], before[2 + i]], [end[i], end[2 + i], after[2 + i]]]
        quintic = BPoly.from_derivatives([0.0, h], ends)
        cubic = CubicHermiteSpline([0.0, h], [x[2 + i], end[2 + i]], [before[2 + i], after[2 + i]])
        np.testing.assert_allclose(np.polynomial.polynomial.polyval(u, out[i]), quintic(u * h))
        np.testing.assert_allclose(np.polynomial.polynomial.polyval(u, out[2 + i]), cubic(u * h))


def test_torques_are_bounded_between_the_points_of_a_step() -> None:
    # Degree five through seven points: the bound holds, and is not twice what is reached.
    rng = np.random.default_rng(4)
    u = np.linspace(0.0, 1.0, 400)
    for _ in range(50):
        c = rng.normal(size=(6, 1))
        peaks = np.zeros(1)
        torques = np.array(np.polynomial.polynomial.polyval(SHARES, c).T, dtype=np.float64)
        raise_peaks(torques, np.array([np.inf]), peaks)
        true = np.abs(np.polynomial.polynomial.polyval(u, c[:, 0])).max()
        assert true <= peaks[0] <= 2.5 * true
    raise_peaks(torques, np.array([0.1]), peaks)
    cut = np.zeros(1)
    raise_peaks(torques, np.array([0.1]), cut)
    assert cut[0] == 0.1
