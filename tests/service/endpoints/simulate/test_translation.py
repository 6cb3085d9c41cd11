"""Closed loops from the wire and back: gains by hand, and answers that their schema takes."""

import math
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from armwright_wire.motions.simulation import (
    MAX_SAMPLES,
    Controller,
    Disturbance,
    InitialState,
    SimulateAnswer,
    SimulateRequest,
)
from dynamics.terms import mass_matrix
from kinematics.errors import ArmwrightError, InvalidOption
from kinematics.robots import builtin_chain
from kinematics.trajectory.trajectory import Trajectory
from service.endpoints.simulate.translation import (
    controller,
    disturbance,
    initial_state,
    noise,
    options,
    robot_and_model,
    simulation_answer,
)
from tracking.controllers.model_based import (
    Adaptive,
    ComputedTorque,
    IndependentJoint,
    Passivity,
    PdGravity,
)
from tracking.simulation.result import SimulationOutcome, SimulationResult
from tracking.tube.motion_bounds import empty_bounds

CHAIN = builtin_chain("planar_rr")
N = CHAIN.n
#: From (0.3, -0.4) with the velocity (1, 2), for two seconds.
MOTION = Trajectory(CHAIN.joint_names, np.array([0.0, 2.0]), np.array([[[0.3, 1.0], [-0.4, 2.0]]]))
SEGMENTS = {"segments": [{"t0": 0.0, "t1": 2.0, "coefficients": [[0.3, 1.0], [-0.4, 2.0]]}]}
KINDS = {
    "independent_joint": IndependentJoint,
    "computed_torque": ComputedTorque,
    "pd_gravity": PdGravity,
    "passivity": Passivity,
    "adaptive": Adaptive,
}
GAINS = dict.fromkeys(("independent_joint", "computed_torque", "pd_gravity"), ("Kp", "Kd")) | (
    dict.fromkeys(("passivity", "adaptive"), ("Lambda", "K"))
)
BODY: TypeAdapter[Any] = TypeAdapter(Controller)


def made(**fields: Any) -> Any:
    return controller(BODY.validate_python(fields), CHAIN, MOTION)


def request(**fields: Any) -> SimulateRequest:
    least = {"robot": "r", "trajectory": SEGMENTS,
             "controller": {"type": "computed_torque", "natural_frequency": 1.0}}  # fmt: skip
    return SimulateRequest.model_validate(least | fields)


def inertia_felt() -> Any:
    """What each joint feels of the arm at the start: the diagonal of M = D + J."""
    return np.diag(mass_matrix(CHAIN, MOTION.start)) + CHAIN.motor_inertia


# ------------------------------------------------------------------------------ controllers


@pytest.mark.parametrize("name", KINDS)
def test_the_gains_given_are_the_gains_used(name: str) -> None:
    first, second = GAINS[name]
    used = made(type=name, **{first: [2.0, 3.0], second: 5.0})
    assert type(used) is KINDS[name]
    gains = [np.asarray(getattr(used, gain)) for gain in (first, second)]
    expected = [np.array([2.0, 3.0]), np.array([5.0, 5.0])]
    for gain, value in zip(gains, expected, strict=True):
        np.testing.assert_array_equal(np.diag(gain) if gain.ndim == 2 else gain, value)


@pytest.mark.parametrize("name", KINDS)
def test_gains_are_given_whole_or_placed_but_not_both(name: str) -> None:
    first, second = GAINS[name]
    placed = {"natural_frequency": 1.0}
    one, other = {first: 1.0}, {second: 1.0}
    for fields in ({}, one, other, one | other | placed, other | placed):
        with pytest.raises(InvalidOption, match=f"either {first} and {second}, or natural") as no:
            made(type=name, **fields)
        assert no.value.details["gains"] == [first, second]


def test_gravity_compensation_is_placed_with_the_inertia_at_the_start() -> None:
    used = made(type="pd_gravity", natural_frequency=3.0, damping=2.0)
    np.testing.assert_allclose(np.diag(used.Kp), 9.0 * inertia_felt(), rtol=1e-9)
    np.testing.assert_allclose(np.diag(used.Kd), 2.0 * 2.0 * 3.0 * inertia_felt(), rtol=1e-9)


@pytest.mark.parametrize("name", ["passivity", "adaptive"])
def test_the_filtered_error_decays_with_the_natural_frequency(name: str) -> None:
    used = made(type=name, natural_frequency=[3.0, 4.0])
    np.testing.assert_allclose(used.Lambda, [3.0, 4.0])
    np.testing.assert_allclose(np.diag(used.K), [3.0, 4.0] * inertia_felt(), rtol=1e-9)


def test_the_inertia_of_an_independent_joint_comes_from_the_request_the_motors_or_the_arm() -> None:
    fields = {"type": "independent_joint", "natural_frequency": 2.0}
    np.testing.assert_allclose(made(**fields, inertia=0.5).J, [0.5, 0.5])
    np.testing.assert_allclose(made(**fields).J, inertia_felt(), rtol=1e-9)
    motor = {"inertia": 1e-3, "gear_ratio": 10.0, "friction": 1e-4, "back_emf": 1e-3}
    body = request(controller=fields | {"motors": [motor] * N})
    robot, model = robot_and_model(CHAIN, body)
    assert robot is model
    # J = r^2 J_m and B = r^2 (B_m + k_m k_b / R).
    np.testing.assert_allclose(robot.motor_inertia, [0.1] * N)
    np.testing.assert_allclose(robot.viscous_friction, [100.0 * (1e-4 + 1e-3)] * N)
    used = controller(body.controller, model, MOTION)
    assert isinstance(used, IndependentJoint)
    np.testing.assert_allclose(used.J, robot.motor_inertia)
    np.testing.assert_allclose(used.Kp, 4.0 * used.J)
    one_lacks = {"inertia": 0.0}
    body = request(controller=fields | {"motors": [motor, one_lacks]})
    half = controller(body.controller, robot_and_model(CHAIN, body)[1], MOTION)
    assert isinstance(half, IndependentJoint)
    assert (half.J > 0.0).all()


# ------------------------------------------------------------------------------ model errors


def test_a_payload_is_carried_by_the_robot_and_unknown_to_the_model() -> None:
    robot, model = robot_and_model(CHAIN, request(model_error={"payload": {"mass": 2.0}}))
    assert model is CHAIN
    q = np.zeros(N)
    assert np.linalg.eigvalsh(mass_matrix(robot, q) - mass_matrix(CHAIN, q))[-1] > 1e-3


def test_motors_friction_and_gravity_of_the_model_are_its_own() -> None:
    error = {"motor_inertia": 0.3, "viscous_friction": [0.1, 0.2], "gravity": [0.0, 0.0, -1.0]}
    robot, model = robot_and_model(CHAIN, request(model_error=error))
    assert robot is CHAIN
    np.testing.assert_array_equal(model.motor_inertia, [0.3, 0.3])
    np.testing.assert_array_equal(model.viscous_friction, [0.1, 0.2])
    np.testing.assert_array_equal(model.gravity, [0.0, 0.0, -1.0])


def test_inertias_of_links_are_replaced_by_name() -> None:
    link = next(item for item in CHAIN.links if item.inertia is not None)
    body = {"mass": 9.0, "center_of_mass": [0.0, 0.0, 0.0], "inertia": np.eye(3).tolist()}
    _, model = robot_and_model(CHAIN, request(model_error={"inertias": {link.name: body}}))
    replaced = model.link(link.name).inertia
    assert replaced is not None
    assert replaced.mass == 9.0
    for other in CHAIN.links:
        if other.name != link.name:
            assert model.link(other.name).inertia is other.inertia
    with pytest.raises(ArmwrightError, match="nobody"):
        robot_and_model(CHAIN, request(model_error={"inertias": {"nobody": body}}))


# ----------------------------------------------------------------------- states and options


def test_a_run_begins_where_the_trajectory_does_unless_it_is_told_otherwise() -> None:
    assert initial_state(None, CHAIN, MOTION) == (None, None)
    for fields, q, qd in (
        ({}, [0.3, -0.4], [1.0, 2.0]),
        ({"joints": [1.0, 1.5]}, [1.0, 1.5], [1.0, 2.0]),
        ({"velocities": [0.0, 0.5]}, [0.3, -0.4], [0.0, 0.5]),
        ({"offset": [0.1, -0.1]}, [0.4, -0.5], [1.0, 2.0]),
        ({"velocity_offset": [0.1, -0.1]}, [0.3, -0.4], [1.1, 1.9]),
        ({"joints": [1.0, 1.5], "offset": [0.1, 0.2]}, [1.1, 1.7], [1.0, 2.0]),
    ):
        state = initial_state(InitialState.model_validate(fields), CHAIN, MOTION)
        np.testing.assert_allclose(np.array(state), [q, qd], rtol=1e-14)


def test_a_disturbance_lasts_for_ever_unless_it_ends() -> None:
    assert disturbance(None, 0.0, 1.0) is None
    whole = disturbance(Disturbance.model_validate({"torque": 1.0}), 0.0, 1.0)
    assert whole is not None
    assert (whole.start, whole.end) == (0.0, math.inf)
    np.testing.assert_array_equal(whole.wrench, np.zeros(6))
    part = disturbance(
        Disturbance.model_validate({"amplitude": [1.0, 2.0], "frequency": 3.0, "start": 0.5,
                                    "end": 1.5, "wrench": [1, 2, 3, 4, 5, 6]}),
        0.0, 9.0,
    )  # fmt: skip
    assert part is not None
    assert (part.frequency, part.start, part.end) == (3.0, 0.5, 1.5)
    np.testing.assert_array_equal(part.amplitude, [1.0, 2.0])
    np.testing.assert_array_equal(part.wrench, [1, 2, 3, 4, 5, 6])
    with pytest.raises(InvalidOption, match="lasts from 2"):
        disturbance(Disturbance.model_validate({"start": 2.0, "end": 1.0}), 0.0, 9.0)


def test_a_disturbance_is_in_the_time_of_the_trajectory() -> None:
    late = disturbance(Disturbance.model_validate({"start": 5.3, "end": 5.7}), 5.0, 1.0)
    assert late is not None
    assert (late.start, late.end) == pytest.approx((0.3, 0.7))
    begun = disturbance(Disturbance.model_validate({"start": 1.0, "end": 5.5}), 5.0, 1.0)
    assert begun is not None
    assert (begun.start, begun.end) == (0.0, 0.5)
    with pytest.raises(InvalidOption, match="the simulation lasts from 5 s to 6 s"):
        disturbance(Disturbance.model_validate({"start": 0.3, "end": 0.7}), 5.0, 1.0)


def test_noise_is_drawn_by_the_seed_of_the_request() -> None:
    assert noise(request()) is None
    drawn = noise(request(noise={"position": 0.1}, seed=7))
    assert drawn is not None
    assert (drawn.position, drawn.velocity, drawn.seed, drawn.period) == (0.1, 0.0, 7, 1e-3)
    timed = noise(request(noise={"velocity": 0.2, "period": 0.5}))
    assert timed is not None
    assert (timed.velocity, timed.period) == (0.2, 0.5)


def test_options_are_those_of_the_request() -> None:
    fields = {
        "duration": 3.0, "sample_period": 0.1, "control_period": 0.002, "saturate": False,
        "settling_tolerance": 0.05, "relative_tolerance": 1e-6, "absolute_tolerance": 1e-7,
    }  # fmt: skip
    made_options = options(request(**fields), MOTION)
    assert {name: getattr(made_options, name) for name in fields} == fields
    assert options(request(), MOTION).duration is None


def test_evaluations_grow_with_the_duration_from_a_million_on() -> None:
    for duration, count in ((2.0, 1_000_000), (10.0, 1_000_000), (12.0, 1_200_000)):
        assert options(request(duration=duration), MOTION).max_evaluations == count


def test_an_answer_has_so_many_samples_at_most() -> None:
    period = 0.25  # exact, so that the quotient is
    longest = period * MAX_SAMPLES
    assert options(request(sample_period=period, duration=longest), MOTION).duration == longest
    with pytest.raises(InvalidOption, match=r"over 25000.* s gives more than 100000") as error:
        options(request(sample_period=period, duration=longest + period), MOTION)
    assert error.value.hint == "Give at least 0.25 s."
    with pytest.raises(InvalidOption, match="over 2 s gives more than 100000"):
        options(request(sample_period=1e-6), MOTION)


# ------------------------------------------------------------------------------------ back


def result(outcome: SimulationOutcome, settled: float | None, count: int = 0) -> SimulationResult:
    rows = np.arange(6.0).reshape(3, 2)
    cut = np.array([[False, False], [False, True], [True, True]])
    return SimulationResult(
        outcome, np.array([0.0, 0.5, 1.0]), rows, 2.0 * rows, 3.0 * rows, 4.0 * rows, 5.0 * rows,
        cut, np.array([3.0, 2.0, 1.0]), -np.ones(3), np.ones((3, count)), np.array([0.1, 0.7]),
        empty_bounds(1.0, 2), settled, 99, 8, 7,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("outcome", "name"),
    [(SimulationOutcome.COMPLETED, "completed"), (SimulationOutcome.DIVERGED, "ran_away"),
     (SimulationOutcome.EXHAUSTED, "exhausted")],
)  # fmt: skip
def test_every_outcome_has_its_name_and_its_advice(outcome: SimulationOutcome, name: str) -> None:
    used = made(type="computed_torque", Kp=1.0, Kd=1.0)
    answer = simulation_answer(result(outcome, None), used, CHAIN, 0.0)
    model = SimulateAnswer.model_validate(answer)
    assert (model.outcome, model.advice) == (name, outcome.value)
    assert not model.settled
    assert model.settling_time is None
