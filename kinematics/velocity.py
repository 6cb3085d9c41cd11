"""Velocity kinematics and statics: joint velocities and twists, torques that hold a wrench.

With the singular value decomposition J = U diag(s) V^T and a gain a_i for every singular value,

    q_dot = sum_i v_i (a_i / s_i) u_i^T xi + (I - V_r V_r^T) b,

where V_r spans the joint motions that move the link and b is any joint velocity. a_i = 1 is the
pseudo-inverse: the exact solution for n = 6, the least-norm one for n > 6, and the one of least
residual for n < 6 (course notes, lecture 16). Near a singularity a_i = s^2 / (s^2 + l^2) keeps the
joints from racing, only along the directions that are being lost: l^2 = (1 - (s/e)^2) (e/2)^2 for
s < e ("Review of the damped least-squares inverse kinematics with experiments on an industrial
robot manipulator", 1994).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, Indices, as_numbers
from kinematics.errors import InvalidOption
from kinematics.jacobian import geometric
from kinematics.model.chain import Chain

#: Singular values below this are damped: at it, 1 m/s or 1 rad/s asks for 50 rad/s or m/s.
DAMPED_BELOW = 0.02
#: Frames and axes of a long arm are this exact, relative to its size.
_ROUNDING = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class SingularDirections:
    """Singular value decomposition J = U diag(s) V^T at configurations of any leading dimensions.

    Args:
        values: s, largest first, shape (..., k) with k = min(m, n).
        twists: Column i is u_i, the twist that singular value i gives, shape (..., m, k).
        motions: Row i is v_i, the joint velocities that give it, shape (..., n, n); the rows from
            ``rank`` on leave the link at rest.
        rank: Number of directions the link can move in, shape (...).
    """

    values: Array
    twists: Array
    motions: Array
    rank: Indices


@dataclass(frozen=True, slots=True, eq=False)
class JointVelocities:
    """Joint velocities for a twist, and what they make of it.

    Args:
        joint_velocities: q_dot, shape (..., n) [rad/s or m/s].
        residual: xi - J q_dot, shape (..., m) [m/s, rad/s].
        gains: a_i of every singular value, 1 where it is not damped, shape (..., k).
        directions: The singular values and directions they belong to.
    """

    joint_velocities: Array
    residual: Array
    gains: Array
    directions: SingularDirections


def link_twist(
    chain: Chain,
    q: ArrayLike,
    joint_velocities: ArrayLike,
    link: str | None = None,
    point: ArrayLike | None = None,
) -> Array:
    """Twist [v; w] = J(q) q_dot of a link, in the base frame.

    Args:
        chain: The robot.
        q: One configuration (n,) or a batch (..., n) [rad or m].
        joint_velocities: Velocities of the joints, of the same shape [rad/s or m/s].
        link: The link that carries the point; the tip where none is named.
        point: The point in that link's frame, shape (3,) [m]; its origin where none is given.

    Returns:
        Shape (..., 6), linear part first [m/s, rad/s].

    Raises:
        InvalidRobotState: Wrong length or not finite.
        InvalidLinkName: No such link.
        InvalidOption: The batches do not fit each other.
    """
    rates = chain.configuration(joint_velocities, "joint_velocities")
    J = geometric(chain, q, link, point)
    try:
        return np.asarray((J @ rates[..., None])[..., 0])
    except ValueError:
        raise _misfit(joints=J.shape[:-2], joint_velocities=rates.shape[:-1]) from None


def singular_directions(J: Array) -> SingularDirections:
    """Decompose Jacobians (..., m, n) into the twists they give and the motions that give them.

    The rank counts singular values above the rounding of a walk along the arm. Metres and radians
    are added as they are: a change of the unit of length changes the values, not the rank.
    """
    twists, values, motions = np.linalg.svd(J, full_matrices=True)
    k = values.shape[-1]
    largest = values.max(axis=-1, initial=0.0)
    rank = (values > (_ROUNDING * largest)[..., None]).sum(axis=-1)
    return SingularDirections(values, twists[..., :k], motions, rank)


def joint_velocities(
    chain: Chain,
    q: ArrayLike,
    twist: ArrayLike,
    *,
    nullspace: ArrayLike | None = None,
    link: str | None = None,
    point: ArrayLike | None = None,
    damped_below: float = DAMPED_BELOW,
) -> JointVelocities:
    """Joint velocities that give a link a twist, as nearly as can be; see the module's text.

    Args:
        chain: The robot.
        q: One configuration (n,) or a batch (..., n) [rad or m].
        twist: xi = [v; w] in the base frame, shape (..., 6) [m/s, rad/s].
        nullspace: b, shape (..., n) [rad/s or m/s]; only its part that leaves the link at rest
            is added.
        link: The link that carries the point; the tip where none is named.
        point: The point in that link's frame, shape (3,) [m]; its origin where none is given.
        damped_below: Singular values below it are damped; 0 for the plain pseudo-inverse.

    Raises:
        InvalidRobotState: Wrong length or not finite.
        InvalidLinkName: No such link.
        InvalidOption: The twist is not six finite numbers, ``damped_below`` is negative, or the
            batches do not fit each other.
    """
    b = None if nullspace is None else chain.configuration(nullspace, "nullspace")
    J = geometric(chain, q, link, point)
    return rates_of_task(
        J, _six(twist, "twist", "[vx, vy, vz, wx, wy, wz]"), nullspace=b, damped_below=damped_below
    )


def rates_of_task(
    J: Array,
    xi: Array,
    *,
    nullspace: Array | None = None,
    damped_below: float = DAMPED_BELOW,
) -> JointVelocities:
    """Joint velocities for a task of any rows: J may be some rows of a Jacobian in any frame.

    Args:
        J: Jacobian of the task, shape (..., m, n).
        xi: Velocities that are asked for, shape (..., m) [m/s, rad/s].
        nullspace: b, shape (..., n) [rad/s or m/s].
        damped_below: Singular values below it are damped; 0 for the plain pseudo-inverse.

    Raises:
        InvalidOption: ``damped_below`` is negative, or the batches do not fit each other.
    """
    if not 0.0 <= damped_below < np.inf:
        raise InvalidOption(f"damped_below must be 0 or more, got {damped_below}")
    b, found = nullspace, singular_directions(J)
    gains = _gains(found, damped_below)
    try:
        rates = _rates(found, gains, xi, b)
        residual = xi - np.einsum("...ij,...j->...i", J, rates)
    except ValueError:
        lead = () if b is None else b.shape[:-1]
        raise _misfit(joints=J.shape[:-2], twist=xi.shape[:-1], nullspace=lead) from None
    return JointVelocities(rates, residual, gains, found)


def _rates(found: SingularDirections, gains: Array, xi: Array, b: Array | None) -> Array:
    """Joint velocities (..., n) for a twist, with the part of b that leaves the link still."""
    inside = np.arange(found.values.shape[-1]) < found.rank[..., None]
    inverse = np.divide(gains, found.values, out=np.zeros_like(gains), where=inside)
    along = (np.swapaxes(found.twists, -1, -2) @ xi[..., None])[..., 0]
    k = gains.shape[-1]
    rows = found.motions[..., :k, :]
    rates = np.einsum("...k,...kn->...n", inverse * along, rows)
    if b is not None:
        moving = np.where(inside, np.einsum("...kn,...n->...k", rows, b), 0.0)
        rates = rates + b - np.einsum("...k,...kn->...n", moving, rows)
    return np.asarray(rates)


def _gains(found: SingularDirections, damped_below: float) -> Array:
    s = found.values
    if damped_below == 0.0:
        return np.ones_like(s)
    ratio = np.minimum(s / damped_below, 1.0)
    squared = (1.0 - ratio**2) * 0.25
    return np.asarray(ratio**2 / (ratio**2 + squared))


def _six(values: ArrayLike, name: str, parts: str) -> Array:
    """Six finite numbers, or a batch of them, shape (..., 6)."""
    array = as_numbers(values, name)
    if array.ndim == 0 or array.shape[-1] != 6 or not np.isfinite(array).all():
        raise InvalidOption(f"{name} must be six finite numbers {parts}")
    return array


def wrenches_of_torques(J: Array, torques: Array) -> tuple[Array, Array]:
    """Wrenches F of least length with J^T F = tau as nearly as can be, and what is left of tau.

    Args:
        J: Jacobian of the rows of the wrench that may differ from 0, shape (..., m, n).
        torques: tau, shape (..., n) [N m or N].

    Returns:
        F, shape (..., m) [N, N m], and tau - J^T F, shape (..., n) [N m or N].

    Raises:
        InvalidOption: The batches do not fit each other.
    """
    try:
        np.broadcast_shapes(J.shape[:-2], torques.shape[:-1])
    except ValueError:
        raise _misfit(joints=J.shape[:-2], torques=torques.shape[:-1]) from None
    # A task with the Jacobian J^T, whose rates are the wrench.
    solved = rates_of_task(np.swapaxes(J, -1, -2), torques, damped_below=0.0)
    return solved.joint_velocities, solved.residual


def _misfit(**leads: tuple[int, ...]) -> InvalidOption:
    """The error that leading dimensions do not fit each other."""
    listed = ", ".join(f"{name} {lead}" for name, lead in leads.items() if lead)
    return InvalidOption(
        f"the batches do not fit each other: {listed}",
        hint="Give every one the same leading dimensions, or a single vector.",
    )


def holding_torques(
    chain: Chain,
    q: ArrayLike,
    wrench: ArrayLike,
    link: str | None = None,
    point: ArrayLike | None = None,
) -> Array:
    """Joint torques and forces tau = J(q)^T F with which a link exerts a wrench.

    It holds for revolute and prismatic joints alike (virtual work: tau . dq = F . dx). To hold a
    load, ask for the opposite of the load's wrench; the robot's own weight is not in it.

    Args:
        chain: The robot.
        q: One configuration (n,) or a batch (..., n) [rad or m].
        wrench: F = [f; n] that the link exerts at the point, in the base frame, shape (..., 6)
            [N, N m].
        link: The link that carries the point; the tip where none is named.
        point: The point in that link's frame, shape (3,) [m]; its origin where none is given.

    Returns:
        Shape (..., n) [N m or N].

    Raises:
        InvalidRobotState: Wrong length or not finite.
        InvalidLinkName: No such link.
        InvalidOption: The wrench is not six finite numbers, or its batch does not fit the joints'.
    """
    F = _six(wrench, "wrench", "[fx, fy, fz, nx, ny, nz]")
    J = geometric(chain, q, link, point)
    try:
        return np.asarray(np.einsum("...ij,...i->...j", J, F))
    except ValueError:
        raise InvalidOption(
            f"a batch of wrenches {F.shape} does not fit joints {np.shape(q)}",
            hint="Give both the same leading dimensions, or a single one.",
        ) from None
