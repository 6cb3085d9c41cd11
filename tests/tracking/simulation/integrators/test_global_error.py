"""The integrator's error stays within its bound, in stable loops and in unstable ones."""

from dataclasses import replace

import mpmath
import numpy as np
import pytest
from scipy.linalg import expm

from dynamics.model.body import scale_masses
from kinematics.arrays import Array
from kinematics.model.chain import Chain, Inertia, Link
from kinematics.trajectory.trajectory import Trajectory
from tests.dynamics.samples import REVOLUTE, planar_rr, textbook
from tests.tracking.samples import constant, slider
from tracking.controllers.controller import Controller
from tracking.controllers.model_based import (
    Adaptive,
    ComputedTorque,
    IndependentJoint,
    PdGravity,
)
from tracking.simulation.compiled import _loop, empty_record
from tracking.simulation.integrators.explicit import ALL_STAGES, POWERS, Steps
from tracking.simulation.integrators.global_error import (
    LOST,
)
from tracking.simulation.integrators.implicit import stages
from tracking.simulation.integrators.integrate import run_kernel
from tracking.simulation.integrators.record import scratch
from tracking.simulation.references import sine
from tracking.simulation.setup import prepare
from tracking.simulation.simulation import SimulationOptions, simulate

MASS, LENGTH, G = 1.0, 1.0, 9.81
OPTIONS = SimulationOptions(
    saturate=False, tube=True, relative_tolerance=1e-6, absolute_tolerance=1e-8, sample_period=0.05
)


def pendulum() -> Chain:
    """A point mass on a rod, upright at 0."""
    body = Link("bob", 0, np.eye(4), Inertia(MASS, np.array([LENGTH, 0.0, 0.0]), np.zeros((3, 3))))
    return textbook("pendulum", [REVOLUTE], np.eye(4)[None], [body], [-G, 0.0, 0.0])


def exact_pendulum(kp: float, kd: float, start: float, times: Array) -> Array:
    """m l^2 q'' = m g l sin q - kp q - kd q' in thirty digits."""
    mpmath.mp.dps = 30

    def rate(_t: mpmath.mpf, x: list[mpmath.mpf]) -> list[mpmath.mpf]:
        push = MASS * G * LENGTH * mpmath.sin(x[0]) - kp * x[0] - kd * x[1]
        return [x[1], push / (MASS * LENGTH**2)]

    solution = mpmath.odefun(rate, 0, [mpmath.mpf(start), mpmath.mpf(0)])
    return np.array([float(solution(float(t))[0]) for t in times])


@pytest.mark.parametrize(
    ("kp", "kd", "is_stable"), [(60.0, 6.0, True), (5.0, 0.5, False), (9.0, 0.1, False)]
)
def test_a_pendulum_stays_within_its_error(kp: float, kd: float, is_stable: bool) -> None:
    chain, start = pendulum(), 1e-3
    used = IndependentJoint(chain, np.array([kp]), np.array([kd]), np.zeros(1))
    result = simulate(used, constant(chain, np.zeros(1), 3.0), OPTIONS, initial_position=[start])
    exact = exact_pendulum(kp, kd, start, result.times[::10])
    off = np.abs(result.position[::10, 0] - exact).max()
    bound = result.bounds.global_error[0, 0]
    assert off <= bound
    # Local errors alone, summed up, are not enough where they grow; a stable loop forgets them.
    assert bound < (1e-5 if is_stable else 1e-3)


@pytest.mark.parametrize("h", [0.02, 0.45])
def test_a_held_loop_stays_within_its_error(h: float) -> None:
    mass, b, Kp, Kd = 2.0, 0.5, 60.0, 10.0
    chain = slider(mass, b)
    options = replace(OPTIONS, control_period=h, sample_period=h)
    used = PdGravity(chain, np.array(Kp), np.array(Kd))
    result = simulate(used, constant(chain, np.zeros(1), 3.6), options, initial_position=[1e-4])
    block = expm(h * np.array([[0.0, 1.0, 0.0], [0.0, -b / mass, 1.0 / mass], [0.0, 0.0, 0.0]]))
    step = block[:2, :2] - block[:2, 2:] @ np.array([[Kp, Kd]])
    # With a period of 0.45 s the loop is unstable.
    growth = np.abs(np.linalg.eigvals(step)).max()
    assert (growth > 1.0) == (h > 0.1)
    x, off = np.array([1e-4, 0.0]), 0.0
    for position in result.position[:, 0]:
        off = max(off, abs(float(position) - float(x[0])))
        x = step @ x
    assert off <= result.bounds.global_error[0, 0]


def carried(
    used: Controller, motion: Trajectory, options: SimulationOptions, first: Array
) -> Array:
    """Bounds of a run at rest that begins with an error within an ellipsoid ``first`` (2, 2)."""
    chain = used.chain
    setup = prepare(used, motion, options, chain, (None, None), None, None)
    law = used.compiled_law(chain)
    assert law is not None
    tolerances = np.array([1e-13, 1e-13])
    work = scratch(setup.start, 1, tolerances, has_tube=True)
    work.errors.P[:] = first
    record = empty_record(setup.times, 1, 2, has_tube=True)
    steps = Steps(np.zeros((ALL_STAGES, 2)), np.zeros((POWERS, 2)), np.zeros(2))
    x = setup.start.copy()
    run_kernel(_loop(setup, law), setup.events, steps, stages(2), record, work, 1_000_000, x)
    return record.bounds.global_error[:, 0]


FIRST = 1e-8 * np.array([[2.0, 0.5], [0.5, 1.0]])


def test_errors_are_carried_by_the_transition_matrix_of_an_unstable_loop() -> None:
    kp, kd, duration = 5.0, 0.5, 1.5
    used = IndependentJoint(pendulum(), np.array([kp]), np.array([kd]), np.zeros(1))
    found = carried(used, constant(pendulum(), np.zeros(1), duration), OPTIONS, FIRST)
    inertia = MASS * LENGTH**2
    A = np.array([[0.0, 1.0], [(MASS * G * LENGTH - kp) / inertia, -kd / inertia]])
    Phi = expm(A * duration)
    np.testing.assert_allclose(found, 2.0 * np.sqrt(np.diag(Phi @ FIRST @ Phi.T)), rtol=1e-2)


def test_errors_of_a_held_loop_are_fed_back_at_its_calls() -> None:
    mass, b, Kp, Kd, h, calls = 2.0, 0.5, 60.0, 10.0, 0.45, 5
    chain = slider(mass, b)
    used = PdGravity(chain, np.array(Kp), np.array(Kd))
    options = replace(OPTIONS, control_period=h)
    found = carried(used, constant(chain, np.zeros(1), calls * h), options, FIRST)
    block = expm(h * np.array([[0.0, 1.0, 0.0], [0.0, -b / mass, 1.0 / mass], [0.0, 0.0, 0.0]]))
    step = block[:2, :2] - block[:2, 2:] @ np.array([[Kp, Kd]])
    Phi = np.linalg.matrix_power(step, calls)
    np.testing.assert_allclose(found, 2.0 * np.sqrt(np.diag(Phi @ FIRST @ Phi.T)), rtol=1e-2)


def test_arms_stay_within_their_error() -> None:
    chain = planar_rr()
    motion = sine(chain, [0.3, -0.2], 0.5, [0.7, 1.1], 0.0, 2.0)
    tight = replace(OPTIONS, relative_tolerance=1e-13, absolute_tolerance=1e-13)
    wrong = scale_masses(chain, 1.3)
    for used in (
        ComputedTorque(wrong, np.array(100.0), np.array(20.0)),
        Adaptive(wrong, np.array(8.0), np.array(6.0), np.array(1.0)),
    ):
        for period in (None, 2e-3):
            rough, exact = (
                simulate(
                    used, motion, replace(options, control_period=period), robot=chain,
                    initial_position=motion.start + 0.1,
                )
                for options in (OPTIONS, tight)
            )  # fmt: skip
            off = np.abs(rough.position - exact.position).max(axis=0)
            assert (off <= rough.bounds.global_error[0]).all()
            speed = np.abs(rough.velocity - exact.velocity).max(axis=0)
            assert (speed <= rough.bounds.global_error[1]).all()
            assert rough.bounds.global_error[0].max() < 1e-3


def test_an_error_that_explodes_is_lost_not_infinite() -> None:
    chain = pendulum()
    used = IndependentJoint(chain, np.array([1e-3]), np.array([1e-3]), np.zeros(1))
    options = replace(OPTIONS, relative_tolerance=1e-3, absolute_tolerance=1e-3)
    result = simulate(used, constant(chain, np.zeros(1), 20.0), options, initial_position=[1e-3])
    assert result.bounds.global_error.max() == LOST
