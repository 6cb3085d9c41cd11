"""Forms of a pose: all branches of its angles, singular cases, and composition of rotations."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidPose
from kinematics.pose import (
    Matrix,
    is_rpy_singular,
    is_zyz_singular,
    to_axis_angle,
    to_rpy,
    to_zyz,
)

#: Axes that a motion is carried out about: those of the moved frame, or those of the first one.
Axes = Literal["current", "fixed"]

# An axis counts as arbitrary, or its sign as free, where the angle is this near to 0 or pi [rad].
_FREE_AXIS = 1e-12


@dataclass(frozen=True, slots=True)
class SingularForm:
    """A form of an orientation that does not determine all of its numbers.

    Args:
        form: "euler_zyz", "rpy" or "axis_angle".
        determined: The combination that is determined.
        choice: The choice made for the rest.
    """

    form: str
    determined: str
    choice: str


def compose(motions: Sequence[tuple[Array, Axes]]) -> Array:
    """Rigid motions carried out in turn, shape (k, 4, 4): the pose after each of them.

    About current axes T <- T T_i, about fixed axes T <- T_i T; the first motion begins at I.

    Args:
        motions: Transforms (4, 4) with the axes that each is carried out about.

    Raises:
        InvalidPose: There is none.
    """
    if not motions:
        raise InvalidPose("there is no motion to compose", hint="Give at least one.")
    poses, T = [], np.eye(4)
    for motion, axes in motions:
        T = T @ motion if axes == "current" else motion @ T
        poses.append(T)
    return np.array(poses)


def zyz_branches(rotation: Matrix) -> Array:
    """Both branches of (phi, theta, psi) [rad], theta in [0, pi] first; one where singular.

    Args:
        rotation: Shape (3, 3).

    Returns:
        Shape (2, 3), or (1, 3) where sin(theta) = 0.
    """
    flips = (False,) if is_zyz_singular(rotation) else (False, True)
    return np.array([to_zyz(rotation, flip=flip) for flip in flips])


def rpy_branches(rotation: Matrix) -> Array:
    """Both branches of (roll, pitch, yaw) [rad], pitch in [-pi/2, pi/2] first; one where singular.

    Args:
        rotation: Shape (3, 3).

    Returns:
        Shape (2, 3), or (1, 3) where cos(pitch) = 0.
    """
    flips = (False,) if is_rpy_singular(rotation) else (False, True)
    return np.array([to_rpy(rotation, flip=flip) for flip in flips])


def singular_forms(rotation: Matrix) -> tuple[SingularForm, ...]:
    """Forms that do not determine all their numbers at an orientation.

    Args:
        rotation: Shape (3, 3).
    """
    R, cases = rotation, []
    if is_zyz_singular(R):
        sign, end = ("+", "0") if R[2, 2] > 0.0 else ("-", "pi")
        text = f"theta = {end}: only phi {sign} psi is determined"
        cases.append(SingularForm("euler_zyz", text, "psi = 0"))
    if is_rpy_singular(R):
        sign, end = ("-", "pi/2") if R[2, 0] < 0.0 else ("+", "-pi/2")
        text = f"pitch = {end}: only yaw {sign} roll is determined"
        cases.append(SingularForm("rpy", text, "roll = 0"))
    angle = to_axis_angle(R)[1]
    if angle < _FREE_AXIS:
        cases.append(SingularForm("axis_angle", "angle = 0: the axis is free", "the axis z"))
    elif angle > np.pi - _FREE_AXIS:
        text = "angle = pi: the axis is determined but for its sign"
        choice = "the axis of the quaternion that is answered"
        cases.append(SingularForm("axis_angle", text, choice))
    return tuple(cases)
