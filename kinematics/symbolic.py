"""The chain as CasADi expressions: the evaluator that an optimiser differentiates.

Built from the same arrays and by the same rules as the kernels of ``forward`` and ``jacobian``;
a test holds the two equal. Calling a CasADi function with numpy arrays costs tens of
microseconds: build expressions with these, evaluate with the kernels.
"""

from typing import Any

import casadi
from numpy.typing import ArrayLike

from kinematics.arrays import Array
from kinematics.errors import InvalidRobotState
from kinematics.jacobian import link_point
from kinematics.model.branch import require_on_chain
from kinematics.model.chain import Chain

#: A CasADi matrix, SX (scalar expressions) or MX; CasADi itself has no types.
Expression = Any


def symbolic_frames(chain: Chain, q: Expression) -> list[Expression]:
    """Frames of all joints in the base frame, T_base_i = T_base_(i-1) A_i M_i(q_i).

    Args:
        chain: The robot.
        q: Symbolic positions, SX or MX, n x 1 [rad or m].

    Returns:
        n expressions of shape 4 x 4.

    Raises:
        InvalidRobotState: q has not one entry for each joint.
    """
    if q.numel() != chain.n:
        raise InvalidRobotState(
            f"joints has {q.numel()} symbolic value(s), robot {chain.name!r} has {chain.n} joints"
        )
    frames: list[Expression] = []
    for i in range(chain.n):
        step = casadi.mtimes(_constant(chain.offsets[i]), _motion(int(chain.joint_types[i]), q[i]))
        frames.append(casadi.mtimes(frames[-1], step) if frames else step)
    return frames


def symbolic_jacobian(
    chain: Chain, q: Expression, link: str | None = None, point: ArrayLike | None = None
) -> Expression:
    """Geometric Jacobian, 6 x n, linear rows first, of a point in a link's frame.

    Column j is [z_j x (p - o_j); z_j] for a revolute joint, [z_j; 0] for a prismatic one, and 0
    for joints beyond the one that carries the link.

    Args:
        chain: The robot.
        q: Symbolic positions, SX or MX, n x 1 [rad or m].
        link: The link that carries the point; the tip where none is named.
        point: The point in that link's frame, shape (3,) [m]; its origin where none is given.

    Raises:
        InvalidRobotState: q has not one entry for each joint.
        InvalidLinkName: No such link.
        InvalidOption: The point is not three finite numbers.
    """
    at = link_point(point)
    require_on_chain(chain, link or chain.tip_link)
    carrier, frames = chain.link(link or chain.tip_link), symbolic_frames(chain, q)
    T = _constant(carrier.T_joint_link)
    if carrier.joint >= 0:
        T = casadi.mtimes(frames[carrier.joint], T)
    p = casadi.mtimes(T[:3, :3], at) + T[:3, 3]
    columns = [
        _column(int(chain.joint_types[j]), frames[j], p)
        if j <= carrier.joint
        else casadi.DM.zeros(6, 1)
        for j in range(chain.n)
    ]
    return casadi.horzcat(*columns)


def _constant(matrix: Array) -> Expression:
    """A CasADi constant whose zeros are structural, so that products with them vanish."""
    return casadi.sparsify(casadi.DM(matrix))


def _motion(joint_type: int, q: Expression) -> Expression:
    """M_i(q_i): a turn about z, or a slide along it."""
    T = type(q)(4, 4)
    T[2, 2] = T[3, 3] = 1.0
    if joint_type == 0:
        T[0, 0] = T[1, 1] = casadi.cos(q)
        T[1, 0] = casadi.sin(q)
        T[0, 1] = -T[1, 0]
    else:
        T[0, 0] = T[1, 1] = 1.0
        T[2, 3] = q
    return T


def _column(joint_type: int, frame: Expression, p: Expression) -> Expression:
    z = frame[:3, 2]
    if joint_type == 0:
        return casadi.vertcat(casadi.cross(z, p - frame[:3, 3]), z)
    return casadi.vertcat(z, casadi.DM.zeros(3, 1))
