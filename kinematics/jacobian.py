"""Geometric and analytic Jacobians of any link and any point on it."""

import numpy as np
from numpy.typing import ArrayLike

from kinematics.chain import Array, Chain, Indices
from kinematics.errors import InvalidOption
from kinematics.forward import forward_kernel
from kinematics.kernel import kernel
from kinematics.pose import to_zyz

#: sin(theta) below which zyz rates don't exist: the Jacobian's entries pass 1e8 there.
ZYZ_SINGULAR_SINE = 1e-8


@kernel
def jacobian_kernel(types: Indices, frames: Array, point: Array, last: int, J: Array) -> None:
    """Write the geometric Jacobian of ``point`` (3,), which joint ``last`` carries, into J (6, n).

    Column j is [z_j x (p - o_j); z_j] for a revolute joint, [z_j; 0] for a prismatic one, and 0
    beyond ``last``.
    """
    for j in range(J.shape[1]):
        if j > last:
            for row in range(6):
                J[row, j] = 0.0
            continue
        zx, zy, zz = frames[j, 0, 2], frames[j, 1, 2], frames[j, 2, 2]
        if types[j] == 0:
            x = point[0] - frames[j, 0, 3]
            y = point[1] - frames[j, 1, 3]
            z = point[2] - frames[j, 2, 3]
            J[0, j] = zy * z - zz * y
            J[1, j] = zz * x - zx * z
            J[2, j] = zx * y - zy * x
            J[3, j] = zx
            J[4, j] = zy
            J[5, j] = zz
        else:
            J[0, j] = zx
            J[1, j] = zy
            J[2, j] = zz
            J[3, j] = 0.0
            J[4, j] = 0.0
            J[5, j] = 0.0


@kernel
def jacobian_batch_kernel(
    types: Indices, offsets: Array, q: Array, T_joint_link: Array, point: Array, last: int, J: Array
) -> None:
    """Jacobians (m, 6, n) of a point (3,) in the frame of a link, for a batch q (m, n)."""
    frames = np.empty((q.shape[1], 4, 4))
    local = np.empty(3)
    p = np.empty(3)
    for row in range(3):
        local[row] = T_joint_link[row, 3]
        for k in range(3):
            local[row] += T_joint_link[row, k] * point[k]
    for m in range(q.shape[0]):
        forward_kernel(types, offsets, q[m], frames)
        for row in range(3):
            p[row] = local[row] if last < 0 else frames[last, row, 3]
            if last >= 0:
                for k in range(3):
                    p[row] += frames[last, row, k] * local[k]
        jacobian_kernel(types, frames, p, last, J[m])


def geometric(
    chain: Chain, q: ArrayLike, link: str | None = None, point: ArrayLike | None = None
) -> Array:
    """Geometric Jacobian J with [v; w] = J(q) q_dot, in the base frame.

    Args:
        chain: The robot.
        q: One configuration (n,) or a batch (..., n) [rad or m].
        link: The link that carries the point; the tip where none is named.
        point: The point in that link's frame, shape (3,) [m]; its origin where none is given.

    Returns:
        Shape (..., 6, n), linear rows first.

    Raises:
        InvalidRobotState: Wrong length or not finite.
        InvalidLinkName: No such link.
    """
    q = chain.configuration(q)
    carrier = chain.link(link or chain.tip_link)
    at = np.zeros(3) if point is None else np.array(point, dtype=np.float64)
    if at.shape != (3,) or not np.isfinite(at).all():
        raise InvalidOption("point must be three finite numbers [x, y, z] in the link's frame")
    flat = q.reshape(-1, chain.n)
    J = np.empty((flat.shape[0], 6, chain.n))
    jacobian_batch_kernel(
        chain.joint_types, chain.offsets, flat, carrier.T_joint_link, at, carrier.joint, J
    )
    return J.reshape(*q.shape[:-1], 6, chain.n)


def analytic_zyz(J: Array, rotation: Array) -> Array:
    """Analytic Jacobian of one configuration: rows 3..5 give the zyz Euler rates.

    w = B(phi, theta) [phi_dot, theta_dot, psi_dot], so J_a = diag(I, B^-1) J.

    Args:
        J: Geometric Jacobian, shape (6, n).
        rotation: The link's rotation at the same configuration, shape (3, 3).

    Raises:
        InvalidOption: sin(theta) = 0: zyz rates don't exist there.
    """
    phi, theta, _ = to_zyz(rotation)
    sine, cosine = np.sin(theta), np.cos(theta)
    if abs(sine) < ZYZ_SINGULAR_SINE:
        raise InvalidOption(
            f"zyz rates do not exist at theta = {theta:.9g} rad (sin(theta) = 0)",
            hint='Ask for kind "geometric" here.',
        )
    B = np.array(
        [
            [0.0, -np.sin(phi), np.cos(phi) * sine],
            [0.0, np.cos(phi), np.sin(phi) * sine],
            [1.0, 0.0, cosine],
        ]
    )
    return np.vstack([J[:3], np.linalg.solve(B, J[3:])])


def manipulability(singular_values: Array) -> float:
    """Product of the singular values, sqrt(det(J J^T)), 0 at a singularity."""
    return float(np.prod(singular_values))
