"""Forward dynamics against pinocchio's articulated-body algorithm and against the inverse."""

from dataclasses import replace

import numpy as np
import pytest

from dynamics.forward import forward_dynamics
from dynamics.inverse import inverse_dynamics
from kinematics.errors import InvalidRobotState, MissingInertia
from kinematics.model.chain import Inertia
from tests.dynamics.samples import planar_rr, random_chain, random_state, relative_error


@pytest.mark.parametrize("seed", range(10))
def test_undoes_inverse_dynamics(seed: int) -> None:
    chain = random_chain(seed, 1 + seed % 9, motors=True)
    q, qd, qdd = random_state(chain, seed)
    F, g = np.random.default_rng(seed).normal(size=(len(q), 6)), [1.0, 2.0, -3.0]
    torque = inverse_dynamics(chain, q, qd, qdd, F, g)
    assert relative_error(forward_dynamics(chain, q, qd, torque, F, g), qdd) < 1e-10


def test_a_body_without_inertia_about_its_axis_is_named() -> None:
    arm = planar_rr()
    nothing = Inertia(0.0, np.zeros(3), np.zeros((3, 3)))
    links = tuple(
        replace(link, inertia=nothing) if link.name == "link1" else link for link in arm.links
    )
    massless = replace(arm, links=links)
    with pytest.raises(MissingInertia, match="'q2'"):
        forward_dynamics(massless, [0.1, 0.2], [0.0, 0.0], [0.0, 0.0])
    # A motor at that joint is enough.
    driven = replace(massless, motor_inertia=np.array([0.0, 0.1]))
    qdd = forward_dynamics(driven, [0.1, 0.2], [0.0, 0.0], [0.0, 0.5])
    assert qdd[1] == pytest.approx(5.0)


def test_faults_are_named() -> None:
    chain = random_chain(4)
    q = np.zeros(chain.n)
    with pytest.raises(InvalidRobotState, match="torques has 1 value"):
        forward_dynamics(chain, q, q, [1.0])
    with pytest.raises(InvalidRobotState, match="torques is not finite"):
        forward_dynamics(chain, q, q, np.full(chain.n, np.inf), wrench=np.zeros(6))
