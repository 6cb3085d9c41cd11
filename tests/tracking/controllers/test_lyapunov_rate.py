"""The rate of each Lyapunov function: against differences of V, the proofs, and Python."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dynamics.model.body import scale_masses
from kinematics.arrays import Array
from kinematics.model.chain import Chain
from tests.dynamics.samples import random_chain
from tests.tracking.samples import constant, smooth
from tracking.controllers.control_law import Kind
from tracking.controllers.controller import Controller, Reference
from tracking.controllers.model_based import (
    Adaptive,
    ComputedTorque,
    IndependentJoint,
    Passivity,
    PdGravity,
)
from tracking.simulation import callback
from tracking.simulation.result import SimulationResult
from tracking.simulation.setup import prepare
from tracking.simulation.simulation import Disturbance, SimulationOptions, simulate

ARM = random_chain(11, 3, motors=True)
N, B = ARM.n, ARM.viscous_friction
LAMBDA, K, KP, KD = np.array(4.0), np.array(6.0), np.array(30.0), np.array(9.0)
TIGHT = SimulationOptions(
    saturate=False, relative_tolerance=1e-12, absolute_tolerance=1e-13, sample_period=1e-3
)
START, END = np.zeros(N), np.array([0.5, -0.4, 0.3])
#: Fourth-order weights of a difference over five samples.
WEIGHTS = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0
kinds = pytest.mark.parametrize("kind", Kind)


def controller(kind: Kind, model: Chain = ARM) -> Any:
    if kind is Kind.INDEPENDENT_JOINT:
        return IndependentJoint(model, KP, KD)
    if kind is Kind.COMPUTED_TORQUE:
        return ComputedTorque(model, KP, KD)
    if kind is Kind.PD_GRAVITY:
        return PdGravity(model, KP, KD)
    if kind is Kind.PASSIVITY:
        return Passivity(model, LAMBDA, K)
    return Adaptive(model, LAMBDA, K, np.array(2.0))


#: A K that does not commute with Lambda: no proof covers the controllers that have it.
RATES, COUPLED = np.array([2.0, 5.0, 3.0]), np.diag([6.0, 5.0, 7.0]) + 2.0
coupled = pytest.mark.parametrize(
    "used",
    [Passivity(ARM, RATES, COUPLED), Adaptive(ARM, RATES, COUPLED, np.array(2.0))],
    ids=["passivity", "adaptive"],
)


def run(used: Controller, motion: Any, **options: Any) -> SimulationResult:
    offset = motion.start + np.array([0.2, -0.1, 0.15])
    return simulate(used, motion, TIGHT, robot=ARM, initial_position=offset, **options)


@kinds
@pytest.mark.parametrize("is_disturbed", [False, True])
def test_the_rate_is_the_slope_of_the_function(kind: Kind, is_disturbed: bool) -> None:
    # A moving reference, a wrong model and a disturbance: no proof applies, the rate does.
    used = controller(kind, scale_masses(ARM, 1.3) if is_disturbed else ARM)
    push = Disturbance([1.0, -2.0, 0.5], 0.7, 1.5) if is_disturbed else None
    found = run(used, smooth(ARM, START, END, 0.4), disturbance=push)
    slope = np.convolve(found.lyapunov, WEIGHTS[::-1], "valid") / TIGHT.sample_period
    size = np.abs(found.lyapunov_rate).max()
    assert size > 0.1
    np.testing.assert_allclose(found.lyapunov_rate[2:-2], slope, rtol=0.0, atol=1e-6 * size)


def test_where_the_assumptions_hold_the_rates_are_those_of_the_proofs() -> None:
    motion = smooth(ARM, START, END, 0.4)
    for kind in (Kind.COMPUTED_TORQUE, Kind.PASSIVITY, Kind.ADAPTIVE):
        found = run(controller(kind), motion)
        e, e_dot = found.tracking_error, found.reference_velocity - found.velocity
        expected = {
            Kind.COMPUTED_TORQUE: -0.5 * float(KD) * (e_dot**2 + float(KP) * e**2).sum(axis=1),
            Kind.PASSIVITY: -float(K) * (e_dot**2 + float(LAMBDA) ** 2 * e**2).sum(axis=1),
        }
        expected[Kind.ADAPTIVE] = expected[Kind.PASSIVITY]
        np.testing.assert_allclose(found.lyapunov_rate, expected[kind], atol=1e-8)
    still = run(controller(Kind.PD_GRAVITY), constant(ARM, END, 0.5))
    energy = -((B + float(KD)) * still.velocity**2).sum(axis=1)
    np.testing.assert_allclose(still.lyapunov_rate, energy, atol=1e-8)


@coupled
def test_gains_that_do_not_commute_leave_a_term_without_sign(used: Any) -> None:
    found = run(used, smooth(ARM, START, END, 0.4))
    e, e_dot = found.tracking_error, found.reference_velocity - found.velocity
    proved = np.einsum("ti,ij,tj->t", e_dot, COUPLED, e_dot)
    proved += np.einsum("ti,ij,tj->t", RATES * e, COUPLED, RATES * e)
    odd = COUPLED * RATES - (COUPLED * RATES).T
    expected = np.einsum("ti,ij,tj->t", e, odd, e_dot) - proved
    np.testing.assert_allclose(found.lyapunov_rate, expected, atol=1e-8)
    assert np.abs(expected + proved).max() > 0.01 * np.abs(expected).max()
    slope = np.convolve(found.lyapunov, WEIGHTS[::-1], "valid") / TIGHT.sample_period
    size = np.abs(found.lyapunov_rate).max()
    np.testing.assert_allclose(found.lyapunov_rate[2:-2], slope, rtol=0.0, atol=1e-6 * size)
    motion, few = smooth(ARM, START, END, 0.2), replace(TIGHT, sample_period=0.05)
    slow = callback.run(prepare(used, motion, few, ARM, (START + 0.1, None), None, None))
    fast = simulate(used, motion, few, robot=ARM, initial_position=START + 0.1)
    for name in ("position", "velocity", "torque", "estimate", "lyapunov", "lyapunov_rate"):
        np.testing.assert_allclose(getattr(fast, name), getattr(slow, name), atol=1e-8)


def test_dry_friction_adds_to_the_fall() -> None:
    rough = replace(ARM, coulomb_friction=np.array([0.5, 0.2, 0.1]))
    motion = constant(ARM, END, 0.5)
    found = simulate(PdGravity(rough, KP, KD), motion, TIGHT, initial_position=END + 0.2)
    dry = rough.coulomb_friction * np.tanh(found.velocity / 0.01)
    expected = -((B + float(KD)) * found.velocity**2 + dry * found.velocity).sum(axis=1)
    np.testing.assert_allclose(found.lyapunov_rate, expected, atol=1e-7)


def test_a_controller_without_a_rate_has_none() -> None:
    class Idle(Controller):
        chain = ARM

        def torque(self, _t: float, _q: Array, _qd: Array, _reference: Reference, /) -> Array:
            return np.zeros(N)

        def lyapunov(
            self, q: Array, qd: Array, reference: Reference, robot: Chain | None = None
        ) -> float:
            return 0.0

    found = simulate(Idle(), constant(ARM, START, 0.01), TIGHT)
    assert np.isnan(found.lyapunov_rate).all()
