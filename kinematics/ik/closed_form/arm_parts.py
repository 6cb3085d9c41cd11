"""Shoulder, elbow and wrist of arms: the numbers whose signs are the sides of a configuration.

With unit axes z_i through O_i, and W the wrist centre:

    six revolute joints, axes 2 and 3 parallel, and three with the same shoulder and elbow
        shoulder   (W - O_2) . (z_1 x z_2)          how fast joint 2 raises W along axis 1
        elbow      the elbow's offset from the line of shoulder and wrist, along z_1
        wrist      (z_4 x z_6) . z_5                the sine of joint 5
    two revolute joints, a slide and a spherical wrist: the same shoulder and wrist, no elbow
    a spherical wrist behind any other three joints: its wrist alone
    seven revolute joints, axes 1 to 3 through one point S
        shoulder   (z_1 x z_3) . z_2                the sine of joint 2
        elbow      ((O_4 - S) x (W - O_4)) . z_4    the sine of the bend at axis 4
        wrist      (z_5 x z_7) . z_6, the sine of joint 6; where axes 5 to 7 do not meet
                   (W - S) . (z_5 x z_6), W where axes 5 and 6 meet
    parallel axes, the first two of joints that turn: planar arms and SCARA
        elbow      (W - O_1) x (O_2 - O_1) along z_1

W of a spherical wrist is where its axes meet; of a UR the point where axes 5 and 6 do for the
shoulder and O_4 for the elbow; of a planar arm or SCARA its last axis; of arms with no wrist the
link's origin.

A part is singular where its number vanishes. Names of the sides of six joints are those of "A
geometric approach in solving the inverse kinematics of PUMA robots", IEEE Transactions on Aerospace
and Electronic Systems, 1984.

Distance by which a pose is out of an arm's reach, from the triangle of its links.

Shoulder, elbow and wrist centre W are a triangle with sides a (upper arm) and b (forearm). It
closes where |a - b| <= s <= a + b, with s the distance from the shoulder to W: |D| <= 1 with
D = (s^2 - a^2 - b^2) / (2 a b).
"""

from collections.abc import Collection, Mapping
from enum import Enum
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array
from kinematics.forward import forward, joint_frames
from kinematics.ik.closed_form.structure import Structure, structure
from kinematics.ik.numeric.numeric import AXES, Axis
from kinematics.model.chain import Chain, JointType

_PARTS = ("shoulder", "elbow", "wrist")


class ArmSides(NamedTuple):
    """Sides of an arm in one configuration; None where the part is singular, or it has none.

    Args:
        shoulder: "right" where joint 2 raises the wrist centre along axis 1, else "left"; of a
            spherical shoulder "no flip" where the sine of joint 2 is positive, else "flip".
        elbow: "up" where the elbow is above the line from shoulder to wrist, along axis 1, else
            "down"; of a planar arm "left" or "right" of that line, seen against axis 1; of seven
            joints "no flip" where the sine of the bend about axis 4 is positive, else "flip".
        wrist: "no flip" where the sine of its middle joint is positive, else "flip".
        singular: Parts that are singular, of "shoulder", "elbow" and "wrist".
    """

    shoulder: str | None
    elbow: str | None
    wrist: str | None
    singular: tuple[str, ...]


def arm_sides(chain: Chain, q: ArrayLike, link: str | None = None) -> list[ArmSides] | None:
    """Sides of an arm in several configurations; None for arms of another shape.

    Args:
        chain: The robot.
        q: Configurations, shape (m, n) [rad or m].
        link: The link that inverse kinematics is for; the tip where none is named.

    Raises:
        InvalidRobotState: Wrong length or not finite.
        InvalidLinkName: No such link.
    """
    shape = arm_shape(chain, link)
    if shape is None:
        return None
    axes = lines(chain, chain.configuration(q).reshape(-1, chain.n), link)
    parts = arm_parts(shape, axes)
    sides = []
    for i in range(len(axes.z)):
        names: dict[str, str | None] = dict.fromkeys(_PARTS)
        singular = tuple(name for name, part in parts.items() if part.size[i] <= SINGULAR)
        for name, part in parts.items():
            if name not in singular:
                names[name] = part.names[0] if part.side[i] > 0.0 else part.names[1]
        sides.append(ArmSides(names["shoulder"], names["elbow"], names["wrist"], singular))
    return sides


#: Sines of angles and lengths [m] below this are singular, or axes parallel or meeting.
SINGULAR = 1e-6
#: Which joints turn, of an arm whose third one slides.
_SLIDING_ELBOW = [True, True, False, True, True, True]
_RAISES = ("right", "left")
_HEIGHT = ("up", "down")
_SINE = ("no flip", "flip")
_TURN = ("left", "right")


class ArmShape(Enum):
    """Shapes of arms whose sides are known."""

    SPHERICAL_WRIST = "six joints, axes 2 and 3 parallel, spherical wrist"
    PARALLEL_WRIST = "six joints, axes 2 to 4 parallel"
    SLIDING_ELBOW = "two turning joints, a sliding one and a spherical wrist"
    TWO_SPHERES = "seven joints, spherical shoulder and wrist"
    SPHERICAL_SHOULDER = "seven joints, spherical shoulder"
    ARTICULATED = "three joints, axes 2 and 3 parallel"
    PLANAR = "parallel axes, the first two of joints that turn"
    WRIST_ALONE = "six joints, the last three axes through one point"


class Part(NamedTuple):
    """A part of an arm in m configurations.

    Args:
        side: Number whose sign is the side, shape (m,).
        size: 0 where the part is singular, shape (m,) [m, or the sine of an angle].
        names: The sides for a positive and for a negative sign.
    """

    side: Array
    size: Array
    names: tuple[str, str]


class Lines(NamedTuple):
    """Joint axes of m configurations.

    Args:
        z: Directions, shape (m, k, 3), of the k joints up to the link.
        origins: Points on the axes, shape (m, k, 3) [m].
        end: Origin of the link, shape (m, 3) [m].
    """

    z: Array
    origins: Array
    end: Array


def lines(chain: Chain, q: Array, link: str | None = None) -> Lines:
    """Axes of the joints up to a link, and its origin.

    Args:
        chain: The robot.
        q: Configurations, shape (m, n) [rad or m].
        link: The link; the tip where none is named.
    """
    frames = joint_frames(chain, q).reshape(-1, chain.body_count, 4, 4)
    carrier = chain.link(link or chain.tip_link)
    frames = frames[:, : carrier.joint + 1]
    end = frames[:, -1] @ carrier.T_joint_link[:, 3]
    return Lines(frames[:, :, :3, 2], frames[:, :, :3, 3], end[:, :3])


@lru_cache(maxsize=64)
def arm_shape(chain: Chain, link: str | None = None) -> ArmShape | None:
    """The shape of an arm up to a link (the tip); None where its sides are not known."""
    count = chain.link(link or chain.tip_link).joint + 1
    if count < 2:
        return None
    z, origins, _ = (part[0] for part in lines(chain, np.zeros((1, chain.n)), link))
    turns = (chain.joint_types[:count] == JointType.REVOLUTE).tolist()
    if all(_parallel(z[0], axis) for axis in z):
        return ArmShape.PLANAR if _is_planar(turns) else None
    if count == 3:
        return ArmShape.ARTICULATED if all(turns) and _parallel(z[1], z[2]) else None
    if turns == _SLIDING_ELBOW:
        bent = not _parallel(z[0], z[1]) and abs(float(z[1] @ z[2])) <= SINGULAR
        if bent and _meet(z[3:], origins[3:]):
            return ArmShape.SLIDING_ELBOW
    shape = _shape_of_form(structure(chain, link), z, origins)
    if shape is None and count == 6 and all(turns[3:]) and _meet(z[3:], origins[3:]):
        return ArmShape.WRIST_ALONE
    return shape


def _shape_of_form(form: Structure | None, z: Array, origins: Array) -> ArmShape | None:
    """The shape of an arm of six or seven revolute joints from its closed form.

    Args:
        form: The closed form; None where it has none.
        z: Axes at q = 0, shape (n, 3).
        origins: Points on them, shape (n, 3) [m].
    """
    if form is None:
        return None
    if form.kind == "redundant":
        return ArmShape.TWO_SPHERES
    if form.redundant:
        meet = _meet(z[:3], origins[:3]) and _meet(z[4:6], origins[4:6])
        return ArmShape.SPHERICAL_SHOULDER if form.locked == len(z) - 1 and meet else None
    if form.reverse or not _parallel(z[1], z[2]):
        return None
    if form.kind == "spherical":
        return ArmShape.SPHERICAL_WRIST
    return ArmShape.PARALLEL_WRIST if _parallel(z[1], z[3]) else None


def arm_parts(shape: ArmShape, axes: Lines) -> Mapping[str, Part]:
    """The parts of an arm, "shoulder", "elbow" and "wrist" as far as it has them.

    Args:
        shape: Shape of the arm.
        axes: Axes in m configurations.
    """
    z, o = axes.z, axes.origins
    if shape is ArmShape.PLANAR:
        return {"elbow": _planar_elbow(axes)}
    if shape in (ArmShape.TWO_SPHERES, ArmShape.SPHERICAL_SHOULDER):
        return _seven_joints(shape, axes)
    wrist = {"wrist": _part(dot(cross(z[:, 3], z[:, 5]), z[:, 4]), _SINE)} if z.shape[1] > 5 else {}
    if shape is ArmShape.WRIST_ALONE:
        return wrist
    shoulder_end, elbow_end = wrist_centers(shape, axes)
    parts = {"shoulder": _part(dot(shoulder_end - o[:, 1], cross(z[:, 0], z[:, 1])), _RAISES)}
    if shape is not ArmShape.SLIDING_ELBOW:
        height, bend = _elbow(z[:, 0], z[:, 1], o[:, 2] - o[:, 1], elbow_end - o[:, 1])
        parts["elbow"] = Part(height, bend, _HEIGHT)
    return parts | wrist


def wrist_centers(shape: ArmShape, axes: Lines) -> tuple[Array, Array]:
    """The points W of shoulder and elbow, both (m, 3) [m]."""
    z, o = axes.z, axes.origins
    if shape is ArmShape.ARTICULATED:
        return axes.end, axes.end
    if shape is ArmShape.PLANAR:
        last = axes.end if o.shape[1] == 2 else o[:, -1]
        return last, last
    first = 3 if shape in (ArmShape.SPHERICAL_WRIST, ArmShape.SLIDING_ELBOW) else 4
    W = meeting(o[:, first], z[:, first], o[:, first + 1], z[:, first + 1])
    return W, o[:, 3] if shape is ArmShape.PARALLEL_WRIST else W


def _seven_joints(shape: ArmShape, axes: Lines) -> Mapping[str, Part]:
    z, o = axes.z, axes.origins
    W, _ = wrist_centers(shape, axes)
    S = meeting(o[:, 0], z[:, 0], o[:, 1], z[:, 1])
    upper, fore = across(o[:, 3] - S, z[:, 3]), across(W - o[:, 3], z[:, 3])
    lengths = np.linalg.norm(upper, axis=1) * np.linalg.norm(fore, axis=1)
    bend = dot(cross(upper, fore), z[:, 3]) / np.maximum(lengths, SINGULAR**2)
    if shape is ArmShape.TWO_SPHERES:
        wrist = dot(cross(z[:, 4], z[:, 6]), z[:, 5])
    else:
        wrist = dot(W - S, cross(z[:, 4], z[:, 5]))
    return {
        "shoulder": _part(dot(cross(z[:, 0], z[:, 2]), z[:, 1]), _SINE),
        "elbow": _part(bend, _SINE),
        "wrist": _part(wrist, _SINE),
    }


def _planar_elbow(axes: Lines) -> Part:
    z1, o = axes.z[:, 0], axes.origins
    W, _ = wrist_centers(ArmShape.PLANAR, axes)
    upper, whole = across(o[:, 1] - o[:, 0], z1), across(W - o[:, 0], z1)
    return Part(dot(cross(whole, upper), z1), _bend(upper, whole), _TURN)


def _part(values: Array, names: tuple[str, str]) -> Part:
    return Part(values, np.abs(values), names)


def _elbow(z1: Array, z2: Array, upper: Array, whole: Array) -> tuple[Array, Array]:
    """Offset of the elbow from the line to the wrist along axis 1 [m], and the sine of its bend.

    Args:
        z1: Axis 1, shape (m, 3).
        z2: Axis 2, shape (m, 3).
        upper: Vector from axis 2 to axis 3, shape (m, 3) [m].
        whole: Vector from axis 2 to the wrist, shape (m, 3) [m].
    """
    # Both in the plane across axis 2, in which the elbow bends.
    a, c = across(upper, z2), across(whole, z2)
    line = c / np.maximum(np.linalg.norm(c, axis=1), SINGULAR)[:, None]
    return dot(a - dot(a, line)[:, None] * line, z1), _bend(a, c)


def _bend(upper: Array, whole: Array) -> Array:
    """The sine of the angle between upper arm and forearm, shape (m,)."""
    fore = whole - upper
    lengths = np.linalg.norm(upper, axis=1) * np.linalg.norm(fore, axis=1)
    sines: Array = np.linalg.norm(cross(upper, fore), axis=1) / np.maximum(lengths, SINGULAR**2)
    return sines


def _is_planar(turns: list[bool]) -> bool:
    """Whether joints on parallel axes are those of a planar arm or a SCARA."""
    return all(turns[:2]) and turns[2:] in ([], [True], [True, False], [False, True])


def _parallel(u: Array, v: Array) -> bool:
    return float(np.linalg.norm(cross(u, v))) <= SINGULAR


def _meet(z: Array, origins: Array) -> bool:
    """Whether neighbouring axes are not parallel and all pass through the first crossing."""
    if any(_parallel(a, b) for a, b in pairwise(z)):
        return False
    point = meeting(origins[:1], z[:1], origins[1:2], z[1:2])[0]
    away = np.linalg.norm(cross(point - origins, z), axis=1)
    return bool((away <= SINGULAR).all())


def across(v: Array, unit: Array) -> Array:
    """The parts of vectors across unit vectors, shape (m, 3)."""
    return np.asarray(v - dot(v, unit)[:, None] * unit)


def meeting(p: Array, u: Array, s: Array, v: Array) -> Array:
    """Points of lines p + t u that are nearest to lines s + t v, all of shape (m, 3)."""
    normal = cross(u, v)
    t = dot(cross(s - p, v), normal) / dot(normal, normal)
    return np.asarray(p + t[:, None] * u)


def cross(a: Array, b: Array) -> Array:
    """Vector products along the last axis; numpy's own costs three times as much for a few."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    u, v, w = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def dot(a: Array, b: Array) -> Array:
    """Scalar products of rows, shape (m,)."""
    return np.asarray((a * b).sum(axis=1))


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
    # Takes points of the last body at q = 0 into the link's frame.
    T = np.asarray(target) @ np.linalg.inv(forward(chain, np.zeros(chain.n), link))
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
