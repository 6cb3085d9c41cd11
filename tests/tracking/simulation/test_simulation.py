"""The closed loop: closed forms, controllers called from Python, stiff loops, joint stops."""

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

from dynamics.model.body import scale_masses
from dynamics.model.payload import Motor, attach_motors, with_motors, with_payload
from kinematics.arrays import Array
from kinematics.errors import InvalidOption, InvalidRobotState, MissingInertia, MissingLimit
from kinematics.model.chain import Chain, Inertia
from kinematics.robots import builtin_chain
from kinematics.trajectory.trajectory import Trajectory
from tests.dynamics.samples import planar_rr, random_chain
from tests.tracking.samples import constant, slider, smooth
from tracking.controllers.control_law import Kind
from tracking.controllers.controller import AdaptiveController, Controller, Reference
from tracking.controllers.model_based import (
    Adaptive,
    ComputedTorque,
    IndependentJoint,
    Passivity,
    PdGravity,
    effective_inertia,
)
from tracking.simulation import callback
from tracking.simulation.disturbance import (
    DISSIPATION,
    STIFFNESS,
    Disturbance,
    EncoderNoise,
    JointStops,
    add_stops,
    stop_arrays,
)
from tracking.simulation.result import SimulationOutcome, SimulationResult
from tracking.simulation.setup import prepare
from tracking.simulation.simulation import SimulationOptions, simulate

FREE = SimulationOptions(saturate=False)


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


def test_an_unstable_loop_runs_away_and_a_stiff_one_exhausts_what_it_may_cost() -> None:
    def run(mass: float, Kp: float, Kd: float, options: SimulationOptions) -> SimulationResult:
        chain = slider(mass)
        law = PdGravity(chain, np.array(Kp), np.array(Kd))
        rest = constant(chain, np.zeros(1), 5.0)
        return simulate(law, rest, options, initial_position=[0.1])

    result = run(0.01, 1e4, 100.0, replace(FREE, control_period=0.01))
    assert result.outcome is SimulationOutcome.DIVERGED
    assert "lower the gains" in result.outcome.value
    assert not result.settled
    assert 0 < len(result.times) < 501
    assert np.isfinite(result.position).all()
    result = run(1e-3, 1e6, 1e5, replace(FREE, max_evaluations=2000))
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


def controllers(chain: Chain, q: Array, w: float = 15.0) -> dict[Kind, Controller]:
    felt = effective_inertia(chain, q)
    return {
        Kind.INDEPENDENT_JOINT: IndependentJoint.by_pole_placement(chain, w, 1.0, felt),
        Kind.COMPUTED_TORQUE: ComputedTorque.by_pole_placement(chain, w),
        Kind.PD_GRAVITY: PdGravity(chain, felt * w**2, 2.0 * felt * w),
        Kind.PASSIVITY: Passivity(chain, np.array(w), felt * w),
        Kind.ADAPTIVE: Adaptive(chain, np.array(w), felt * w, np.array(0.3)),
    }


@pytest.mark.parametrize("period", [None, 4e-3])
@pytest.mark.parametrize("kind", Kind)
def test_equals_the_controllers_called_from_python(kind: Kind, period: float | None) -> None:
    model = random_chain(6, 4, motors=True)
    robot = scale_masses(model, [1.2, 0.9, 1.1, 1.3])
    zero = np.zeros(4)
    controller = controllers(model, zero)[kind]
    limits = replace(robot.limits, effort=np.array([30.0, 30.0, 8.0, 8.0]))
    robot = replace(robot, limits=limits)
    trajectory = smooth(model, zero, np.array([0.5, -0.4, 0.3, 0.2]), 0.4)
    options = SimulationOptions(duration=0.5, control_period=period, sample_period=7e-3)
    push = Disturbance(
        [1.0, 0.0, -1.0, 0.0], [0.0, 0.5, 0.0, 0.5], 3.0, (1, 2, -1, 0.1, 0.2, 0.3), 0.1, 0.33
    )
    noise = EncoderNoise(1e-4, 1e-3, seed=5, period=0.02)
    fast = simulate(
        controller,
        trajectory,
        options,
        robot=robot,
        initial_position=zero + 0.05,
        disturbance=push,
        noise=noise,
    )
    setup = prepare(controller, trajectory, options, robot, (zero + 0.05, None), push, noise)
    slow = callback.run(setup)
    assert fast.outcome is slow.outcome is SimulationOutcome.COMPLETED
    np.testing.assert_array_equal(fast.times, slow.times)
    for name in ("position", "velocity", "reference_position", "reference_velocity"):
        np.testing.assert_allclose(getattr(fast, name), getattr(slow, name), atol=2e-6)
    np.testing.assert_allclose(fast.torque, slow.torque, atol=1e-3)
    np.testing.assert_allclose(fast.estimate, slow.estimate, atol=2e-6)
    np.testing.assert_allclose(fast.lyapunov, slow.lyapunov, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(fast.max_tracking_error, slow.max_tracking_error, atol=1e-4)
    assert fast.saturated.any() == slow.saturated.any()


def test_a_stiff_loop_goes_on_implicitly() -> None:
    """Motors whose back-EMF damps them within microseconds, under a light arm."""
    mass, b, Kp = 1e-3, 1e2, 50.0
    chain = slider(mass, b)
    controller = IndependentJoint(chain, np.array(Kp), np.array(1.0), np.array([mass]))
    result = simulate(controller, constant(chain, np.zeros(1), 2.0), FREE, initial_position=[1.0])
    assert result.outcome is SimulationOutcome.COMPLETED
    assert result.implicit_steps > 0
    # An explicit method alone takes 2 s b / m / 6 = 33,000 steps for its stability.
    assert result.steps + result.implicit_steps < 2000
    A = np.array([[0.0, 1.0], [-Kp / mass, -(b + 1.0) / mass]])
    values, vectors = np.linalg.eig(A)
    weights = np.linalg.solve(vectors, [1.0, 0.0])
    expected = (np.exp(np.outer(result.times, values)) * weights) @ vectors.T
    np.testing.assert_allclose(result.position[:, 0], expected[:, 0], atol=1e-7)


def test_absurd_gains_are_integrated_all_the_same() -> None:
    """At a million rad/s the explicit method is stable in steps that no accuracy asks for."""
    chain = planar_rr()
    trajectory = smooth(chain, np.zeros(2), np.ones(2))
    result = simulate(ComputedTorque.by_pole_placement(chain, 1e6), trajectory, FREE)
    assert result.outcome is SimulationOutcome.COMPLETED
    assert result.implicit_steps > 0
    # The exact loop has no error; a hundred times the tolerance is what thousands of steps add up.
    assert result.max_tracking_error.max() < 100.0 * FREE.relative_tolerance


def test_a_stiff_arm_equals_scipys_implicit_method() -> None:
    motors = [Motor(1e-5, 1e-3, 0.05, 0.05, 0.5, 100.0)] * 2
    chain = attach_motors(planar_rr((0.02, 0.01)), motors)
    light = replace(chain, motor_inertia=np.full(2, 1e-4))
    controller = PdGravity(light, np.array(400.0), np.array(5.0))
    trajectory = smooth(light, np.zeros(2), np.ones(2), 0.5)
    result = simulate(controller, trajectory, replace(FREE, duration=1.0, sample_period=0.05))
    assert result.implicit_steps > 0
    assert result.outcome is SimulationOutcome.COMPLETED

    options = replace(FREE, duration=1.0)
    setup = prepare(controller, trajectory, options, light, (None, None), None, None)
    loop = callback._Loop(setup)

    def rate(t: float, x: Array) -> Array:
        loop.segment = int(t >= 0.5)
        return loop.rate(t, x, loop.command)

    x = np.zeros(4)
    for start, end in ((0.0, 0.5), (0.5, 1.0)):
        at = result.times[(result.times >= start) & (result.times <= end)]
        # Within a piece: the reference rests from its end on.
        solution = solve_ivp(
            rate, (start, end - 1e-12), x, "Radau", np.clip(at, start, end - 1e-12),
            rtol=1e-9, atol=1e-11,
        )  # fmt: skip
        mine = result.position[(result.times >= start) & (result.times <= end)]
        np.testing.assert_allclose(mine, solution.y[:2].T, atol=1e-6)
        x = solution.y[:, -1]


def test_noise_is_seeded() -> None:
    chain = planar_rr()
    controller = ComputedTorque.by_pole_placement(chain, 20.0)
    trajectory = smooth(chain, np.zeros(2), np.ones(2))
    options = replace(FREE, control_period=2e-3)

    def run(noise: EncoderNoise | None) -> Array:
        return simulate(controller, trajectory, options, noise=noise).position

    first = run(EncoderNoise(1e-3, 1e-2, seed=1))
    np.testing.assert_array_equal(first, run(EncoderNoise(1e-3, 1e-2, seed=1)))
    assert np.abs(first - run(EncoderNoise(1e-3, 1e-2, seed=2))).max() > 1e-5
    np.testing.assert_array_equal(run(None), run(EncoderNoise()))


def test_a_disturbance_acts_while_it_lasts() -> None:
    chain = slider(2.0)
    controller = PdGravity(chain, np.array(1e-9), np.array(1e-9))
    push = Disturbance([4.0], start=0.25, end=0.75)
    result = simulate(controller, constant(chain, np.zeros(1)), FREE, disturbance=push)
    t = result.times
    inside = np.clip(t, 0.25, 0.75) - 0.25
    expected = inside**2 + 2.0 * inside * np.maximum(t - 0.75, 0.0)
    np.testing.assert_allclose(result.position[:, 0], expected, atol=1e-8)
    wave = Disturbance(amplitude=[1.0], frequency=2.0)
    result = simulate(controller, constant(chain, np.zeros(1)), FREE, disturbance=wave)
    w = 4.0 * np.pi
    expected = (t / w - np.sin(w * t) / w**2) / 2.0
    np.testing.assert_allclose(result.position[:, 0], expected, atol=1e-8)


def test_a_wrench_at_the_tip_is_a_payload_when_it_is_a_weight() -> None:
    chain = builtin_chain("puma560")
    q = np.array([0.2, -0.7, 0.4, 0.1, 0.6, -0.2])
    felt = effective_inertia(chain, q)
    controller = PdGravity(chain, 400.0 * felt, 40.0 * felt)
    weight = np.concatenate([2.0 * chain.gravity, np.zeros(3)])
    options = replace(FREE, duration=6.0, sample_period=0.5)
    pushed = simulate(
        controller, constant(chain, q), options, disturbance=Disturbance(wrench=weight)
    )
    loaded = simulate(controller, constant(chain, q), options, robot=with_payload(chain, 2.0))
    # At rest a weight is a weight, whichever way it comes.
    np.testing.assert_allclose(pushed.position[-1], loaded.position[-1], atol=1e-6)
    assert np.abs(pushed.tracking_error[-1]).max() > 1e-3


def test_a_massless_joint_is_named() -> None:
    chain = planar_rr()
    nothing = Inertia(0.0, np.zeros(3), np.zeros((3, 3)))
    links = tuple(
        replace(link, inertia=nothing) if link.name == "link1" else link for link in chain.links
    )
    massless = replace(chain, links=links)
    controller = PdGravity(chain, np.array(1.0), np.array(1.0))
    with pytest.raises(MissingInertia, match="'q2'"):
        simulate(controller, constant(chain, np.zeros(2)), FREE, robot=massless)
    fine = with_motors(massless, [0.0, 0.1])
    result = simulate(controller, constant(chain, np.zeros(2)), FREE, robot=fine)
    assert result.outcome is SimulationOutcome.COMPLETED


MASS, STIFF, LOSS = 2.0, 5e4, 3.0
STOPS = JointStops(STIFF, LOSS)
OPTIONS = SimulationOptions(
    saturate=False, relative_tolerance=1e-12, absolute_tolerance=1e-13, stops=STOPS,
    sample_period=0.01, duration=1.0,
)  # fmt: skip


def railed(lower: float = -0.3, upper: float = 0.5) -> Chain:
    chain = slider(MASS)
    limits = replace(chain.limits, lower=np.array([lower]), upper=np.array([upper]))
    return replace(chain, limits=limits)


def rebound(v: float, c: float) -> float:
    """Speed after an impact: v / c - ln(1 + c v) / c^2 is the same before and after."""
    energy = c * v - np.log1p(c * v)
    return float(brentq(lambda x: -x - np.log1p(-x) - energy, 0.0, 1.0 - 1e-12)) / c


@dataclass(frozen=True, slots=True, eq=False)
class Idle(Controller):
    """No torque at all, in Python."""

    chain: Chain

    def torque(self, _t: float, _q: Array, _qd: Array, _reference: Reference, /) -> Array:
        return np.zeros(1)

    def lyapunov(
        self, q: Array, qd: Array, reference: Reference, robot: Chain | None = None
    ) -> float:
        return 0.0


def controller(chain: Chain, *, is_compiled: bool) -> Controller:
    return PdGravity(chain, np.array(1e-12), np.array(1e-12)) if is_compiled else Idle(chain)


@pytest.mark.parametrize("is_compiled", [True, False])
@pytest.mark.parametrize("v", [0.8, 2.0])
def test_an_impact_leaves_the_speed_of_the_closed_form(v: float, is_compiled: bool) -> None:
    chain = railed()
    result = simulate(
        controller(chain, is_compiled=is_compiled), constant(chain, np.zeros(1)), OPTIONS,
        initial_velocity=[v],
    )  # fmt: skip
    after = result.velocity[result.velocity[:, 0] < 0.0, 0]
    first = after[after > -v + 1e-6]
    assert -first[3] == pytest.approx(rebound(v, LOSS), rel=1e-8)
    # No deeper than a spring without loss would let it.
    assert result.position.max() < 0.5 + v * np.sqrt(MASS / STIFF)


def test_bounces_between_two_stops_are_those_of_scipy_with_events() -> None:
    lower, upper, v, loss = -0.3, 0.5, 3.0, 0.1
    chain = railed(lower, upper)
    options = replace(OPTIONS, stops=JointStops(STIFF, loss))
    result = simulate(
        controller(chain, is_compiled=True), constant(chain, np.zeros(1)), options,
        initial_velocity=[v],
    )  # fmt: skip

    def slope(_t: float, x: Any) -> list[float]:
        over, under = max(x[0] - upper, 0.0), max(lower - x[0], 0.0)
        push = -STIFF * over * max(0.0, 1.0 + loss * x[1])
        push += STIFF * under * max(0.0, 1.0 - loss * x[1])
        return [x[1], push / MASS]

    events: list[Any] = [lambda _t, x: x[0] - upper, lambda _t, x: x[0] - lower]
    for event in events:
        setattr(event, "terminal", True)  # noqa: B010  scipy's way to say so
    t, x, times = 0.0, np.array([0.0, v]), result.times
    exact = np.zeros((len(times), 2))
    contacts = 0
    while t < times[-1]:
        part = solve_ivp(slope, (t, times[-1]), x, "DOP853", rtol=1e-13, atol=1e-14,
                         events=events, dense_output=True)  # fmt: skip
        dense: Any = part.sol
        inside = (times >= t) & (times <= part.t[-1])
        exact[inside] = np.asarray(dense(times[inside])).T
        contacts += part.status
        t, x = float(part.t[-1]), part.y[:, -1]
        # Past the surface by a rounding error, so that the same event is not found again.
        x = x + np.sign(x[1]) * np.array([1e-13, 0.0])
    assert contacts >= 4
    np.testing.assert_allclose(result.position[:, 0], exact[:, 0], atol=1e-8)


def test_a_stop_carries_what_presses_against_it_and_never_pulls() -> None:
    chain = railed()
    result = simulate(
        PdGravity(chain, np.array(100.0), np.array(40.0)),
        constant(chain, np.array([1.5])),
        replace(OPTIONS, duration=6.0, sample_period=0.1),
        initial_position=[0.0],
    )
    # k_p (1.5 - q) = k (q - 0.5)
    assert result.position[-1, 0] == pytest.approx((150.0 + 0.5 * STIFF) / (STIFF + 100.0))
    torque = np.zeros(1)
    add_stops(stop_arrays(chain, STOPS), np.array([0.51]), np.array([-5.0]), torque)
    assert torque[0] == 0.0
    add_stops(stop_arrays(chain, STOPS), np.array([-0.31]), np.array([0.1]), torque)
    assert torque[0] == pytest.approx(STIFF * 0.01 * 0.7)


def test_without_stops_limits_are_passed() -> None:
    chain = railed()
    free = simulate(
        controller(chain, is_compiled=True), constant(chain, np.zeros(1)),
        replace(OPTIONS, stops=None), initial_velocity=[2.0],
    )  # fmt: skip
    assert free.position[-1, 0] == pytest.approx(2.0)
    # Joints without limits have no stops.
    open_ended = slider(MASS)
    free = simulate(
        controller(open_ended, is_compiled=True), constant(open_ended, np.zeros(1)), OPTIONS,
        initial_velocity=[2.0],
    )  # fmt: skip
    assert free.position[-1, 0] == pytest.approx(2.0)


def test_stops_out_of_range_are_refused() -> None:
    with pytest.raises(InvalidOption, match="stiffness"):
        JointStops(stiffness=0.0)
    with pytest.raises(InvalidOption, match="dissipation"):
        JointStops(dissipation=-1.0)
    assert JointStops() == JointStops(STIFFNESS, DISSIPATION)


def test_starts_inside_a_stop_and_beyond_every_robot_s_are_refused() -> None:
    chain = railed()
    used, motion = controller(chain, is_compiled=True), constant(chain, np.zeros(1))
    with pytest.raises(InvalidRobotState, match=r"starts at 0\.6, inside its stop"):
        simulate(used, motion, OPTIONS, initial_position=[0.6])
    simulate(used, motion, replace(OPTIONS, stops=None), initial_position=[0.6])
    with pytest.raises(InvalidRobotState, match=r"initial position of joint 'q1' is 1e[+]09"):
        simulate(used, motion, OPTIONS, initial_position=[1e9])
    with pytest.raises(InvalidRobotState, match=r"initial velocity of joint 'q1' is -2e[+]06"):
        simulate(used, motion, OPTIONS, initial_velocity=[-2e6])
