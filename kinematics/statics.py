"""Statics: joint torques that hold a wrench."""

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.jacobian import geometric
from kinematics.model.chain import Chain


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
    try:
        F = np.array(wrench, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidOption(f"wrench is not an array of numbers: {error}") from None
    if F.ndim == 0 or F.shape[-1] != 6 or not np.isfinite(F).all():
        raise InvalidOption("wrench must be six finite numbers [fx, fy, fz, nx, ny, nz]")
    J = geometric(chain, q, link, point)
    try:
        return np.asarray((np.swapaxes(J, -1, -2) @ F[..., None])[..., 0])
    except ValueError:
        raise InvalidOption(
            f"a batch of wrenches {F.shape} does not fit joints {np.shape(q)}",
            hint="Give both the same leading dimensions, or a single one.",
        ) from None
