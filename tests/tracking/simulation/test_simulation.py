"""The closed loop against closed forms: held torques, saturation, disturbance, wrong models."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import pytest
from scipy.linalg import expm

from dynamics.model.body import scale_masses
from kinematics.arrays import Array
from kinematics.errors import InvalidOption, InvalidRobotState, MissingInertia, MissingLimit
from kinematics.model.chain import Chain
from kinematics.robots import builtin_chain
from kinematics.trajectory.trajectory import Trajectory
from tests.dynamics.samples import planar_rr, random_chain
from tests.tracking.samples import constant, slider, smooth
from tracking.controllers.controller import AdaptiveController, Reference
from tracking.controllers.model_based import ComputedTorque, PdGravity
from tracking.simulation.result import SimulationOutcome
from tracking.simulation.simulation import SimulationOptions, simulate

FREE = SimulationOptions(saturate=False)


def test_held_torque_is_the_exact_sampled_system() -> None:
    mass, b, Kp, Kd, h = 2.0, 0.5, 60.0, 10.0, 0.02
    chain = slider(mass, b)
    result = simulate(
        PdGravity(chain, np.array(Kp), np.array(Kd)),
        constant(chain, np.zeros(1)),
        replace(FREE, control_period=h, sample_period=h),
        initial_position=[1.0],
    )
    # Exact discretisation of x_dot = A x + B u for u held over h.
    block = expm(h * np.array([[0.0, 1.0, 0.0], [0.0, -b / mass, 1.0 / mass], [0.0, 0.0, 0.0]]))
    step = block[:2, :2] - block[:2, 2:] @ np.array([[Kp, Kd]])
    x = np.array([1.0, 0.0])
    for k in range(len(result.times)):
        assert result.times[k] == pytest.approx(k * h)
        assert result.position[k, 0] == pytest.approx(x[0], abs=1e-9)
        assert result.velocity[k, 0] == pytest.approx(x[1], abs=1e-9)
        x = step @ x


def test_held_torque_tends_to_the_continuous_one() -> None:
    chain = planar_rr()
    trajectory = smooth(chain, np.zeros(2), np.ones(2), 0.5)
    controller = ComputedTorque(chain, np.array(100.0), np.array(20.0))
    errors = [
        simulate(controller, trajectory, replace(FREE, control_period=h)).max_tracking_error.max()
        for h in (8e-3, 4e-3, 2e-3)
    ]
    # First order in the period.
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.3)
    assert errors[1] / errors[2] == pytest.approx(2.0, abs=0.3)


def test_torque_is_cut_off_at_the_effort_limit() -> None:
    chain = slider(2.0, effort=3.0)
    result = simulate(
        PdGravity(chain, np.array(1e3), np.array(1.0)),
        constant(chain, np.array([10.0])),
        initial_position=[0.0],
    )
    assert result.saturated.all()
    np.testing.assert_array_equal(result.torque, 3.0)
    # Full force all the time: q = F t^2 / (2 m)
    np.testing.assert_allclose(result.position[:, 0], 0.75 * result.times**2, atol=1e-9)
    assert result.outcome is SimulationOutcome.COMPLETED
    assert not result.settled


def test_a_disturbance_leaves_its_share_of_the_stiffness() -> None:
    chain = slider(2.0)
    result = simulate(
        PdGravity(chain, np.array(100.0), np.array(30.0)),
        constant(chain, np.zeros(1)),
        replace(FREE, duration=20.0, sample_period=0.5),
        disturbance=[5.0],
    )
    assert result.tracking_error[-1, 0] == pytest.approx(-0.05, rel=1e-6)


def test_a_wrong_model_tracks_worse_the_more_it_is_wrong() -> None:
    chain = builtin_chain("panda")
    start = np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.8])
    trajectory = smooth(chain, start, start + 0.5)
    controller = ComputedTorque(chain, np.array(400.0), np.array(40.0))
    errors = [
        simulate(controller, trajectory, FREE, robot=scale_masses(chain, factor))
        .max_tracking_error.max()
        for factor in (1.0, 1.05, 1.3)
    ]  # fmt: skip
    assert errors[0] < 1e-7
    assert 1e-4 < errors[1] < 0.5 * errors[2]


def test_acceleration_jumps_do_not_cost_accuracy() -> None:
    chain = planar_rr()
    # Constant acceleration up, then down: it jumps at the break.
    up = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -2.0]])
    down = np.array([[1.0, 2.0, -1.0], [-2.0, -4.0, 2.0]])
    trajectory = Trajectory(chain.joint_names, np.array([0.0, 1.0, 2.0]), np.array([up, down]))
    controller = ComputedTorque(chain, np.array(100.0), np.array(20.0))
    result = simulate(controller, trajectory, replace(FREE, duration=2.5))
    assert result.max_tracking_error.max() < 1e-7
    assert result.evaluations < 3000
    np.testing.assert_allclose(result.reference_position[-1], [2.0, -4.0])


def test_an_unstable_loop_runs_away() -> None:
    chain = slider(0.01)
    result = simulate(
        PdGravity(chain, np.array(1e4), np.array(100.0)),
        constant(chain, np.zeros(1), 5.0),
        replace(FREE, control_period=0.01),
        initial_position=[0.1],
    )
    assert result.outcome is SimulationOutcome.DIVERGED
    assert "lower the gains" in result.outcome.value
    assert not result.settled
    assert 0 < len(result.times) < 501
    assert np.isfinite(result.position).all()


def test_a_stiff_loop_exhausts_what_it_may_cost() -> None:
    chain = slider(1e-3)
    result = simulate(
        PdGravity(chain, np.array(1e6), np.array(1e5)),
        constant(chain, np.zeros(1), 5.0),
        replace(FREE, max_evaluations=2000),
        initial_position=[0.1],
    )
    assert result.outcome is SimulationOutcome.EXHAUSTED
    assert result.evaluations < 2100
    assert len(result.times) >= 1


def test_samples_do_not_change_the_motion() -> None:
    chain = planar_rr()
    trajectory = smooth(chain, np.zeros(2), np.ones(2))
    controller = PdGravity(chain, np.array(80.0), np.array(9.0))
    coarse = simulate(controller, trajectory, replace(FREE, sample_period=0.1))
    fine = simulate(controller, trajectory, replace(FREE, sample_period=0.0025))
    np.testing.assert_allclose(coarse.times, fine.times[::40], atol=1e-12)
    np.testing.assert_allclose(coarse.position, fine.position[::40], atol=1e-9)
    np.testing.assert_allclose(coarse.torque, fine.torque[::40], atol=1e-6)
    np.testing.assert_allclose(
        fine.max_tracking_error, np.abs(fine.tracking_error).max(axis=0), rtol=1e-3
    )


def test_settling_time_in_closed_form() -> None:
    chain, w, tolerance = slider(1.0), 5.0, 1e-2
    result = simulate(
        ComputedTorque(chain, np.array(w**2), np.array(2 * w)),
        constant(chain, np.zeros(1)),
        replace(FREE, duration=3.0, sample_period=1e-3, settling_tolerance=tolerance),
        initial_position=[1.0],
    )
    error = (1.0 + w * result.times) * np.exp(-w * result.times)
    expected = result.times[np.flatnonzero(error > tolerance)[-1] + 1]
    assert result.settled
    assert result.settling_time == pytest.approx(expected, abs=1e-9)


@dataclass(frozen=True, slots=True, eq=False)
class IntegralAction(AdaptiveController):
    """PD with an estimate of a constant force, adapted by the error."""

    chain: Chain
    estimate: Array

    def with_estimate(self, estimate: Array) -> Self:
        return replace(self, estimate=estimate)

    def torque(self, _t: float, q: Array, qd: Array, reference: Reference, /) -> Array:
        e, e_dot = reference.position - q, reference.velocity - qd
        return np.asarray(40.0 * e + 12.0 * e_dot + self.estimate)

    def adaptation(self, _t: float, q: Array, qd: Array, reference: Reference, /) -> Array:
        return np.asarray(30.0 * (reference.position - q))

    def lyapunov(
        self, q: Array, qd: Array, reference: Reference, robot: Chain | None = None
    ) -> float:
        return float(np.sum((reference.position - q) ** 2))


@pytest.mark.parametrize("period", [None, 1e-2])
def test_an_estimate_is_integrated_with_the_robot(period: float | None) -> None:
    chain = slider(1.0)
    result = simulate(
        IntegralAction(chain, np.zeros(1)),
        constant(chain, np.zeros(1)),
        replace(FREE, duration=10.0, sample_period=0.1, control_period=period),
        disturbance=[-3.0],
    )
    assert result.estimate.shape == (101, 1)
    assert result.estimate[-1, 0] == pytest.approx(3.0, abs=1e-3)
    assert result.settled
    if period is None:
        A = np.array([[0.0, 1.0, 0.0], [-40.0, -12.0, 1.0], [-30.0, 0.0, 0.0]])
        x = np.array([0.0, 0.0, -3.0])
        expected = np.array([expm(A * t) @ x for t in result.times])
        np.testing.assert_allclose(result.position[:, 0], expected[:, 0], atol=1e-8)


def test_results_are_read_only() -> None:
    chain = slider()
    controller = PdGravity(chain, np.array(1.0), np.array(1.0))
    result = simulate(controller, constant(chain, np.zeros(1)), FREE)
    assert result.estimate.shape == (101, 0)
    for array in (result.times, result.position, result.torque, result.saturated):
        assert not array.flags.writeable


def test_faults_are_named() -> None:
    chain = slider()
    controller, still = PdGravity(chain, np.array(1.0), np.array(1.0)), constant(chain, np.ones(1))
    unknown = replace(chain, limits=replace(chain.limits, effort=np.array([np.nan])))
    bare = replace(chain, links=(replace(chain.links[0], inertia=None),))
    with pytest.raises(MissingLimit, match="effort"):
        simulate(controller, still, robot=unknown)
    with pytest.raises(InvalidOption, match="the trajectory has the joints q1, q2"):
        simulate(controller, constant(planar_rr(), np.zeros(2)), FREE)
    with pytest.raises(InvalidOption, match="the robot has the joints"):
        simulate(controller, still, FREE, robot=random_chain(0))
    with pytest.raises(InvalidRobotState, match="initial_position has 2 value"):
        simulate(controller, still, FREE, initial_position=[1.0, 2.0])
    with pytest.raises(InvalidRobotState, match="one state"):
        simulate(controller, still, FREE, initial_velocity=[[1.0], [2.0]])
    with pytest.raises(InvalidRobotState, match="disturbance is not finite"):
        simulate(controller, still, FREE, disturbance=[np.nan])
    with pytest.raises(InvalidOption, match="sample_period"):
        simulate(controller, still, replace(FREE, sample_period=1e-9))
    with pytest.raises(MissingInertia):
        simulate(controller, still, FREE, robot=bare)
