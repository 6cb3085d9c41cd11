"""Built-in and uploaded robots' dynamics against pinocchio, which reads their URDF by itself.

On a thousand random states each, to a relative error of 1e-9.
"""

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from dynamics.forward import forward_dynamics
from dynamics.inverse import inverse_dynamics
from dynamics.parameters.base_parameters import base_parameters
from dynamics.parameters.regressor import regressor, standard_parameters
from dynamics.terms import augmented_mass_matrix, coriolis_matrix, gravity_vector, mass_matrix
from kinematics.arrays import Array
from kinematics.model.chain import Chain
from kinematics.robots import builtin_chain, builtin_names, builtin_urdf
from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from tests.dynamics.samples import pinocchio_model, random_state, random_urdf

STATES = 1000
TOLERANCE = 1e-9


def far(value: Array, reference: Array) -> float:
    """Largest relative error over all states; each against the largest entry of its reference.

    Where a reference is rounding error itself (gravity of a level arm), against a thousandth of
    the largest of all states.
    """
    flat = np.abs(reference).reshape(len(reference), -1).max(axis=1)
    scale = np.maximum(flat, max(1e-3 * float(flat.max()), 1e-9))
    off = np.abs(value - reference).reshape(len(reference), -1).max(axis=1)
    return float((off / scale).max())


class Oracle:
    """The same robot in pinocchio, on a batch of states, its moving joints in our order."""

    def __init__(self, urdf: str, chain: Chain, locked: Mapping[str, float] | None = None) -> None:
        model = pin.buildModelFromXML(urdf)
        if locked:
            q = pin.neutral(model)
            for name, position in locked.items():
                q[model.joints[model.getJointId(name)].idx_q] = position
            model = pin.buildReducedModel(model, [model.getJointId(name) for name in locked], q)
        model.gravity.linear = np.array(chain.gravity)
        model.armature = np.array(chain.motor_inertia)
        assert tuple(model.names)[1:] == chain.joint_names
        self.model, self.chain, self.turned = model, chain, pinocchio_model(chain)
        # Continuous joints have two coordinates there, (cos q, sin q).
        self.wide = [joint.nq == 2 for joint in list(model.joints)[1:]]

    def at(self, q: Array) -> Array:
        parts = [(np.cos(x), np.sin(x)) if w else (x,) for x, w in zip(q, self.wide, strict=True)]
        return np.concatenate(parts)

    def values(self, q: Array, qd: Array, qdd: Array) -> dict[str, Array]:
        data, turned = self.model.createData(), self.turned.createData()
        rows: dict[str, list[Any]] = {name: [] for name in ("D", "C", "G", "tau", "Y")}
        for k in range(len(q)):
            p = self.at(q[k])
            upper = np.triu(pin.crba(self.model, data, p)) - np.diag(self.chain.motor_inertia)
            rows["D"].append(upper + np.triu(upper, 1).T)
            C = pin.computeCoriolisMatrix(self.model, data, p, qd[k])
            rows["C"].append(C.copy())
            rows["G"].append(pin.computeGeneralizedGravity(self.model, data, p).copy())
            tau = pin.rnea(self.model, data, p, qd[k], qdd[k])
            rows["tau"].append(tau + self.chain.viscous_friction * qd[k])
            # Parameters belong to frames, and ours have the joint's axis for z: so must its.
            Y = pin.computeJointTorqueRegressor(self.turned, turned, q[k], qd[k], qdd[k])
            rows["Y"].append(Y.copy())
        return {name: np.array(row) for name, row in rows.items()}


def robots() -> list[tuple[str, str]]:
    uploaded = [(f"upload{seed}", random_urdf(seed)) for seed in range(6)]
    return [(name, builtin_urdf(name)) for name in builtin_names()] + uploaded


@pytest.mark.parametrize(("name", "urdf"), robots(), ids=[name for name, _ in robots()])
def test_equals_pinocchio(name: str, urdf: str) -> None:
    chain = builtin_chain(name) if name in builtin_names() else serial_chain(parse_urdf(urdf))
    q, qd, qdd = random_state(chain, 0, STATES)
    expected = Oracle(urdf, chain).values(q, qd, qdd)
    C = coriolis_matrix(chain, q, qd)
    Y = regressor(chain, q, qd, qdd, motors=False)
    torques = inverse_dynamics(chain, q, qd, qdd)
    assert far(mass_matrix(chain, q), expected["D"]) < TOLERANCE
    assert far(C, expected["C"]) < TOLERANCE
    Cqd = np.einsum("kij,kj->ki", C, qd)
    assert far(Cqd, np.einsum("kij,kj->ki", expected["C"], qd)) < TOLERANCE
    assert far(gravity_vector(chain, q), expected["G"]) < TOLERANCE
    assert far(torques, expected["tau"]) < TOLERANCE
    assert far(Y, expected["Y"]) < TOLERANCE
    assert far(forward_dynamics(chain, q, qd, expected["tau"]), qdd) < TOLERANCE
    whole = regressor(chain, q, qd, qdd)
    assert far(whole @ standard_parameters(chain), expected["tau"]) < TOLERANCE
    base = base_parameters(chain, motors=True)
    assert far(base.regressor(whole) @ base.values, expected["tau"]) < TOLERANCE


@pytest.mark.parametrize("seed", range(4))
def test_locked_joints_are_merged_with_their_inertias(seed: int) -> None:
    urdf, whole = random_urdf(seed, branch=True), {"side": 0.7, "slide": -1.3}
    tip = f"plate{2 + seed % 5}"
    chain = serial_chain(parse_urdf(urdf), tip_link=tip, held=whole)
    q, qd, qdd = random_state(chain, 0, 50)
    expected = Oracle(urdf, chain, whole).values(q, qd, qdd)
    assert far(mass_matrix(chain, q), expected["D"]) < TOLERANCE
    assert far(inverse_dynamics(chain, q, qd, qdd), expected["tau"]) < TOLERANCE
    # The whole arm beyond a tip in its middle is held still too.
    short = serial_chain(parse_urdf(urdf), tip_link="plate1", held={**whole, **after(urdf)})
    q, qd, qdd = random_state(short, 1, 50)
    expected = Oracle(urdf, short, {**whole, **after(urdf)}).values(q, qd, qdd)
    assert far(inverse_dynamics(short, q, qd, qdd), expected["tau"]) < TOLERANCE


def after(urdf: str) -> dict[str, float]:
    """Positions of the joints beyond the second."""
    names = [name for name in parse_urdf(urdf).joints if name.startswith("joint")]
    return {name: 0.1 * i for i, name in enumerate(names) if i >= 2}


@pytest.mark.parametrize("name", builtin_names())
def test_the_rate_of_d_less_twice_c_is_skew(name: str) -> None:
    chain = builtin_chain(name)
    q, qd, _ = random_state(chain, 1, STATES)
    C = coriolis_matrix(chain, q, qd)
    # The rate of D by Richardson's extrapolation of central differences along q_dot.
    step = 1e-3
    slopes = [
        (mass_matrix(chain, q + h * qd) - mass_matrix(chain, q - h * qd)) / (2.0 * h)
        for h in (step, 0.5 * step, 0.25 * step)
    ]
    first = [(4.0 * b - a) / 3.0 for a, b in pairwise(slopes)]
    D_rate = (16.0 * first[1] - first[0]) / 15.0
    N = D_rate - 2.0 * C
    assert np.abs(N + N.swapaxes(1, 2)).max() < 1e-9 * max(1.0, np.abs(D_rate).max())
    # Its exact part: q_dot^T (D_rate - 2 C) q_dot vanishes, and C comes from the same D.
    power = np.einsum("ki,kij,kj->k", qd, N, qd)
    assert np.abs(power).max() < 1e-8 * max(1.0, np.abs(D_rate).max())


@pytest.mark.parametrize("name", builtin_names())
def test_mass_matrix_is_positive_definite(name: str) -> None:
    chain = builtin_chain(name)
    M = augmented_mass_matrix(chain, random_state(chain, 2, STATES)[0])
    assert np.linalg.eigvalsh(M).min() > 0.0
