"""Driven robots, model errors and closed loops from wire to domain and back.

Controllers from wire to domain and back.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from armwright_wire.motions import simulation as schema
from dynamics.model.body import scale_masses
from dynamics.model.payload import (
    Motor,
    attach_motors,
    inertia,
    with_gravity,
    with_inertias,
    with_motors,
)
from dynamics.parameters.base_parameters import base_parameter_labels, base_parameter_units
from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory
from service.fields import listed, picked
from service.translate.payload import loaded_chain
from service.translate.robots.motors import domain_motors
from tracking.controllers.controller import Controller
from tracking.controllers.gain import adaptation_gain, gain_vector, placed_gains
from tracking.controllers.model_based import (
    Adaptive,
    ComputedTorque,
    IndependentJoint,
    Passivity,
    PdGravity,
    effective_inertia,
)
from tracking.simulation.disturbance import Disturbance, EncoderNoise, JointStops
from tracking.simulation.result import SimulationOutcome, SimulationResult
from tracking.simulation.setup import SimulationOptions


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
    learned = None if body.parameters is None else tuple(body.parameters)
    made = Adaptive(
        model,
        Lambda,
        K,
        np.array(1.0),
        motors=body.motors,
        known_zeros=body.known_zeros,
        learned=learned,
    )
    start = made.estimate
    if body.estimate == "zero":
        start = np.zeros(made.parameters.count)
    elif body.estimate != "model":
        start = np.array(body.estimate)
    gain = adaptation_gain(made.parameters.count, np.array(body.Gamma))
    return dataclasses.replace(made, Gamma=gain, estimate=start)


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


_NAMES: Sequence[tuple[type[Controller], str, tuple[str, ...]]] = (
    (IndependentJoint, "independent_joint", ("Kp", "Kd", "J")),
    (ComputedTorque, "computed_torque", ("Kp", "Kd")),
    (PdGravity, "pd_gravity", ("Kp", "Kd")),
    (Passivity, "passivity", ("Lambda", "K")),
    (Adaptive, "adaptive", ("Lambda", "K", "Gamma")),
)


def controller_answer(used: Controller) -> dict[str, Any]:
    """The controller as answers give it, with the gains and the parameters that it learns."""
    name, gains = next((name, gains) for kind, name, gains in _NAMES if isinstance(used, kind))
    return {
        "type": name,
        "gains": {gain: getattr(used, gain).tolist() for gain in gains},
        **_parameters(used),
    }


def _parameters(used: Controller) -> dict[str, Any]:
    """Names, labels and units of the parameters that a controller learns; null for the others."""
    if not isinstance(used, Adaptive):
        return dict.fromkeys(("parameter_names", "parameter_labels", "parameter_units"))
    base = used.parameters
    return {
        "parameter_names": list(base.names),
        "parameter_labels": list(base_parameter_labels(base, used.chain)),
        "parameter_units": list(base_parameter_units(base, used.chain)),
    }


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


def robot_and_model(
    chain: Chain, body: schema.SimulateRequest, own: Sequence[Motor] | None = None
) -> tuple[Chain, Chain]:
    """The robot that is simulated, and the model that its controller believes in.

    Args:
        chain: The robot.
        body: The request.
        own: The robot's own motors, one for each joint; None where it has none.

    Raises:
        InvalidOption: A value is out of its range.
        InvalidLinkName: A link is unknown.
    """
    chain = driven_robot(chain, body, own)
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
    drive = error.motor_inertia, error.viscous_friction, error.coulomb_friction
    if any(value is not None for value in drive):
        model = with_motors(model, *drive)
    if error.gravity is not None:
        model = with_gravity(model, error.gravity)
    return (chain if error.payload is None else loaded_chain(chain, error.payload)), model


def driven_robot(
    chain: Chain, body: schema.SimulateRequest, own: Sequence[Motor] | None = None
) -> Chain:
    """The robot with the motors, frictions and limits of a request in place of its own.

    Args:
        chain: The robot; inertias and frictions of its own motors are part of it.
        body: The request.
        own: The robot's own motors, one for each joint; None where it has none.

    Raises:
        InvalidOption: A value is out of its range, contradicts another or has no effect.
    """
    requested = request_motors(chain, body)
    if requested is not None:
        if body.motor_inertia is not None or body.viscous_friction is not None:
            raise InvalidOption(
                "motors have an inertia and a friction, and motor_inertia or viscous_friction is "
                "given as well",
                hint="Give either motors, or what they come to at the joints.",
            )
        chain = attach_motors(chain, requested)
    joints = body.motor_inertia, body.viscous_friction, body.coulomb_friction
    if any(value is not None for value in joints):
        chain = with_motors(chain, *joints)
    is_limited = requested is not None and any(
        motor.voltage_limit is not None for motor in requested
    )
    if not body.saturate and (is_limited or body.effort_limits is not None):
        raise InvalidOption(
            "effort_limits and voltage_limit have no effect without saturation",
            hint="Leave them out, or leave saturate true.",
        )
    return _with_effort_limits(chain, body, own if requested is None else requested)


def _with_effort_limits(
    chain: Chain, body: schema.SimulateRequest, motors: Sequence[Motor] | None
) -> Chain:
    """The robot with the effort limits of a request, and those that its motors' voltages set."""
    if motors is None and body.effort_limits is None:
        return chain
    effort = chain.limits.effort
    if body.effort_limits is not None:
        effort = gain_vector(chain, "effort_limits", body.effort_limits)
    if motors is not None:
        drive = np.array([motor.torque_limit for motor in motors])
        # A limit that is not known stays so where the motor has none.
        effort = np.where(np.isinf(drive), effort, np.fmin(effort, drive))
    return dataclasses.replace(chain, limits=dataclasses.replace(chain.limits, effort=effort))


def request_motors(chain: Chain, body: schema.SimulateRequest) -> tuple[Motor, ...] | None:
    """The motors of a request, one for each joint; None where it has none.

    Raises:
        InvalidOption: They are given twice, or a value is out of its range.
    """
    of_controller = getattr(body.controller, "motors", None)
    # Of an adaptive controller `motors` says whether these are learned.
    of_controller = of_controller if isinstance(of_controller, list) else None
    if of_controller is not None and body.motors is not None:
        raise InvalidOption(
            "motors: they are given beside the controller's own motors",
            hint="Give them once, as motors of the request.",
        )
    motors = body.motors if of_controller is None else of_controller
    if motors is None:
        return None
    listed = motors if isinstance(motors, list) else [motors] * chain.n
    return domain_motors(listed)


def initial_state(
    body: schema.InitialState | None,
    chain: Chain,
    trajectory: Trajectory,
    rest: Array | None = None,
) -> tuple[Array | None, Array | None]:
    """Positions and velocities to begin with.

    Args:
        body: The request's.
        chain: The robot.
        trajectory: The reference.
        rest: Configuration of rest before the reference begins, shape (n,) [rad or m]; at the
            start of the reference where it is not given.

    Raises:
        InvalidRobotState: A vector has the wrong length.
    """
    if body is None:
        return rest, None
    begin = trajectory.start if rest is None else rest
    q = _start_state(body.joints, begin, chain, "initial_state.joints")
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
        begins: Time of the trajectory's beginning, as the request counts [s].
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
        **picked(body, "duration", "sample_period", "control_period"),
        relative_tolerance=relative,
        absolute_tolerance=absolute,
        **picked(body, "saturate", "settling_tolerance"),
        max_evaluations=evaluations,
        tube=body.scene is not None,
        stops=None if body.joint_stops is None else JointStops(**body.joint_stops.model_dump()),
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
    result: SimulationResult,
    used: Controller,
    robot: Chain,
    begins: float,
    motors: Sequence[Motor] | None = None,
) -> dict[str, Any]:
    """A closed loop as answers give it.

    Args:
        result: The simulation.
        used: The controller.
        robot: The simulated robot.
        begins: Time of the reference's beginning, as the request counts [s].
        motors: The motors that drive the robot, one for each joint.
    """
    adaptive = used if isinstance(used, Adaptive) else None
    settling = result.settling_time
    return {
        "outcome": _OUTCOMES[result.outcome],
        "advice": result.outcome.value,
        "time": (result.times + begins).tolist(),
        **listed(result, "position", "velocity"),
        "reference": {
            "position": result.reference_position.tolist(),
            "velocity": result.reference_velocity.tolist(),
        },
        "torque": result.torque.tolist(),
        "voltage": None
        if motors is None
        else np.column_stack(
            [motor.voltage(tau) for motor, tau in zip(motors, result.torque.T, strict=True)]
        ).tolist(),
        "saturated": result.saturated.any(axis=1).tolist(),
        **listed(result, "tracking_error", "lyapunov", "lyapunov_rate"),
        "estimate": None if adaptive is None else result.estimate.tolist(),
        "true_parameters": None if adaptive is None else adaptive.parameters.of(robot).tolist(),
        "max_tracking_error": float(result.max_tracking_error.max()),
        "max_joint_errors": result.max_tracking_error.tolist(),
        "settled": result.settled,
        "settling_time": None if settling is None else settling + begins,
        "controller": controller_answer(used),
        **listed(robot, "motor_inertia", "viscous_friction", "coulomb_friction"),
        "tube": None,
        "notes": [],
        "integration": {
            "evaluations": result.evaluations,
            "explicit_steps": result.steps,
            "implicit_steps": result.implicit_steps,
        },
    }
