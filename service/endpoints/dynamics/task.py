"""Equations of motion, regressors and statics as requests ask for them."""

from typing import Any

import numpy as np
from pydantic_core import to_json

from armwright_wire.robots.dynamics import (
    DynamicsRequest,
    ForwardDynamicsRequest,
    Model,
    RegressorRequest,
    WrenchRequest,
)
from dynamics.forward import forward_dynamics as forward
from dynamics.inverse import inverse_dynamics
from dynamics.model.payload import with_gravity, with_motors
from dynamics.parameters.base_parameters import base_parameters
from dynamics.parameters.regressor import parameter_names, reference_regressor, standard_parameters
from dynamics.terms import (
    christoffel_symbols,
    coriolis_matrix,
    gravity_vector,
    kinetic_energy,
    mass_matrix,
    partial_jacobians,
    potential_energy,
)
from kinematics.arrays import Array
from kinematics.errors import InvalidOption, InvalidRobotState
from kinematics.model.chain import Chain
from kinematics.velocity import wrenches_of_torques
from service.endpoints.kinematics.task import task_jacobian, task_vectors
from service.fields import listed
from service.translate.payload import loaded_chain
from service.workers.answer import chain_task, frame_transform, in_frame

#: Numbers of Christoffel symbols or partial Jacobians in one answer: some twenty megabytes.
_MAX_NUMBERS = 1_000_000


def model(chain: Chain, body: Model, R: Array | None = None) -> Chain:
    """The robot as a request wants it.

    Args:
        chain: The robot.
        body: The request.
        R: R_root_frame of the request's frame, shape (3, 3); None for the root frame.

    Raises:
        InvalidOption: A value is out of its range, or gravity turns with the tool.
        InvalidLinkName: What should carry the payload does not exist.
    """
    if body.gravity is not None:
        if R is not None and R.ndim > 2:
            raise InvalidOption(
                "gravity in the frame of the tool is another one at each configuration",
                hint="Send one configuration, or name a frame that stands still.",
            )
        g = np.array(body.gravity)
        chain = with_gravity(chain, g if R is None else R @ g)
    drive = body.motor_inertia, body.viscous_friction, body.coulomb_friction
    if any(value is not None for value in drive):
        chain = with_motors(chain, *drive)
    return chain if body.payload is None else loaded_chain(chain, body.payload)


def wrench(chain: Chain, body: WrenchRequest) -> bytes:
    """Answer a request for torques that hold a wrench, or for the wrench of torques.

    Raises:
        InvalidRobotState: Wrong length.
        InvalidLinkName: No such link.
    """
    q = chain.configuration(body.joints)
    J = task_jacobian(chain, body)
    if body.wrench is not None:
        F = task_vectors(body.wrench, body.axes)
        _check_rows(q, F)
        answer: dict[str, Any] = {"torques": np.einsum("...mn,...m->...n", J, F).tolist()}
    else:
        assert body.torques is not None
        tau = chain.configuration(body.torques, "torques")
        _check_rows(q, tau)
        F, left = wrenches_of_torques(J, tau)
        answer = {"torques": tau.tolist(), "wrench": F.tolist(), "residual": left.tolist()}
    return to_json(answer | in_frame(chain, body.frame))


def dynamics(chain: Chain, body: DynamicsRequest) -> bytes:
    """Answer a request for the equations of motion.

    Raises:
        InvalidRobotState: Wrong length, or numbers of states that differ.
        MissingInertia: The robot lacks an inertia.
    """
    R = _rotation(chain, body)
    robot = model(chain, body, R)
    q = robot.configuration(body.joints)
    zero = np.zeros(robot.n)
    qd = zero if body.velocities is None else body.velocities
    qdd = zero if body.accelerations is None else body.accelerations
    F = _wrench(body, q, R)
    torques = inverse_dynamics(robot, q, qd, qdd, F)
    return to_json(
        _terms(robot, q, body, R)
        | {
            "mass_matrix": mass_matrix(robot, q).tolist(),
            "coriolis_matrix": coriolis_matrix(robot, q, qd).tolist(),
            "gravity": gravity_vector(robot, q).tolist(),
            "torques": torques.tolist(),
            **listed(robot, "motor_inertia", "viscous_friction", "coulomb_friction"),
            "kinetic_energy": kinetic_energy(robot, q, qd).tolist(),
            "potential_energy": potential_energy(robot, q).tolist(),
            **in_frame(chain, body.frame),
        }
    )


def _terms(robot: Chain, q: Array, body: DynamicsRequest, R: Array | None) -> dict[str, Any]:
    """Christoffel symbols and partial Jacobians, where they are asked for; R is R_root_frame."""
    terms: dict[str, Any] = {"christoffel_symbols": None, "partial_jacobians": None}
    numbers = q.size * robot.n * (robot.n if body.christoffel_symbols else 6)
    if (body.christoffel_symbols or body.partial_jacobians) and numbers > _MAX_NUMBERS:
        raise InvalidOption(
            f"christoffel_symbols and partial_jacobians would be {numbers} numbers, at most "
            f"{_MAX_NUMBERS} are answered",
            hint="Send the configurations in several requests.",
        )
    if body.christoffel_symbols:
        terms["christoffel_symbols"] = christoffel_symbols(robot, q).tolist()
    if body.partial_jacobians:
        linear, angular = partial_jacobians(robot, q)
        if R is not None:
            turn = np.swapaxes(R, -1, -2)[..., None, :, :]
            linear, angular = turn @ linear, turn @ angular
        terms["partial_jacobians"] = [
            {
                "joint": name,
                "linear": linear[..., i, :, :].tolist(),
                "angular": angular[..., i, :, :].tolist(),
            }
            for i, name in enumerate(robot.joint_names)
        ]
    return terms


def _wrench(
    body: DynamicsRequest | ForwardDynamicsRequest, q: Array, R: Array | None
) -> Array | None:
    """The wrench of a request, one for each configuration; None where it has none.

    R is R_root_frame of the frame that it is given in.
    """
    if body.wrench is None:
        return None
    F = np.array(body.wrench)
    _check_rows(q, F)
    return _in_root(R, F)


def _rotation(chain: Chain, body: Model) -> Array | None:
    """R_root_frame of a request's frame, shape (3, 3), of the tool (..., 3, 3); None for none."""
    T = frame_transform(chain, body.joints, body.frame)
    return None if T is None else T[..., :3, :3]


def _in_root(R: Array | None, F: Array) -> Array:
    """Wrenches (..., 6) of a frame's axes along those of the root frame."""
    if R is None:
        return F
    force, moment = (R @ part[..., None] for part in (F[..., :3], F[..., 3:]))
    return np.concatenate([force, moment], axis=-2)[..., 0]


def forward_dynamics(chain: Chain, body: ForwardDynamicsRequest) -> bytes:
    """Answer a request for the accelerations that torques cause.

    Raises:
        InvalidRobotState: Wrong length, or numbers of states that differ.
        MissingInertia: The robot lacks an inertia.
    """
    R = _rotation(chain, body)
    robot = model(chain, body, R)
    q = robot.configuration(body.joints)
    zero = np.zeros(robot.n)
    qd = zero if body.velocities is None else body.velocities
    torques = zero if body.torques is None else body.torques
    F = _wrench(body, q, R)
    accelerations = forward(robot, q, qd, torques, F)
    return to_json({"accelerations": accelerations.tolist(), **in_frame(chain, body.frame)})


def regressor(chain: Chain, body: RegressorRequest) -> bytes:
    """Answer a request for the linear parametrisation.

    Raises:
        InvalidRobotState: Wrong length, or numbers of states that differ.
        MissingInertia: The robot lacks an inertia.
    """
    robot = model(chain, body, _rotation(chain, body))
    motors = body.motors
    if motors is None:
        driven = (robot.motor_inertia, robot.viscous_friction, robot.coulomb_friction)
        motors = any(bool(value.any()) for value in driven)
    v = body.velocities if body.reference_velocities is None else body.reference_velocities
    state = (body.joints, body.velocities, v, body.accelerations)
    Y = reference_regressor(robot, *state, motors=motors)
    Theta = standard_parameters(robot, motors=motors)
    base = base_parameters(robot, motors=motors, known_zeros=body.known_zeros)
    named = zip(base.names, base.values.tolist(), base.columns.tolist(), strict=True)
    return to_json(
        {
            "regressor": Y.tolist(),
            "parameters": Theta.tolist(),
            "parameter_names": list(parameter_names(robot, motors=motors)),
            "base_parameters": [
                {"name": name, "value": value, "column": column} for name, value, column in named
            ],
            "base_regressor": base.regressor(Y).tolist(),
            "torques": (Y @ Theta).tolist(),
            **in_frame(chain, body.frame),
        }
    )


dynamics_task = chain_task(dynamics, DynamicsRequest)
forward_dynamics_task = chain_task(forward_dynamics, ForwardDynamicsRequest)
regressor_task = chain_task(regressor, RegressorRequest)
wrench_task = chain_task(wrench, WrenchRequest)


def _check_rows(q: Any, F: Any) -> None:
    if F.ndim == 2 and (q.ndim != 2 or len(q) != len(F)):
        count = len(q) if q.ndim == 2 else 1
        raise InvalidRobotState(
            f"{len(F)} wrenches do not fit {count} configuration(s)",
            hint="Give one wrench for all, or one for each configuration.",
        )
