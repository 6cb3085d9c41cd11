"""A URDF with the limits of a chain merged into its joints."""

import numpy as np

from kinematics.model.chain import Chain
from kinematics.readers.xml_reader import Element, children, read_robot, single, tostring

_POSITIONS = ("lower", "upper")
_QUANTITIES = ("effort", "velocity", "acceleration", "jerk")


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
        quantities = _QUANTITIES if chain.continuous[k] else (*_POSITIONS, *_QUANTITIES)
        values = {quantity: float(getattr(chain.limits, quantity)[k]) for quantity in quantities}
        known = {key: value for key, value in values.items() if np.isfinite(value)}
        if known:
            _limit(joint, name).attrib.update({key: repr(value) for key, value in known.items()})
    return f'<?xml version="1.0"?>\n{tostring(robot, encoding="unicode")}\n'


def _limit(joint: Element, name: str) -> Element:
    limit = single(joint, "limit", f"joint {name!r}")
    if limit is None:
        limit = Element("limit")
        joint.append(limit)
    return limit
