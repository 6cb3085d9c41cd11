"""Distance by which a pose is out of an arm's reach, from the triangle of its links.

Shoulder, elbow and wrist centre W are a triangle with sides a (upper arm) and b (forearm). It
closes where |a - b| <= s <= a + b, with s the distance from the shoulder to W: |D| <= 1 with
D = (s^2 - a^2 - b^2) / (2 a b).
"""

from collections.abc import Collection

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.ik.closed_form.arm_parts import (
    SINGULAR,
    ArmShape,
    Lines,
    across,
    arm_shape,
    cross,
    lines,
    meeting,
    wrist_centers,
)
from kinematics.ik.numeric.numeric import AXES, Axis
from kinematics.model.chain import Chain

#: Shapes whose joint 2 turns the arm in a plane that holds axis 1, or is offset from it.
_SHOULDER_PLANE = (ArmShape.SPHERICAL_WRIST, ArmShape.ARTICULATED, ArmShape.SLIDING_ELBOW)


def out_of_reach(
    chain: Chain,
    target: ArrayLike,
    link: str | None = None,
    axes: Collection[Axis] = AXES,
) -> float | None:
    """Distance by which a target's wrist centre is too far away or too near [m], 0 within reach.

    Limits of joints are not regarded. None for arms of other shapes, where axis 2 does not stand at
    a right angle to axis 1, and where the axes that count do not determine W.

    Args:
        chain: The robot.
        target: T_base_link, shape (4, 4).
        link: The link to bring there; the tip where none is named.
        axes: The axes of the target's frame that count.

    Raises:
        InvalidLinkName: No such link.
    """
    shape = arm_shape(chain, link)
    if shape is None or shape is ArmShape.WRIST_ALONE:
        return None
    home = lines(chain, np.zeros((1, chain.n)), link)
    T = np.asarray(target) @ _home_inverse(chain, link)
    if set(axes) != set(AXES):
        return _of_positions(shape, home, np.asarray(target, dtype=np.float64), T, axes)
    if shape in _SHOULDER_PLANE:
        return _in_shoulder_plane(shape, home, T)
    if shape is ArmShape.PLANAR:
        return _in_plane(home, T)
    if shape is ArmShape.PARALLEL_WRIST:
        return _before_parallel_wrist(home, T)
    return _from_spherical_shoulder(shape, home, T)


def _of_positions(
    shape: ArmShape, home: Lines, target: Array, T: Array, axes: Collection[Axis]
) -> float | None:
    """The distance where not all axes count, of arms whose W is the link's origin."""
    free = [k for k, axis in enumerate("xyz") if axis not in axes]
    z = home.z[0]
    if shape is ArmShape.ARTICULATED and not free:
        return _in_shoulder_plane(shape, home, T)
    if shape is not ArmShape.PLANAR or len(z) != 2 or len(free) > 1:
        return None
    if not free:
        return _in_plane(home, T)
    # The one axis that does not count must be across the plane of the arm.
    is_normal = float(np.linalg.norm(cross(target[:3, free[0]], z[0]))) <= SINGULAR
    return _in_plane(home, T, is_flat=True) if is_normal else None


def _home_inverse(chain: Chain, link: str | None) -> Array:
    """T_link_base at q = 0: it takes points of the last body at q = 0 into the link's frame."""
    return np.asarray(np.linalg.inv(forward(chain, np.zeros(chain.n), link)))


def _moved(T: Array, point: Array) -> Array:
    """Place of a point of the last body at q = 0 when the link is at the target, (3,) [m]."""
    return np.asarray(T[:3, :3] @ point + T[:3, 3])


def _gap(s: float, a: float, b: float) -> float:
    """Distance by which a triangle of sides a and b can not reach a distance s [m]."""
    return max(0.0, s - a - b, abs(a - b) - s)


def _in_shoulder_plane(shape: ArmShape, home: Lines, T: Array) -> float | None:
    z, o = home.z[0], home.origins[0]
    W = wrist_centers(shape, home)[0][0]
    if abs(float(z[0] @ z[1])) > SINGULAR:
        return None
    goal = _moved(T, W) - o[0]
    depth = float((W - o[0]) @ z[1])  # along axis 2, the same in every configuration
    height = float(goal @ z[0])
    around = float(np.sum(goal * goal)) - height**2 - depth**2
    if around < -(SINGULAR**2):
        return abs(depth) - float(np.sqrt(max(0.0, around + depth**2)))
    if shape is ArmShape.SLIDING_ELBOW:
        return 0.0
    front, x = float(np.sqrt(max(0.0, around))), cross(z[1], z[0])
    start, rise = float((o[1] - o[0]) @ x), float((o[1] - o[0]) @ z[0])
    a = float(np.linalg.norm(across((o[2] - o[1])[None], z[1][None])))
    b = float(np.linalg.norm(across((W - o[2])[None], z[1][None])))
    spans = [float(np.hypot(side * front - start, height - rise)) for side in (1.0, -1.0)]
    return min(_gap(s, a, b) for s in spans)


def _in_plane(home: Lines, T: Array, *, is_flat: bool = False) -> float:
    z, o = home.z[0], home.origins[0]
    W = wrist_centers(ArmShape.PLANAR, home)[0][0]
    plane = z[:1]
    a, b = (float(np.linalg.norm(across(v[None], plane))) for v in (o[1] - o[0], W - o[1]))
    goal = _moved(T, W) - o[0]
    gap = _gap(float(np.linalg.norm(across(goal[None], plane))), a, b)
    if is_flat or len(z) > 3:  # a SCARA's slide goes along the axes
        return gap
    return float(np.hypot(gap, float((goal - (W - o[0])) @ z[0])))


def _before_parallel_wrist(home: Lines, T: Array) -> float | None:
    """Of a UR: axis 1 has W on either side, and axis 5 across axes 4 and 6 points either way."""
    z, o = home.z[0], home.origins[0]
    right = [abs(float(z[i] @ z[j])) <= SINGULAR for i, j in ((0, 1), (3, 4), (4, 5))]
    V = meeting(o[4:5], z[4:5], o[5:6], z[5:6])[0]
    offset = across((o[1] - o[0])[None], z[0][None])[0]
    meets = abs(float((V - o[3]) @ cross(z[3], z[4]))) <= SINGULAR
    if not all(right) or not meets or float(np.linalg.norm(cross(offset, z[1]))) > SINGULAR:
        return None
    goal, sixth = _moved(T, V) - o[0], T[:3, :3] @ z[5]
    depth, height = float((V - o[0]) @ z[1]), float(goal @ z[0])
    flat = goal - height * z[0]
    distance = float(np.linalg.norm(flat))
    if distance < abs(depth):
        return abs(depth) - distance
    a, b = (float(np.linalg.norm(across(v[None], z[1:2]))) for v in (o[2] - o[1], o[3] - o[2]))
    along = float((V - o[3]) @ z[4])
    gaps = []
    for side in (1.0, -1.0):
        front = side * np.sqrt(max(0.0, distance**2 - depth**2))
        e = flat / max(distance, SINGULAR)
        n = (depth * e + front * cross(z[0], e)) / max(distance, SINGULAR)
        fifth = cross(n, sixth)
        size = float(np.linalg.norm(fifth))
        if size <= SINGULAR:
            return None  # the wrist may turn freely
        start = (o[1] - o[0]) @ z[0] * z[0]
        for sign in (1.0, -1.0):
            elbow_end = goal - sign * along * fifth / size - start
            gaps.append(_gap(float(np.linalg.norm(across(elbow_end[None], n[None]))), a, b))
    return min(gaps)


def _from_spherical_shoulder(shape: ArmShape, home: Lines, T: Array) -> float:
    z, o = home.z[0], home.origins[0]
    S = meeting(o[0:1], z[0:1], o[1:2], z[1:2])[0]
    W = wrist_centers(shape, home)[0][0]
    a, b = (float(np.linalg.norm(across(v[None], z[3:4]))) for v in (o[3] - S, W - o[3]))
    if shape is ArmShape.TWO_SPHERES:
        return _gap(float(np.linalg.norm(_moved(T, W) - S)), a, b)
    # W circles about axis 7: of its distances to S the nearest to what the links span counts.
    axis, foot = T[:3, :3] @ z[6], _moved(T, o[6] + ((W - o[6]) @ z[6]) * z[6])
    radius = float(np.linalg.norm(across((W - o[6])[None], z[6:7])))
    height = float((S - foot) @ axis)
    away = float(np.linalg.norm(across((S - foot)[None], axis[None])))
    near, far = np.hypot(away - radius, height), np.hypot(away + radius, height)
    return max(0.0, float(near) - a - b, abs(a - b) - float(far))
