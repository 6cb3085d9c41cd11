"""Checks of how well numbers describe a rotation; they need no arrays."""

from kinematics.errors import InvalidPose

#: A quaternion that came through text keeps about this much of its norm.
NORM_TOLERANCE = 1e-3
#: A matrix that came through text is orthonormal within this.
ORTHONORMAL_TOLERANCE = 1e-6
#: An axis shorter than this names no direction.
_SHORTEST_AXIS = 1e-12


def check_quaternion_norm(norm: float) -> None:
    """Refuse a quaternion by its norm.

    Raises:
        InvalidPose: The norm differs from 1 by more than 1e-3.
    """
    # Said this way round what is not a number is refused, too.
    if not abs(norm - 1.0) <= NORM_TOLERANCE:
        raise InvalidPose(
            f"quaternion_xyzw has norm {norm:.6g}; it must be within {NORM_TOLERANCE} of 1",
            hint="Normalise it; the order is [x, y, z, w].",
            norm=norm,
        )


def check_orthonormal(error: float, determinant: float) -> None:
    """Refuse a matrix R that is no rotation.

    Args:
        error: The largest element of R^T R - I.
        determinant: Of R.

    Raises:
        InvalidPose: The error is more than 1e-6, or the determinant is not +1.
    """
    if not (error <= ORTHONORMAL_TOLERANCE and determinant > 0.0):
        raise InvalidPose(
            f"rotation_matrix is not a rotation: R^T R differs from I by {error:.3g}, "
            f"det R = {determinant:.6g}",
            hint="Give an orthonormal matrix with determinant +1, row by row.",
        )


def check_axis_length(length: float) -> None:
    """Refuse an axis by its length.

    Raises:
        InvalidPose: The axis has no direction.
    """
    if not length >= _SHORTEST_AXIS:
        raise InvalidPose("the axis has length 0, so it names no direction")
