"""Sides of shoulder, elbow and wrist that a configuration has, and which of them are singular.

For six revolute joints with parallel axes 2 and 3, the shape of most arms. With unit axes z_i
through O_i, and W the wrist centre (of a spherical wrist the point where axes 4 to 6 meet, of a UR
that where axes 5 and 6 do for the shoulder and O_4 for the elbow):

    shoulder   (W - O_2) . (z_1 x z_2)          how fast joint 2 raises W along axis 1
    elbow      the elbow's offset from the line of shoulder and wrist, along z_1
    wrist      (z_4 x z_6) . z_5                the sine of joint 5

The shoulder is singular where W lies in the plane of axis 1 that holds axis 2, the elbow where O_2,
O_3 and W are in line, the wrist where axes 4 and 6 are parallel. Names of the sides are those of
"A geometric approach in solving the inverse kinematics of PUMA robots", IEEE Transactions on
Aerospace and Electronic Systems, 1984.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array
from kinematics.chain import Chain
from kinematics.forward import joint_frames
from kinematics.ik.structure import structure

#: Sines of angles and lengths [m] below this are singular.
SINGULAR = 1e-6


class ArmSides(NamedTuple):
    """Sides of an arm in one configuration; None where the part is singular.

    Args:
        shoulder: "right" where joint 2 raises the wrist centre along axis 1, else "left".
        elbow: "up" where the elbow is above the line from shoulder to wrist, along axis 1, else
            "down".
        wrist: "no flip" where the sine of joint 5 is positive, else "flip".
        singular: Those of "shoulder", "elbow" and "wrist" that are singular.
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
    form = structure(chain, link)
    if form is None or form.redundant or form.reverse or form.joints != 6:
        return None
    frames = joint_frames(chain, q).reshape(-1, chain.n, 4, 4)
    if not len(frames):
        return []
    z, origins = frames[:, :, :3, 2], frames[:, :, :3, 3]
    if float(np.linalg.norm(_cross(z[0, 1], z[0, 2]))) > SINGULAR:
        return None
    if form.kind == "spherical":
        hand = elbow_end = _meeting(origins[:, 3], z[:, 3], origins[:, 4], z[:, 4])
    elif float(np.linalg.norm(_cross(z[0, 1], z[0, 3]))) <= SINGULAR:
        hand, elbow_end = _meeting(origins[:, 4], z[:, 4], origins[:, 5], z[:, 5]), origins[:, 3]
    else:
        return None
    rows = np.column_stack([
        _dot(hand - origins[:, 1], _cross(z[:, 0], z[:, 1])),
        *_elbow(z[:, 0], z[:, 1], origins[:, 2] - origins[:, 1], elbow_end - origins[:, 1]),
        _dot(_cross(z[:, 3], z[:, 5]), z[:, 4]),
    ])  # fmt: skip
    return [_sides(*row) for row in rows]


def _sides(shoulder: float, elbow: float, bend: float, wrist: float) -> ArmSides:
    sizes = {"shoulder": shoulder, "elbow": bend, "wrist": wrist}
    singular = tuple(name for name, size in sizes.items() if abs(size) <= SINGULAR)
    return ArmSides(
        None if "shoulder" in singular else "right" if shoulder > 0.0 else "left",
        None if "elbow" in singular else "up" if elbow > 0.0 else "down",
        None if "wrist" in singular else "no flip" if wrist > 0.0 else "flip",
        singular,
    )


def _elbow(z1: Array, z2: Array, upper: Array, whole: Array) -> tuple[Array, Array]:
    """Offset of the elbow from the line to the wrist along axis 1 [m], and the sine of its bend.

    Args:
        z1: Axis 1, shape (m, 3).
        z2: Axis 2, shape (m, 3).
        upper: From axis 2 to axis 3, shape (m, 3) [m].
        whole: From axis 2 to the wrist, shape (m, 3) [m].
    """
    # Both in the plane across axis 2, in which the elbow bends.
    a = upper - _dot(upper, z2)[:, None] * z2
    c = whole - _dot(whole, z2)[:, None] * z2
    line = c / np.maximum(np.linalg.norm(c, axis=1), SINGULAR)[:, None]
    offset = a - _dot(a, line)[:, None] * line
    lengths = np.linalg.norm(a, axis=1) * np.linalg.norm(c - a, axis=1)
    bend = np.linalg.norm(_cross(a, c - a), axis=1) / np.maximum(lengths, SINGULAR**2)
    return _dot(offset, z1), bend


def _meeting(p: Array, u: Array, s: Array, v: Array) -> Array:
    """Points of lines p + t u that are nearest to lines s + t v, all of shape (m, 3)."""
    across = _cross(u, v)
    t = _dot(_cross(s - p, v), across) / _dot(across, across)
    return np.asarray(p + t[:, None] * u)


def _cross(a: Array, b: Array) -> Array:
    """Vector products along the last axis; numpy's own costs three times as much for a few."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    u, v, w = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def _dot(a: Array, b: Array) -> Array:
    return np.asarray((a * b).sum(axis=1))


def out_of_reach(chain: Chain, target: ArrayLike, link: str | None = None) -> float | None:
    """Distance by which a target's wrist centre is too far away or too near [m], 0 within reach.

    The triangle of upper arm, forearm and wrist centre closes where |D| <= 1, with
    D = (s^2 - a^2 - b^2) / (2 a b): a and b are the lengths of the links and s is the distance from
    axis 2 to W, all in the plane across axis 2. None where the arm has no spherical wrist, axes 2
    and 3 are not parallel, or axis 2 does not pass through axis 1 at a right angle.

    Args:
        chain: The robot.
        target: T_base_link, shape (4, 4).
        link: The link to bring there; the tip where none is named.

    Raises:
        InvalidLinkName: No such link.
    """
    sides = arm_sides(chain, np.zeros((1, chain.n)), link)
    form = structure(chain, link)
    if sides is None or form is None or form.kind != "spherical":
        return None
    frames = joint_frames(chain, np.zeros(chain.n))
    z, origins = frames[:, :3, 2], frames[:, :3, 3]
    W = _meeting(origins[3:4], z[3:4], origins[4:5], z[4:5])[0]
    if abs(float(z[0] @ z[1])) > SINGULAR:
        return None
    carrier = chain.link(link or chain.tip_link)
    local = np.linalg.solve(frames[5] @ carrier.T_joint_link, np.array([*W, 1.0]))
    goal = (np.asarray(target) @ local)[:3] - origins[0]
    depth = float((W - origins[0]) @ z[1])  # along axis 2, the same in every configuration
    height = float(goal @ z[0])
    around = float(np.sum(goal * goal)) - height**2 - depth**2
    if around < 0.0:
        return abs(depth) - float(np.sqrt(around + depth**2))
    front, x = float(np.sqrt(around)), _cross(z[1], z[0])
    start, rise = float((origins[1] - origins[0]) @ x), float((origins[1] - origins[0]) @ z[0])
    upper = origins[2] - origins[1] - ((origins[2] - origins[1]) @ z[1]) * z[1]
    fore = W - origins[2] - ((W - origins[2]) @ z[1]) * z[1]
    a, b = float(np.linalg.norm(upper)), float(np.linalg.norm(fore))
    spans = [float(np.hypot(side * front - start, height - rise)) for side in (1.0, -1.0)]
    return max(0.0, min(max(s - a - b, abs(a - b) - s) for s in spans))
