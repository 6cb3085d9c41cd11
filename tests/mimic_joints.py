"""A six-axis arm with joints off its chain that mimic joints of it, as palletisers have them.

A crank beside the upper arm turns with it, and the rod on the crank turns back, so that it keeps
its direction; a cover counter-rotates on the fore arm, with a flap that mimics the cover; a piston
slides on the upper arm with the elbow; a drum turns behind the base.
"""

from functools import cache

import numpy as np

from kinematics.arrays import Array
from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from obstacles.robots.robot_geometry import RobotGeometry, robot_geometry

#: Joints of the chain: name, parent, child, origin, axis, lowest and highest position.
ARM = (
    ("j1", "base", "turret", "0 0 0.3", "0 0 1", -2.8, 2.8),
    ("j2", "turret", "upper", "0.15 0 0.25", "0 1 0", -1.4, 1.7),
    ("j3", "upper", "fore", "0 0 0.7", "0 1 0", -2.2, 1.2),
    ("j4", "fore", "wrist", "0.35 0 0.1", "1 0 0", -3.0, 3.0),
    ("j5", "wrist", "palm", "0.35 0 0", "0 1 0", -2.0, 2.0),
    ("j6", "palm", "flange", "0.1 0 0", "1 0 0", -6.0, 6.0),
)
#: Mimic joints: name, type, parent, child, origin, axis, leader, multiplier, offset.
MIMIC_JOINTS = (
    ("crank_joint", "revolute", "turret", "crank", "-0.1 0.22 0.25", "0 1 0", "j2", 1.0, 0.0),
    ("rod_joint", "revolute", "crank", "rod", "0 0 0.6", "0 1 0", "j2", -1.0, 0.0),
    ("cover_joint", "continuous", "fore", "cover", "0.2 0 0.1", "1 0 0.2", "j4", -0.5, 0.2),
    ("flap_joint", "revolute", "cover", "flap", "0.05 0 0.16", "0 1 0", "cover_joint", 0.3, -0.1),
    ("piston_joint", "prismatic", "upper", "piston", "0 -0.2 0.5", "0 0.1 1", "j3", 0.08, 0.05),
    ("drum_joint", "continuous", "base", "drum", "-0.45 0 0.3", "0 1 0", "j1", 2.0, 0.0),
)
_SOLIDS = {
    "base": ("0 0 0.12", '<cylinder radius="0.2" length="0.24"/>'),
    "turret": ("0 0 0.1", '<box size="0.3 0.25 0.3"/>'),
    "upper": ("0 0 0.35", '<box size="0.14 0.16 0.6"/>'),
    "fore": ("0.1 0 0.08", '<box size="0.4 0.16 0.18"/>'),
    "wrist": ("0.15 0 0", '<cylinder radius="0.06" length="0.2"/>'),
    "palm": ("0.02 0 0", '<sphere radius="0.07"/>'),
    "flange": ("0.08 0 0", '<box size="0.12 0.14 0.08"/>'),
    "crank": ("0 0 0.3", '<box size="0.06 0.04 0.6"/>'),
    "rod": ("0.2 0 0", '<box size="0.45 0.04 0.05"/>'),
    "cover": ("0 0 0.13", '<box size="0.1 0.2 0.04"/>'),
    "flap": ("0.05 0 0.03", '<box size="0.12 0.1 0.03"/>'),
    "piston": ("0 0 0.15", '<cylinder radius="0.03" length="0.3"/>'),
    "drum": ("0.1 0 0", '<box size="0.25 0.1 0.08"/>'),
}


def urdf(mimic_joints: tuple[tuple[object, ...], ...] = MIMIC_JOINTS, limits: str = "") -> str:
    """The arm as a URDF.

    Args:
        mimic_joints: Those that it has.
        limits: Attributes of the mimic joints' limits.
    """
    used = {"base", *(joint[2] for joint in ARM), *(joint[3] for joint in mimic_joints)}
    links = "".join(
        f'<link name="{name}"><inertial><mass value="2"/><origin xyz="{origin}"/><inertia ixx="0.1"'
        ' iyy="0.2" izz="0.15" ixy="0" ixz="0" iyz="0"/></inertial><collision>'
        f'<origin xyz="{origin}"/><geometry>{solid}</geometry></collision></link>'
        for name, (origin, solid) in _SOLIDS.items()
        if name in used
    )
    joints = "".join(
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{origin}"/><axis xyz="{axis}"/><limit lower="{low}" upper="{high}" '
        'velocity="2" acceleration="6" jerk="60" effort="500"/></joint>'
        for name, parent, child, origin, axis, low, high in ARM
    )
    joints += "".join(
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{origin}" rpy="0.1 0 0"/><axis xyz="{axis}"/>'
        f'<limit {limits or _wide(str(kind))} velocity="0" effort="0"/>'
        f'<mimic joint="{leader}" multiplier="{multiplier}" offset="{offset}"/></joint>'
        for name, kind, parent, child, origin, axis, leader, multiplier, offset in mimic_joints
    )
    return f'<robot name="palletiser">{links}{joints}</robot>'


def _wide(kind: str) -> str:
    return "" if kind == "continuous" else 'lower="-9" upper="9"'


def mimic_positions(q: Array) -> dict[str, Array]:
    """Positions of the mimic joints at q (..., 6), by name, written out once more [rad or m]."""
    cover = -0.5 * q[..., 3] + 0.2
    return {
        "crank_joint": q[..., 1],
        "rod_joint": -q[..., 1],
        "cover_joint": cover,
        "flap_joint": 0.3 * cover - 0.1,
        "piston_joint": 0.08 * q[..., 2] + 0.05,
        "drum_joint": 2.0 * q[..., 0],
    }


def configurations(count: int, seed: int) -> Array:
    """Configurations within the limits, shape (count, 6) [rad]."""
    lower, upper = np.array([joint[5] for joint in ARM]), np.array([joint[6] for joint in ARM])
    return np.random.default_rng(seed).uniform(lower, upper, (count, 6))


@cache
def mimic_robot() -> RobotGeometry:
    """The arm with its solids, its tip the flange."""
    description = parse_urdf(urdf())
    return robot_geometry(serial_chain(description, tip_link="flange"), description)
