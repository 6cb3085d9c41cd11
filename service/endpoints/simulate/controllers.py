"""Controllers from wire to domain and back."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from armwright_wire.motions import simulation as schema
from dynamics.parameters.base_parameters import base_parameter_labels, base_parameter_units
from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory
from tracking.controllers.adaptive import Adaptive
from tracking.controllers.controller import Controller
from tracking.controllers.gain import adaptation_gain, gain_vector, placed_gains
from tracking.controllers.independent_joint import IndependentJoint, effective_inertia
from tracking.controllers.model_based import ComputedTorque, Passivity, PdGravity


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
