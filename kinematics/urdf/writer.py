"""URDF and SRDF of a chain: joints with limits, links with inertias and solids, named states.

Numbers are written with all their digits: a chain that is read back has the same poses to rounding.
The tree is one path from the base to the tip, so that the reader finds both ends by itself.
"""

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidRobotDescription
from kinematics.model.chain import Chain, Inertia, JointType, Link
from kinematics.pose import inverse, to_rpy
from kinematics.readers.xml_reader import Element, children, read_robot, single, tostring
from kinematics.tree.description import (
    CapsuleGeometry,
    CollisionElement,
    CylinderGeometry,
    Geometry,
    SphereGeometry,
)

#: Reasons as MoveIt's files have them; another reason is written as it is.
_REASONS = {
    "adjacent": "Adjacent",
    "always": "Default",
    "same body": "Adjacent",
    "srdf": "User",
}
#: The group of the chain.
GROUP = "arm"

# Limits of a joint in URDF; the last two are written where they are known, as drivers do.
_QUANTITIES = ("effort", "velocity", "acceleration", "jerk")

# Attributes of <inertia> with their places in the tensor.
_TENSOR = (
    ("ixx", 0, 0),
    ("ixy", 0, 1),
    ("ixz", 0, 2),
    ("iyy", 1, 1),
    ("iyz", 1, 2),
    ("izz", 2, 2),
)


def urdf_text(
    chain: Chain,
    solids: Mapping[str, Sequence[CollisionElement]] | None = None,
    notes: Sequence[str] = (),
) -> str:
    """The URDF of a chain whose links follow each other, as those of tables do.

    URDF has no gravity and no motor inertia: comments name them.

    Args:
        chain: The robot; every joint carries at least one link.
        solids: Spheres, capsules and cylinders by the name of the link that carries them.
        notes: Comments at the head of the file.

    Raises:
        InvalidRobotDescription: A joint carries no link, so nothing can hang on it.
    """
    bodies = [f"  <!-- {note.replace('--', '- -')} -->" for note in (*notes, *_omissions(chain))]
    solids = solids or {}
    last, T_base_last = chain.root_link, np.eye(4)
    base = chain.link(chain.root_link)
    bodies.append(_link(base.name, base.inertia, solids.get(base.name, ())))
    for i in range(chain.n):
        name, frame = chain.joint_names[i], f"{chain.joint_names[i]}_frame"
        origin = inverse(T_base_last) @ chain.offsets[i]
        bodies += [_link(frame, None, ()), *_moving_joint(chain, i, last, frame, origin)]
        carried = [link for link in chain.links if link.joint == i]
        if not carried:
            raise InvalidRobotDescription(f"joint {name!r} carries no link")
        last, T_base_last = frame, np.eye(4)
        for link in carried:
            bodies += _fixed_link(link, last, inverse(T_base_last), solids)
            last, T_base_last = link.name, link.T_joint_link
    robot = f"<robot name={_quoted(chain.name or 'robot')}>"
    return "\n".join(['<?xml version="1.0"?>', robot, *bodies, "</robot>", ""])


def _omissions(chain: Chain) -> list[str]:
    """Comments on values of a chain that URDF has no place for."""
    gravity = ", ".join(repr(float(value)) for value in chain.gravity)
    comments = [f"gravity in the base frame [m/s^2]: {gravity}"]
    if chain.motor_inertia.any():
        inertias = ", ".join(repr(float(value)) for value in chain.motor_inertia)
        comments.append(f"motor inertias at the joints: {inertias}")
    return comments


def _fixed_link(
    link: Link, parent: str, T_parent: Array, solids: Mapping[str, Sequence[CollisionElement]]
) -> list[str]:
    """A link on a fixed joint: its pose in the joint's frame, seen from the link before."""
    return [
        _link(link.name, link.inertia, solids.get(link.name, ())),
        f'  <joint name={_quoted(f"{link.name}_mount")} type="fixed">',
        f"    <parent link={_quoted(parent)}/><child link={_quoted(link.name)}/>",
        f"    {_origin(T_parent @ link.T_joint_link)}",
        "  </joint>",
    ]


def _moving_joint(chain: Chain, i: int, parent: str, child: str, origin: Array) -> list[str]:
    slides = chain.joint_types[i] == JointType.PRISMATIC
    kind = "prismatic" if slides else "continuous" if chain.continuous[i] else "revolute"
    known = _known_limits(chain, i)
    limit = " ".join(f'{key}="{value}"' for key, value in known.items())
    rows = [
        f'  <joint name={_quoted(chain.joint_names[i])} type="{kind}">',
        f"    <parent link={_quoted(parent)}/><child link={_quoted(child)}/>",
        f"    {_origin(origin)}",
        '    <axis xyz="0 0 1"/>',
    ]
    rows += [f"    <limit {limit}/>"] if known or kind != "continuous" else []
    damping, friction = float(chain.viscous_friction[i]), float(chain.coulomb_friction[i])
    if damping or friction:
        rows.append(f'    <dynamics damping="{damping!r}" friction="{friction!r}"/>')
    return [*rows, "  </joint>"]


def _known_limits(chain: Chain, i: int) -> dict[str, str]:
    """Limits of joint i that are known, as they are written."""
    quantities = _QUANTITIES if chain.continuous[i] else ("lower", "upper", *_QUANTITIES)
    values = {name: float(getattr(chain.limits, name)[i]) for name in quantities}
    return {name: repr(value) for name, value in values.items() if np.isfinite(value)}


def _link(name: str, inertia: Inertia | None, solids: Sequence[CollisionElement]) -> str:
    tag = f"  <link name={_quoted(name)}"
    rows = [] if inertia is None else _inertial(inertia)
    for solid in solids:
        origin, shape = _origin(solid.T_link_element), _shape(solid.geometry, name)
        rows.append(f"    <collision>{origin}<geometry>{shape}</geometry></collision>")
    return "\n".join([f"{tag}>", *rows, "  </link>"]) if rows else f"{tag}/>"


def _shape(shape: Geometry, link: str) -> str:
    if isinstance(shape, SphereGeometry):
        return f'<sphere radius="{shape.radius!r}"/>'
    if isinstance(shape, CapsuleGeometry):
        return f'<capsule radius="{shape.radius!r}" length="{shape.length!r}"/>'
    if isinstance(shape, CylinderGeometry):
        return f'<cylinder radius="{shape.radius!r}" length="{shape.length!r}"/>'
    raise InvalidRobotDescription(f"link {link!r} has a solid that is not written")


def _inertial(inertia: Inertia) -> list[str]:
    x, y, z = (float(value) for value in inertia.center_of_mass)
    tensor = " ".join(f'{name}="{float(inertia.tensor[i, j])!r}"' for name, i, j in _TENSOR)
    return [
        "    <inertial>",
        f'      <origin xyz="{x!r} {y!r} {z!r}"/>',
        f'      <mass value="{inertia.mass!r}"/><inertia {tensor}/>',
        "    </inertial>",
    ]


def _origin(T: Array) -> str:
    xyz = " ".join(repr(float(value)) for value in T[:3, 3])
    rpy = " ".join(repr(float(value)) for value in to_rpy(T[:3, :3]))
    return f'<origin xyz="{xyz}" rpy="{rpy}"/>'


def srdf_text(
    chain: Chain, states: Mapping[str, Array], allowed: Mapping[tuple[str, str], str]
) -> str:
    """The SRDF of a chain as one group.

    Args:
        chain: The robot.
        states: Configurations by name, each of shape (n,) [rad or m].
        allowed: Pairs of links that may touch, each with the reason.
    """
    lines = [
        '<?xml version="1.0"?>',
        f"<robot name={_quoted(chain.name or 'robot')}>",
        f'  <group name="{GROUP}">',
        f"    <chain base_link={_quoted(chain.base_link)} tip_link={_quoted(chain.tip_link)}/>",
        "  </group>",
    ]
    for name, q in states.items():
        lines.append(f'  <group_state name={_quoted(name)} group="{GROUP}">')
        lines += [
            f"    <joint name={_quoted(joint)} value={_quoted(repr(value))}/>"
            for joint, value in zip(chain.joint_names, q.tolist(), strict=True)
        ]
        lines.append("  </group_state>")
    lines += [
        f"  <disable_collisions link1={_quoted(a)} link2={_quoted(b)} "
        f"reason={_quoted(_REASONS.get(reason, reason))}/>"
        for (a, b), reason in allowed.items()
    ]
    return "\n".join([*lines, "</robot>", ""])


def _quoted(text: str) -> str:
    return f'"{escape(text, quote=True)}"'


def with_limits(text: str, chain: Chain) -> str:
    """The URDF with the limits of the chain's joints in place of its own.

    Limits that the chain does not know stay as the text has them; joints off the chain are not
    touched. Comments and elements of other XML namespaces are dropped.

    Args:
        text: A URDF that the chain is made of.
        chain: The robot.

    Raises:
        InvalidRobotDescription: The text is no URDF.
    """
    robot = read_robot(text, "URDF")
    joints = {joint.get("name", "").strip(): joint for joint in children(robot, "joint")}
    for k, name in enumerate(chain.joint_names):
        if name not in joints:
            continue
        joint = joints[name]
        known = _known_limits(chain, k)
        if known:
            _limit(joint, name).attrib.update(known)
    return f'<?xml version="1.0"?>\n{tostring(robot, encoding="unicode")}\n'


def _limit(joint: Element, name: str) -> Element:
    limit = single(joint, "limit", f"joint {name!r}")
    if limit is None:
        limit = Element("limit")
        joint.append(limit)
    return limit
