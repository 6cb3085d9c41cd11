"""Controllers, model errors and closed loops from wire to domain and back."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dynamics.body import scale_masses
from dynamics.motor import Motor, attach_motors
from dynamics.payload import inertia, with_gravity, with_inertias, with_motors
from kinematics.arrays import Array
from kinematics.chain import Chain
from kinematics.errors import InvalidOption
from kinematics.trajectory import Trajectory
from service.schemas import simulation as schema
from service.translate.payload import loaded_chain
from tracking.adaptive import Adaptive
from tracking.computed_torque import ComputedTorque
from tracking.controller import Controller
from tracking.disturbance import Disturbance, EncoderNoise
from tracking.gain import gain_vector, placed_gains
from tracking.independent_joint import IndependentJoint, effective_inertia
from tracking.options import SimulationOptions
from tracking.passivity import Passivity
from tracking.pd_gravity import PdGravity
from tracking.result import SimulationOutcome, SimulationResult

#: Evaluations of the dynamics that a second of motion may take: ten times what a stiff arm needs.
_EVALUATIONS_PER_SECOND = 100_000
#: Evaluations of the dynamics that any run may take, however short it is.
_LEAST_EVALUATIONS = 1_000_000
#: Evaluations in a control period: a step of the integrator with its dense output takes sixteen.
_EVALUATIONS_PER_PERIOD = 20
#: Loosest tolerances for a tracking tube: the integrator's errors are added to it.
_TUBE_RELATIVE_TOLERANCE = 1e-10
_TUBE_ABSOLUTE_TOLERANCE = 1e-12
#: Outcomes as answers name them.
_OUTCOMES: Mapping[SimulationOutcome, str] = {
    SimulationOutcome.COMPLETED: "completed",
    SimulationOutcome.DIVERGED: "ran_away",
    SimulationOutcome.EXHAUSTED: "exhausted",
}


def robot_and_model(chain: Chain, body: schema.SimulateRequest) -> tuple[Chain, Chain]:
    """The robot that is simulated, and the model that its controller believes in.

    Raises:
        InvalidOption: A value is out of its range.
        InvalidLinkName: A link is unknown.
    """
    motors = getattr(body.controller, "motors", None)
    if isinstance(motors, list):
        chain = attach_motors(chain, [Motor(**motor.model_dump()) for motor in motors])
    error = body.model_error
    if error is None:
        return chain, chain
    model = chain if error.mass_scale is None else scale_masses(chain, error.mass_scale)
    if error.inertias is not None:
        believed = {
            name: inertia(item.mass, item.center_of_mass, item.inertia)
            for name, item in error.inertias.items()
        }
        model = with_inertias(model, believed)
    if error.motor_inertia is not None or error.viscous_friction is not None:
        model = with_motors(model, error.motor_inertia, error.viscous_friction)
    if error.gravity is not None:
        model = with_gravity(model, error.gravity)
    return (chain if error.payload is None else loaded_chain(chain, error.payload)), model


def controller(body: schema.Controller, model: Chain, trajectory: Trajectory) -> Controller:
    """The controller of a request, with the gains that it names or places.

    A natural frequency w and a damping zeta give every joint the poles of s^2 + 2 zeta w s + w^2:
    exactly for computed torque and for a motor alone; for the others with what each joint feels of
    the arm at the start of the trajectory (K_p = M_ii w^2, K_d = 2 zeta M_ii w; Lambda = w,
    K = M_ii w).

    Raises:
        InvalidOption: A gain is missing or out of its range.
        MissingInertia: The model lacks an inertia.
    """
    if isinstance(body, schema.IndependentJoint):
        return _independent_joint(body, model, trajectory)
    if isinstance(body, schema.ComputedTorque):
        kp, kd = placed_gains(model, body.natural_frequency or 1.0, body.damping)
        Kp, Kd = _either(body, ("Kp", "Kd"), (kp, kd))
        return ComputedTorque(model, Kp, Kd)
    felt = effective_inertia(model, trajectory.start)
    kp, kd = placed_gains(model, body.natural_frequency or 1.0, body.damping)
    if isinstance(body, schema.PdGravity):
        Kp, Kd = _either(body, ("Kp", "Kd"), (felt * kp, felt * kd))
        return PdGravity(model, Kp, Kd)
    w = np.sqrt(kp)
    if "damping" in body.model_fields_set:
        raise InvalidOption(
            f"damping has no effect on a controller of type {body.type}: Lambda = w and "
            "K = M_ii w place two poles at -w for each joint",
            hint="Leave it out, or give Lambda and K.",
        )
    Lambda, K = _either(body, ("Lambda", "K"), (w, felt * w))
    if isinstance(body, schema.Passivity):
        return Passivity(model, Lambda, K)
    return _adaptive(body, model, Lambda, K)


def _independent_joint(
    body: schema.IndependentJoint, model: Chain, trajectory: Trajectory
) -> IndependentJoint:
    if body.inertia is not None:
        J = gain_vector(model, "inertia", body.inertia)
    elif (model.motor_inertia > 0.0).all():
        J = model.motor_inertia
    else:
        J = effective_inertia(model, trajectory.start)
    if body.natural_frequency is None:
        Kp, Kd = _either(body, ("Kp", "Kd"), (J, J))
        return IndependentJoint(model, Kp, Kd, J)
    _either(body, ("Kp", "Kd"), (J, J))
    return IndependentJoint.by_pole_placement(model, body.natural_frequency, body.damping, J)


def _adaptive(body: schema.Adaptive, model: Chain, Lambda: Array, K: Array) -> Adaptive:
    made = Adaptive(model, Lambda, K, np.array(1.0), motors=body.motors)
    count = made.parameters.count
    start = made.estimate
    if body.estimate == "zero":
        start = np.zeros(count)
    elif body.estimate != "model":
        start = np.array(body.estimate)
    return Adaptive(model, made.Lambda, made.K, np.array(body.Gamma), start, body.motors, made.base)


def _either(
    body: schema.ControllerBody, names: tuple[str, str], placed: tuple[Array, Array]
) -> tuple[Array, Array]:
    """The two gains as given, or as placed by the natural frequency.

    Raises:
        InvalidOption: Both are given, or neither.
    """
    given = [getattr(body, name) for name in names]
    if "damping" in body.model_fields_set and body.natural_frequency is None:
        raise InvalidOption(
            f"damping has no effect beside {names[0]} and {names[1]}",
            hint="It is for natural_frequency; leave it out.",
        )
    if body.natural_frequency is None and all(value is not None for value in given):
        return np.array(given[0]), np.array(given[1])
    if body.natural_frequency is not None and all(value is None for value in given):
        return placed
    raise InvalidOption(
        f"the controller needs either {names[0]} and {names[1]}, or natural_frequency",
        hint="natural_frequency [rad/s] and damping place the poles and so make the gains.",
        gains=list(names),
    )


def initial_state(
    body: schema.InitialState | None, chain: Chain, trajectory: Trajectory
) -> tuple[Array | None, Array | None]:
    """Positions and velocities to begin with.

    Raises:
        InvalidRobotState: A vector has the wrong length.
    """
    if body is None:
        return None, None
    q = _start_state(body.joints, trajectory.start, chain, "initial_state.joints")
    start = trajectory.sample([0.0], 1)[0]
    qd = _start_state(body.velocities, start, chain, "initial_state.velocities")
    if body.offset is not None:
        q = q + chain.configuration(body.offset, "initial_state.offset")
    if body.velocity_offset is not None:
        qd = qd + chain.configuration(body.velocity_offset, "initial_state.velocity_offset")
    return q, qd


def _start_state(given: ArrayLike | None, start: Array, chain: Chain, name: str) -> Array:
    return start if given is None else chain.configuration(given, name)


def disturbance(
    body: schema.Disturbance | None, begins: float, duration: float
) -> Disturbance | None:
    """Disturbance of the robot, its times counted from the start of the trajectory.

    Args:
        body: The request's, in the time of its trajectory.
        begins: When the trajectory begins in that time [s].
        duration: How long the simulation lasts [s].

    Raises:
        InvalidOption: A value is out of its range, or the disturbance never acts.
    """
    if body is None:
        return None
    start = begins if body.start is None else body.start
    end = math.inf if body.end is None else body.end
    if start >= begins + duration or end <= begins:
        raise InvalidOption(
            f"disturbance: from {start:g} s to {end:g} s it never acts: the simulation lasts from "
            f"{begins:g} s to {begins + duration:g} s",
            hint="Times are those of the trajectory, which begins at its first t0.",
        )
    return Disturbance(
        body.torque,
        body.amplitude,
        body.frequency,
        (0.0,) * 6 if body.wrench is None else body.wrench,
        max(start - begins, 0.0),
        end - begins,
    )


def noise(body: schema.SimulateRequest) -> EncoderNoise | None:
    """Noise of the encoders."""
    if body.noise is None:
        return None
    more = {} if body.noise.period is None else {"period": body.noise.period}
    return EncoderNoise(body.noise.position, body.noise.velocity, body.seed, **more)


def options(body: schema.SimulateRequest, trajectory: Trajectory) -> SimulationOptions:
    """Options of the integration.

    Raises:
        InvalidOption: A value is out of its range, or too many samples are asked.
    """
    duration = trajectory.duration if body.duration is None else body.duration
    if duration / body.sample_period > schema.MAX_SAMPLES:
        raise InvalidOption(
            f"sample_period: {body.sample_period:g} s over {duration:g} s gives more than "
            f"{schema.MAX_SAMPLES} samples",
            hint=f"Give at least {duration / schema.MAX_SAMPLES:.3g} s.",
        )
    evaluations = max(_LEAST_EVALUATIONS, round(_EVALUATIONS_PER_SECOND * duration))
    _check_period("control_period", body.control_period, duration, evaluations)
    relative, absolute = body.relative_tolerance, body.absolute_tolerance
    if body.scene is not None:
        relative = min(relative, _TUBE_RELATIVE_TOLERANCE)
        absolute = min(absolute, _TUBE_ABSOLUTE_TOLERANCE)
    return SimulationOptions(
        duration=body.duration,
        sample_period=body.sample_period,
        control_period=body.control_period,
        relative_tolerance=relative,
        absolute_tolerance=absolute,
        saturate=body.saturate,
        settling_tolerance=body.settling_tolerance,
        max_evaluations=evaluations,
    )


def _check_period(name: str, period: float | None, duration: float, evaluations: int) -> None:
    """Refuse a period that would use up the evaluations.

    Raises:
        InvalidOption: It is too short.
    """
    if period is not None and duration / period * _EVALUATIONS_PER_PERIOD > evaluations:
        raise InvalidOption(
            f"{name}: {period:g} s over {duration:g} s takes more than the "
            f"{evaluations} evaluations of the dynamics that are allowed",
            hint=f"Give at least {duration * _EVALUATIONS_PER_PERIOD / evaluations:.3g} s.",
        )


# ------------------------------------------------------------------------------------ back


def simulation_answer(
    result: SimulationResult, used: Controller, robot: Chain, begins: float
) -> dict[str, Any]:
    """A closed loop as answers give it, of a trajectory that begins at a time [s]."""
    adaptive = used if isinstance(used, Adaptive) else None
    settling = result.settling_time
    return {
        "outcome": _OUTCOMES[result.outcome],
        "advice": result.outcome.value,
        "time": (result.times + begins).tolist(),
        "position": result.position.tolist(),
        "velocity": result.velocity.tolist(),
        "reference": {
            "position": result.reference_position.tolist(),
            "velocity": result.reference_velocity.tolist(),
        },
        "torque": result.torque.tolist(),
        "saturated": result.saturated.any(axis=1).tolist(),
        "tracking_error": result.tracking_error.tolist(),
        "lyapunov": result.lyapunov.tolist(),
        "lyapunov_rate": result.lyapunov_rate.tolist(),
        "estimate": None if adaptive is None else result.estimate.tolist(),
        "true_parameters": None if adaptive is None else adaptive.parameters.of(robot).tolist(),
        "max_tracking_error": float(result.max_tracking_error.max()),
        "max_joint_errors": result.max_tracking_error.tolist(),
        "settled": result.settled,
        "settling_time": None if settling is None else settling + begins,
        "controller": _controller_answer(used),
        "tube": None,
        "notes": [],
        "integration": {
            "evaluations": result.evaluations,
            "explicit_steps": result.steps,
            "implicit_steps": result.implicit_steps,
        },
    }


_NAMES: Sequence[tuple[type[Controller], str, tuple[str, ...]]] = (
    (IndependentJoint, "independent_joint", ("Kp", "Kd", "J")),
    (ComputedTorque, "computed_torque", ("Kp", "Kd")),
    (PdGravity, "pd_gravity", ("Kp", "Kd")),
    (Passivity, "passivity", ("Lambda", "K")),
    (Adaptive, "adaptive", ("Lambda", "K", "Gamma")),
)


def _controller_answer(used: Controller) -> dict[str, Any]:
    name, gains = next((name, gains) for kind, name, gains in _NAMES if isinstance(used, kind))
    return {
        "type": name,
        "gains": {gain: getattr(used, gain).tolist() for gain in gains},
        "parameter_names": list(used.parameters.names) if isinstance(used, Adaptive) else None,
    }
