"""The built-in robots' dynamics against pinocchio, which reads their URDF by itself."""

import numpy as np
import pinocchio as pin
import pytest

from dynamics.coriolis import coriolis_matrix
from dynamics.forward import forward_dynamics
from dynamics.gravity import gravity_vector
from dynamics.inverse import inverse_dynamics
from dynamics.mass_matrix import mass_matrix
from kinematics.robots import builtin_chain, builtin_names, builtin_urdf
from tests.dynamics.oracle import relative_error
from tests.dynamics.samples import random_state


@pytest.mark.parametrize("name", builtin_names())
def test_equals_pinocchio(name: str) -> None:
    chain = builtin_chain(name)
    model = pin.buildModelFromXML(builtin_urdf(name))
    model.gravity.linear = np.array(chain.gravity)
    model.armature = np.array(chain.motor_inertia)
    # Continuous joints have two coordinates there, (cos q, sin q).
    wide = [joint.nq == 2 for joint in list(model.joints)[1:]]
    assert tuple(model.names)[1:] == chain.joint_names
    data = model.createData()
    for q, qd, qdd in zip(*random_state(chain, 0), strict=True):
        parts = [(np.cos(x), np.sin(x)) if w else (x,) for x, w in zip(q, wide, strict=True)]
        p = np.concatenate(parts)
        friction = chain.viscous_friction * qd
        tau = pin.rnea(model, data, p, qd, qdd) + friction
        upper = np.triu(pin.crba(model, data, p)) - np.diag(chain.motor_inertia)
        D = upper + np.triu(upper, 1).T
        C = pin.computeCoriolisMatrix(model, data, p, qd)
        G = pin.computeGeneralizedGravity(model, data, p)
        assert relative_error(inverse_dynamics(chain, q, qd, qdd), tau) < 1e-9
        assert relative_error(mass_matrix(chain, q), D) < 1e-9
        # Of a robot without centrifugal forces C is rounding error in both.
        np.testing.assert_allclose(
            coriolis_matrix(chain, q, qd), C, rtol=0, atol=1e-9 * max(np.abs(C).max(), 1e-3)
        )
        np.testing.assert_allclose(
            gravity_vector(chain, q), G, rtol=0, atol=1e-9 * max(np.abs(G).max(), 1e-3)
        )
        assert relative_error(forward_dynamics(chain, q, qd, tau), qdd) < 1e-9
