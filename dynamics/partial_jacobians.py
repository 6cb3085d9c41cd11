"""Partial Jacobians: velocities of the bodies' centres of mass, and of the bodies' turning."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dynamics.model.body import bodies
from kinematics.arrays import Array
from kinematics.jacobian import geometric
from kinematics.model.chain import Chain
from kinematics.pose import inverse


class PartialJacobians(NamedTuple):
    """Jacobians of all bodies, body i moving with joint i, in the base frame.

    Args:
        linear: J_vi with dr_i/dt = J_vi q_dot of the centre of mass r_i, shape (..., n, 3, n).
        angular: J_wi with w_i = J_wi q_dot, shape (..., n, 3, n).
    """

    linear: Array
    angular: Array


def partial_jacobians(chain: Chain, q: ArrayLike) -> PartialJacobians:
    """Partial Jacobians J_vi, J_wi of D = sum_i m_i J_vi^T J_vi + J_wi^T R_i I_i R_i^T J_wi.

    Args:
        chain: The robot.
        q: Positions, (n,) or (..., n) [rad or m].

    Raises:
        InvalidRobotState: q has the wrong length or is not finite.
        MissingInertia: No link that a joint carries has an inertia.
    """
    packed = bodies(chain)
    carried = {link.joint: link for link in chain.links}
    rows = []
    for joint in range(chain.n):
        link = carried[joint]
        T_link_joint = inverse(link.T_joint_link)
        center = T_link_joint[:3, :3] @ packed.centers[joint] + T_link_joint[:3, 3]
        rows.append(geometric(chain, q, link.name, center))
    J = np.stack(rows, axis=-3)
    return PartialJacobians(J[..., :3, :], J[..., 3:, :])
