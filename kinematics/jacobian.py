"""Geometric and analytic Jacobians of any link and any point on it, and their rate of change."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from compiled.kernel import direct, kernel
from compiled.simd import LANES, on_stack
from compiled.simd_transpose import aligned_kernel
from compiled.sincos import TURNS, few_turns_kernel, turn_at_kernel
from kinematics.arrays import Array, numbers
from kinematics.errors import InvalidOption, InvalidRobotState
from kinematics.forward import fits_kernel, joint_frames, link_number
from kinematics.frame import IDENTITY, Frame, compose_kernel, move_kernel, store_kernel
from kinematics.model.branch import branch_to, is_on_branch
from kinematics.model.chain import Chain, JointType
from kinematics.pose import to_zyz
from kinematics.simd_frames import COLUMN, jacobians_lanes_kernel

_FLOAT = np.dtype(np.float64)
# Names of this module: looking them up in another one costs as much as a joint does.
_empty, _POSE = np.empty, (4, 4)
#: sin(theta) below which zyz rates don't exist: the Jacobian's entries pass 1e8 there.
ZYZ_SINGULAR_SINE = 1e-8


@kernel
def jacobian_kernel(model: Array, frames: Array, point: Array, last: int, J: Array) -> None:
    """Write the geometric Jacobian of ``point`` (3,), which joint ``last`` carries, into J (6, n).

    Column j is [z_j x (p - o_j); z_j] for a revolute joint, [z_j; 0] for a prismatic one, and 0
    beyond ``last``. ``model`` is ``Chain.model``, ``frames`` (n, 4, 4) those of the joints.
    """
    for j in range(J.shape[1]):
        if j > last:
            for row in range(6):
                J[row, j] = 0.0
            continue
        zx, zy, zz = frames[j, 0, 2], frames[j, 1, 2], frames[j, 2, 2]
        if model[1 + j, 0] == 0.0:
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


@kernel(allocates=False, inline="code")
def frame_and_jacobian_kernel(model: Array, q: Array, link: int, J: Array) -> Frame:
    """The frame of a link, -1 for the tip, and its Jacobian written into J (6, n).

    ``model`` is ``Chain.model``.
    """
    n = q.shape[0]
    row = 1 + n + (link if link >= 0 else int(model[0, 1]))
    last = int(model[row, 0])
    B = IDENTITY
    turns = on_stack(TURNS)
    few = few_turns_kernel(q, turns)
    for j in range(last + 1):
        c, s = turn_at_kernel(q, j, few, turns)
        B = move_kernel(model, 1 + j, q[j], c, s, B)
        # Origin and axis wait in the column until the link's own origin is known.
        J[0, j], J[1, j], J[2, j] = B[3], B[7], B[11]
        J[3, j], J[4, j], J[5, j] = B[2], B[6], B[10]
    B = compose_kernel(B, model, row)
    j = 0
    # A joint's type is never negative: asking keeps LLVM from making vectors of the loop, which
    # take longer to prepare than the few columns of a robot take one by one.
    while j <= last and model[1 + j, 0] >= 0.0:
        zx, zy, zz = J[3, j], J[4, j], J[5, j]
        if model[1 + j, 0] == 0.0:
            x, y, z = B[3] - J[0, j], B[7] - J[1, j], B[11] - J[2, j]
            J[0, j], J[1, j], J[2, j] = zy * z - zz * y, zz * x - zx * z, zx * y - zy * x
        else:
            J[0, j], J[1, j], J[2, j] = zx, zy, zz
            J[3, j], J[4, j], J[5, j] = 0.0, 0.0, 0.0
        j += 1
    for row in range(6):
        for beyond in range(last + 1, n):
            J[row, beyond] = 0.0
    return B


@kernel
def jacobian_batch_kernel(model: Array, q: Array, link: int, point: Array, J: Array) -> None:
    """Jacobians (m, 6, n) of a point (3,) in the frame of link ``link``, for a batch q (m, n)."""
    n = q.shape[1]
    m = q.shape[0] - q.shape[0] % LANES
    offset = point[0] != 0.0 or point[1] != 0.0 or point[2] != 0.0
    if offset:
        m = 0
    if m > 0:
        size, columns = n * LANES, n * COLUMN * LANES
        room = aligned_kernel(3 * size + 2 * columns)
        rows = J.reshape(J.size)
        for k in range(0, m, LANES):
            at = k * COLUMN * n
            jacobians_lanes_kernel(model, q[k : k + LANES], link, rows[at : at + columns], room)
    for k in range(m, q.shape[0]):
        B = frame_and_jacobian_kernel(model, q[k], link, J[k])
        if not offset:
            continue
        # v of the point is that of the origin and w x r.
        x = B[0] * point[0] + B[1] * point[1] + B[2] * point[2]
        y = B[4] * point[0] + B[5] * point[1] + B[6] * point[2]
        z = B[8] * point[0] + B[9] * point[1] + B[10] * point[2]
        for j in range(n):
            wx, wy, wz = J[k, 3, j], J[k, 4, j], J[k, 5, j]
            J[k, 0, j] += wy * z - wz * y
            J[k, 1, j] += wz * x - wx * z
            J[k, 2, j] += wx * y - wy * x


@kernel(allocates=False, unlocks=False)
def _both_kernel(model: Array, q: Array, link: int, T: Array, J: Array) -> bool:
    fits = fits_kernel(model, q)
    if fits:
        store_kernel(frame_and_jacobian_kernel(model, q, link, J), T)
    return fits


@cache
def both_of_one() -> Callable[[Array, Array, int, Array, Array], bool]:
    """Pose and Jacobian of a link without dispatch, for a read-only model."""
    model = np.empty((1, 14))
    model.setflags(write=False)
    return direct(_both_kernel, model, np.empty(1), 0, np.empty((4, 4)), np.empty((6, 1)))


def pose_and_jacobian(chain: Chain, q: ArrayLike, link: str | None = None) -> tuple[Array, Array]:
    """Pose (4, 4) of a link (the tip where none is named) and its Jacobian (6, n), in one walk.

    Args:
        chain: The robot.
        q: One configuration (n,) [rad or m].
        link: Name of a link.

    Raises:
        InvalidRobotState: Wrong length or not finite.
        InvalidLinkName: No such link.
    """
    if chain.mimic_joints and is_on_branch(chain, link):
        branch = branch_to(chain, link or chain.tip_link)
        T, J = pose_and_jacobian(branch.chain, branch.positions(chain.configuration(q)), link)
        return T, J @ branch.matrix
    number = -1 if link is None else link_number(chain, link)
    both = both_of_one()
    T, J = _empty(_POSE), _empty((6, len(chain.joint_names)))
    one: Any = q
    try:
        if one.dtype == _FLOAT and one.ndim == 1 and both(chain.model, one, number, T, J):
            return T, J
    except (AttributeError, TypeError):
        pass  # It is no array.
    q = chain.configuration(q)
    if q.ndim != 1:
        raise InvalidRobotState("joints must be one configuration here, not several")
    both(chain.model, q, number, T, J)
    return T, J


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
    if chain.mimic_joints and is_on_branch(chain, link):
        branch = branch_to(chain, link or chain.tip_link)
        at = branch.positions(chain.configuration(q))
        return np.asarray(geometric(branch.chain, at, link, point) @ branch.matrix)
    if point is None:
        # The usual case, one configuration that is as it should be, is told by the kernel itself.
        number = -1 if link is None else link_number(chain, link)
        one: Any = q
        try:
            if one.dtype == _FLOAT and one.ndim == 1:
                J = _empty((6, len(chain.joint_names)))
                if both_of_one()(chain.model, one, number, _empty(_POSE), J):
                    return J
        except (AttributeError, TypeError):
            pass
    q = chain.configuration(q)
    at = link_point(point)
    flat = q.reshape(-1, chain.n)
    J = np.empty((flat.shape[0], 6, chain.n))
    number = -1 if link is None else link_number(chain, link)
    jacobian_batch_kernel(chain.model, flat, number, at, J)
    return J.reshape(*q.shape[:-1], 6, chain.n)


def geometric_rate(
    chain: Chain,
    q: ArrayLike,
    rates: ArrayLike,
    link: str | None = None,
    point: ArrayLike | None = None,
) -> Array:
    """Time derivative of the geometric Jacobian along a motion: [v'; w'] = J q_ddot + J' q_dot.

    Args:
        chain: The robot.
        q: One configuration (n,) or a batch (..., n) [rad or m].
        rates: Joint velocities of the same shape [rad/s or m/s].
        link: The link that carries the point; the tip where none is named.
        point: The point in that link's frame, shape (3,) [m]; its origin where none is given.

    Returns:
        dJ/dt, shape (..., 6, n), linear rows first.

    Raises:
        InvalidRobotState: Wrong length or not finite.
        InvalidLinkName: No such link.
    """
    q = chain.configuration(q)
    rates = chain.configuration(rates, "joint_velocities")
    q, rates = np.broadcast_arrays(q, rates)
    if is_on_branch(chain, link):
        branch = branch_to(chain, link or chain.tip_link)
        at, moving = branch.positions(q), branch.rates(rates)
        return np.asarray(geometric_rate(branch.chain, at, moving, link, point) @ branch.matrix)
    carrier = chain.link(link or chain.tip_link)
    n, last = chain.n, carrier.joint
    Jd = np.zeros((*q.shape[:-1], 6, n))
    if last < 0:
        return Jd
    frames = joint_frames(chain, q)[..., : last + 1, :, :]
    # With w_j and o_j' of frame j: z_j' = w_j x z_j, (z_j x r)' = z_j' x r + z_j x (p' - o_j').
    z, o = frames[..., :3, 2], frames[..., :3, 3]
    turns = (chain.joint_types[: last + 1] == JointType.REVOLUTE)[:, None]
    turning, sliding = np.where(turns, z, 0.0), np.where(turns, 0.0, z)
    moving = rates[..., : last + 1, None]
    w = np.cumsum(moving * turning, axis=-2)
    p = (frames[..., last, :, :] @ carrier.T_joint_link @ [*link_point(point), 1.0])[..., None, :3]
    arms = np.diff(np.concatenate([o, p], axis=-2), axis=-2)
    # Velocities of the origins behind each joint, then of the point.
    steps = np.cross(w, arms) + moving * sliding
    v = np.cumsum(steps, axis=-2)
    behind = v - np.cross(w, arms)
    turned = np.cross(w, z)
    lever = np.cross(turned, p - o) + np.cross(z, v[..., -1:, :] - behind)
    Jd[..., :3, : last + 1] = np.swapaxes(np.where(turns, lever, turned), -1, -2)
    Jd[..., 3:, : last + 1] = np.swapaxes(np.where(turns, turned, 0.0), -1, -2)
    return Jd


def link_point(point: ArrayLike | None) -> Array:
    """A point in a link's frame (3,) [m], its origin where none is given.

    Raises:
        InvalidOption: It is not three finite numbers.
    """
    return np.zeros(3) if point is None else numbers(point, "point", (3,))


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
