"""Rotations and rigid motions: their usual forms, with all branches of angles and singular cases.

A pose is a 4x4 homogeneous transform ``T_a_b``: the pose of frame b in frame a.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from kinematics.arrays import Array
from kinematics.errors import InvalidPose
from kinematics.rounding import check_axis_length, check_quaternion_norm, check_rotation

#: Axes that a motion is carried out about: those of the moved frame, or those of the first one.
Axes = Literal["current", "fixed"]

# An axis counts as arbitrary, or its sign as free, where the angle is this near to 0 or pi [rad].
_FREE_AXIS = 1e-12

Matrix = NDArray[np.float64]
_NO_TURN = [0.0, 0.0, 0.0, 1.0]
_IDENTITY = np.eye(4)
#: Symmetric part of dR/dt R^T, relative to it, that rounding of six digits leaves.
RATE_TOLERANCE = 1e-5

#: Below this value of sin(theta) the two outer zyz angles can't be told apart.
_SINGULAR_SINE = 1e-12
#: |R^T R - I| of rotations that only rounding keeps from being exact: those of a singular value
#: decomposition miss by 17 units in the last place at most, in a million random ones.
_ROUNDING = 32.0 * np.finfo(np.float64).eps


def rotation_x(angle: float) -> Matrix:
    """Rotation by ``angle`` [rad] about x, shape (3, 3)."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def rotation_y(angle: float) -> Matrix:
    """Rotation by ``angle`` [rad] about y, shape (3, 3)."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def rotation_z(angle: float) -> Matrix:
    """Rotation by ``angle`` [rad] about z, shape (3, 3)."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def skew(w: ArrayLike) -> Matrix:
    """The matrix S(w) with S(w) v = w x v, shape (3, 3)."""
    x, y, z = _finite(w, (3,), "vector")
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def angular_velocity(rotation: Matrix, rate: Matrix) -> Matrix:
    """Angular velocity w of a rotation that changes: S(w) = dR/dt R^T.

    Args:
        rotation: R, shape (3, 3).
        rate: dR/dt, shape (3, 3) [1/s].

    Returns:
        Shape (3,), in the outer frame [rad/s].

    Raises:
        InvalidPose: dR/dt R^T is not skew-symmetric: no rotation changes so.
    """
    S = rate @ rotation.T
    off = float(np.abs(S + S.T).max())
    if off > RATE_TOLERANCE * max(1.0, float(np.abs(S).max())):
        raise InvalidPose(
            f"rotation_rate is no rate of this rotation: dR/dt R^T is not skew-symmetric, its "
            f"symmetric part is up to {0.5 * off:.3g}",
            hint="Give dR/dt of the same instant as R, with more digits.",
        )
    return np.array([S[2, 1] - S[1, 2], S[0, 2] - S[2, 0], S[1, 0] - S[0, 1]]) / 2.0


def transform(rotation: ArrayLike | None = None, position: ArrayLike | None = None) -> Matrix:
    """Put a rotation (3, 3) and a position (3,) [m] together, shape (4, 4)."""
    T = _IDENTITY.copy()
    if rotation is not None:
        T[:3, :3] = rotation
    if position is not None:
        T[:3, 3] = position
    return T


def inverse(T: Matrix) -> Matrix:
    """Inverse rigid motion, T_b_a from T_a_b: (R, p) -> (R^T, -R^T p)."""
    return transform(T[:3, :3].T, -T[:3, :3].T @ T[:3, 3])


def from_quaternion(xyzw: ArrayLike) -> Matrix:
    """Rotation matrix of a quaternion (x, y, z, w), normalised when its norm is near 1.

    Raises:
        InvalidPose: The norm differs from 1 by more than 1e-3.
    """
    if isinstance(xyzw, list) and xyzw == _NO_TURN:  # most solids of scenes stand upright
        return np.eye(3)
    q = np.asarray(xyzw, dtype=np.float64)
    square = float(q.dot(q)) if q.shape == (4,) else math.inf
    if not math.isfinite(square):
        _finite(q, (4,), "quaternion_xyzw")
    norm = math.sqrt(square)
    check_quaternion_norm(norm)
    # In Python's own numbers, as the error of a matrix below.
    x, y, z, w = (q / norm).tolist()
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def to_quaternion(rotation: Matrix) -> Matrix:
    """Quaternion (x, y, z, w) of a rotation matrix (3, 3), with w >= 0.

    The largest of the four components is taken from the diagonal, so nothing is lost near
    half turns ("A new method to extract quaternion from rotation matrix", 1978).
    """
    R = rotation
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    squares = np.array([R[0, 0], R[1, 1], R[2, 2], trace])
    i = int(np.argmax(squares))
    if i == 3:
        q = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], 1.0 + trace])
    else:
        j, k = (i + 1) % 3, (i + 2) % 3
        q = np.empty(4)
        q[i] = 1.0 + R[i, i] - R[j, j] - R[k, k]
        q[j] = R[i, j] + R[j, i]
        q[k] = R[i, k] + R[k, i]
        q[3] = R[k, j] - R[j, k]
    q /= np.linalg.norm(q)
    return -q if q[3] < 0.0 else q


def to_quaternions(rotations: Matrix) -> Matrix:
    """Quaternions (..., 4) of rotation matrices (..., 3, 3), each as ``to_quaternion`` gives it."""
    matrices = rotations.reshape(-1, 3, 3)
    turns = scipy.spatial.transform.Rotation.from_matrix(matrices, assume_valid=True)
    return np.asarray(turns.as_quat(canonical=True).reshape(*rotations.shape[:-2], 4))


def from_matrix(rotation: ArrayLike) -> Matrix:
    """Check that a (3, 3) matrix is a rotation and answer it.

    A matrix that is one to the last bits keeps every bit, so that its answer is answered as it is;
    of one that is written with few decimals the nearest rotation is answered.

    Raises:
        InvalidPose: R differs from a rotation by more than rounding, or det R is not +1.
    """
    R = _finite(rotation, (3, 3), "rotation_matrix")
    if check_rotation(R.tolist()) <= _ROUNDING:
        return R.copy()
    u, _, vt = np.linalg.svd(R)
    return np.asarray(u @ vt)


def is_exact_rotation(R: Matrix) -> bool:
    """Whether `from_matrix` answers a matrix (3, 3) as it is: a rotation to rounding."""
    rows = R.tolist()
    if not math.isfinite(sum(map(sum, rows))):
        return False
    try:
        return bool(check_rotation(rows) <= _ROUNDING)
    except InvalidPose:
        return False


def from_zyz(angles: ArrayLike) -> Matrix:
    """Rotation R = Rz(phi) Ry(theta) Rz(psi) of zyz Euler angles [rad]."""
    phi, theta, psi = _finite(angles, (3,), "euler_zyz")
    return rotation_z(phi) @ rotation_y(theta) @ rotation_z(psi)


def to_zyz(rotation: Matrix, *, flip: bool = False) -> Matrix:
    """Angles (phi, theta, psi) [rad] of R = Rz(phi) Ry(theta) Rz(psi).

    The branch has theta in [0, pi]; ``flip`` answers the other one, theta in [-pi, 0]. Where
    sin(theta) = 0 only phi + psi (or phi - psi) is determined: psi = 0 is chosen.
    """
    R = rotation
    sine = math.hypot(R[0, 2], R[1, 2])
    # atan2 keeps all digits near theta = 0, where acos(r33) loses half of them.
    theta = math.atan2(sine, R[2, 2])
    if sine < _SINGULAR_SINE:
        phi = math.atan2(R[1, 0], R[0, 0]) if R[2, 2] > 0 else math.atan2(-R[1, 0], -R[0, 0])
        return np.array([phi, theta, 0.0])
    sign = -1.0 if flip else 1.0
    phi = math.atan2(sign * R[1, 2], sign * R[0, 2])
    # Near theta = 0 or pi, phi carries noise; psi from what it leaves over makes up for it.
    rest = (rotation_z(phi) @ rotation_y(sign * theta)).T @ R
    psi = math.atan2(rest[1, 0] - rest[0, 1], rest[0, 0] + rest[1, 1])
    return np.array([phi, sign * theta, psi])


def is_zyz_singular(rotation: Matrix) -> bool:
    """Whether sin(theta) = 0, so that only phi + psi or phi - psi of zyz angles is determined."""
    return math.hypot(rotation[0, 2], rotation[1, 2]) < _SINGULAR_SINE


def is_rpy_singular(rotation: Matrix) -> bool:
    """Whether cos(pitch) = 0, so that only yaw - roll or yaw + roll is determined."""
    return math.hypot(rotation[0, 0], rotation[1, 0]) < _SINGULAR_SINE


def from_rpy(angles: ArrayLike) -> Matrix:
    """Rotation R = Rz(yaw) Ry(pitch) Rx(roll) of (roll, pitch, yaw) [rad], as in URDF."""
    roll, pitch, yaw = _finite(angles, (3,), "rpy")
    return rotation_z(yaw) @ rotation_y(pitch) @ rotation_x(roll)


def to_rpy(rotation: Matrix, *, flip: bool = False) -> Matrix:
    """Angles (roll, pitch, yaw) [rad] of R = Rz(yaw) Ry(pitch) Rx(roll).

    The branch has pitch in [-pi/2, pi/2]; ``flip`` answers the other one, pi - pitch. Where
    cos(pitch) = 0 only yaw - roll (or yaw + roll) is determined: roll = 0 is chosen.
    """
    R = rotation
    cosine = math.hypot(R[0, 0], R[1, 0])
    if cosine < _SINGULAR_SINE:
        pitch = math.atan2(-R[2, 0], 0.0)
        return np.array([0.0, pitch, math.atan2(-R[0, 1], R[1, 1])])
    sign = -1.0 if flip else 1.0
    pitch = math.atan2(-R[2, 0], sign * cosine)
    yaw = math.atan2(sign * R[1, 0], sign * R[0, 0])
    # Near cos(pitch) = 0 yaw carries noise; roll from what it leaves over makes up for it.
    rest = (rotation_z(yaw) @ rotation_y(pitch)).T @ R
    roll = math.atan2(rest[2, 1] - rest[1, 2], rest[1, 1] + rest[2, 2])
    return np.array([roll, pitch, yaw])


def to_axis_angle(rotation: Matrix) -> tuple[Matrix, float]:
    """Unit axis (3,) and angle in [0, pi] [rad] of a rotation matrix; the axis z where it is I."""
    x, y, z, w = to_quaternion(rotation)
    sine = math.sqrt(x * x + y * y + z * z)
    if sine == 0.0:
        return np.array([0.0, 0.0, 1.0]), 0.0
    return np.array([x, y, z]) / sine, 2.0 * math.atan2(sine, w)


def from_axis_angle(axis: ArrayLike, angle: float) -> Matrix:
    """Rotation by ``angle`` [rad] about ``axis`` (3,), R = I + sin S + (1 - cos) S^2.

    Raises:
        InvalidPose: The axis has no direction.
    """
    a = _finite(axis, (3,), "axis")
    norm = float(np.linalg.norm(a))
    check_axis_length(norm)
    S = skew(a / norm)
    return np.asarray(np.eye(3) + math.sin(angle) * S + (1.0 - math.cos(angle)) * (S @ S))


def rotation_error(rotation: Matrix, target: Matrix) -> Matrix:
    """Rotation vector [rad] that takes ``rotation`` to ``target``, in the outer frame, shape (3,).

    log(target rotation^T), continuous to half a turn.
    """
    x, y, z, w = to_quaternion(target @ rotation.T)
    sine = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 if sine < 1e-12 else 2.0 * math.atan2(sine, w) / sine
    return scale * np.array([x, y, z])


def align_z(axis: ArrayLike) -> Matrix:
    """A rotation whose third column is the unit vector along ``axis`` (3,).

    For +z itself it is the identity, so chains whose axes are z keep their frames.
    """
    z = _finite(axis, (3,), "axis")
    z = z / np.linalg.norm(z)
    # Not z[2] == 1: that is true for tilts up to 1e-8 too.
    if z[0] == 0.0 and z[1] == 0.0 and z[2] > 0.0:
        return np.eye(3)
    helper = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = np.cross(helper, z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def _finite(values: ArrayLike, shape: tuple[int, ...], name: str) -> Matrix:
    array = np.asarray(values, dtype=np.float64)
    if array.shape != shape or not np.isfinite(array).all():
        raise InvalidPose(
            f"{name} must be {' x '.join(map(str, shape))} finite numbers, got shape {array.shape}"
        )
    return array


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
