"""Adaptive control of chosen parameters: the lecture's three or four, and those that are known."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics.model.body import scale_masses
from kinematics.errors import InvalidOption
from tests.dynamics.samples import cart_pendulum, planar_rr
from tracking.controllers.adaptive import Adaptive
from tracking.controllers.control_law import control_kernel, space
from tracking.controllers.controller import Reference
from tracking.simulation.references import sine
from tracking.simulation.simulation import SimulationOptions, simulate

ARM = planar_rr()
ONE = np.array(1.0)
OPTIONS = SimulationOptions(
    saturate=False, relative_tolerance=1e-11, absolute_tolerance=1e-12, sample_period=0.01
)


def chosen(*names: str, Gamma: float = 3.0) -> Adaptive:
    return Adaptive(
        ARM, np.array(5.0), np.array(8.0), np.array(Gamma), known_zeros=True, learned=names
    )


def test_the_lecture_s_models_have_four_and_three_parameters() -> None:
    assert Adaptive(ARM, ONE, ONE, ONE, known_zeros=True).parameters.count == 4
    cart = replace(cart_pendulum(), viscous_friction=np.zeros(2))
    assert Adaptive(cart, ONE, ONE, ONE, known_zeros=True, motors=False).parameters.count == 3


def test_only_what_is_chosen_is_learned_and_its_v_falls() -> None:
    controller = chosen("mx2", "Izz2")
    assert [name.split()[0] for name in controller.parameters.names] == ["mx2", "Izz2"]
    start = replace(controller, estimate=1.5 * controller.estimate)
    motion = sine(ARM, [0.3, -0.2], 0.4, [0.6, 0.9], 0.0, 3.0)
    result = simulate(start, motion, OPTIONS)
    assert result.estimate.shape[1] == 2
    e = result.tracking_error
    e_dot = result.reference_velocity - result.velocity
    # The proof of lecture 34 holds, as what is not learned is exact.
    expected = -8.0 * (e_dot**2 + 25.0 * e**2).sum(axis=1)
    np.testing.assert_allclose(result.lyapunov_rate, expected, atol=1e-7)
    assert (np.diff(result.lyapunov) < 1e-9).all()
    assert np.abs(e[-50:]).max() < 0.3 * np.abs(e).max()


def test_compiled_and_python_agree_on_chosen_parameters() -> None:
    controller = chosen("mx2")
    heavy = scale_masses(ARM, 1.3)
    law = controller.compiled_law(heavy)
    rng = np.random.default_rng(0)
    for _ in range(5):
        state, reference = rng.uniform(-1.0, 1.0, (2, 2)), rng.uniform(-1.0, 1.0, (3, 2))
        u, rate = np.zeros(2), np.zeros(1)
        control_kernel(law, space(2, law), state, reference, np.array([0.2]), u, rate)
        q, qd = state
        at = Reference(*reference)
        expected = controller.with_estimate(np.array([0.2]))
        np.testing.assert_allclose(u, expected.torque(0.0, q, qd, at), rtol=1e-11)
        np.testing.assert_allclose(rate, expected.adaptation(0.0, q, qd, at), rtol=1e-11)
    # With all parameters at the model's it is the controller that learns them all.
    whole = Adaptive(ARM, np.array(5.0), np.array(8.0), ONE)
    np.testing.assert_allclose(
        controller.torque(0.0, q, qd, at), whole.torque(0.0, q, qd, at), rtol=1e-9
    )


def test_unknown_and_missing_names_are_refused() -> None:
    with pytest.raises(InvalidOption, match="'mx7' is unknown"):
        chosen("mx7")
    with pytest.raises(InvalidOption, match="no base parameter is learned"):
        Adaptive(ARM, ONE, ONE, ONE, learned=())
