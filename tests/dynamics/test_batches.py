"""Batches of any shape beside one configuration after the other, of all that is asked of both."""

from collections.abc import Callable

import numpy as np
import pytest

from dynamics.forward import forward_dynamics
from dynamics.inverse import inverse_dynamics
from dynamics.parameters.regressor import regressor
from dynamics.terms import (
    coriolis_matrix,
    gravity_vector,
    kinetic_energy,
    mass_matrix,
    partial_jacobians,
    potential_energy,
)
from kinematics.arrays import Array
from kinematics.forward import forward, joint_frames, link_poses
from kinematics.jacobian import geometric, geometric_rate
from kinematics.model.chain import Chain
from kinematics.velocity import holding_torques, joint_velocities, link_twist
from tests.dynamics.samples import random_chain

CHAIN = random_chain(3, 6, motors=True)
POINT = (0.1, 0.0, 0.2)
#: What is asked of a chain, a configuration and two more vectors of its joints.
CALLS: dict[str, Callable[[Chain, Array, Array, Array], Array]] = {
    "forward": lambda c, q, v, a: forward(c, q),
    "forward of a link": lambda c, q, v, a: forward(c, q, "link2"),
    "link poses": lambda c, q, v, a: link_poses(c, q),
    "joint frames": lambda c, q, v, a: joint_frames(c, q),
    "Jacobian": lambda c, q, v, a: geometric(c, q),
    "Jacobian of a point": lambda c, q, v, a: geometric(c, q, "link2", POINT),
    "rate": lambda c, q, v, a: geometric_rate(c, q, v),
    "twist": lambda c, q, v, a: link_twist(c, q, v, "link2", POINT),
    "joint velocities": lambda c, q, v, a: joint_velocities(c, q, v, nullspace=a).joint_velocities,
    "holding torques": lambda c, q, v, a: holding_torques(c, q, v),
    "inverse dynamics": inverse_dynamics,
    "forward dynamics": forward_dynamics,
    "mass matrix": lambda c, q, v, a: mass_matrix(c, q),
    "Coriolis matrix": lambda c, q, v, a: coriolis_matrix(c, q, v),
    "gravity": lambda c, q, v, a: gravity_vector(c, q),
    "regressor": regressor,
    "kinetic energy": lambda c, q, v, a: kinetic_energy(c, q, v),
    "potential energy": lambda c, q, v, a: potential_energy(c, q),
    "partial Jacobians": lambda c, q, v, a: partial_jacobians(c, q).linear,
}


@pytest.mark.parametrize("name", CALLS)
@pytest.mark.parametrize("lead", [(1,), (7,), (8,), (2, 3), (19,)])
def test_a_batch_is_what_each_of_it_is_alone(name: str, lead: tuple[int, ...]) -> None:
    call, rng = CALLS[name], np.random.default_rng(4)
    q, v, a = rng.uniform(-2.0, 2.0, (3, *lead, CHAIN.n))
    many = call(CHAIN, q, v, a)
    for at in np.ndindex(*lead):
        np.testing.assert_allclose(many[at], call(CHAIN, q[at], v[at], a[at]), atol=1e-9)
    assert call(CHAIN, q[:0], v[:0], a[:0]).shape == (0, *many.shape[1:])
