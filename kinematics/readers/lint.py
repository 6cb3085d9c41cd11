"""Notes on parts of a robot's description that are not read, and their order."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches

from kinematics.readers.xml_reader import Element

_ORIGIN = "xyz rpy quat_xyzw"
#: Attributes of each element of a URDF that is read, by its parent and its own tag.
URDF: Mapping[str, str] = {
    "robot": "name version",
    "robot/link": "name",
    "robot/joint": "name type",
    "robot/material": "name",
    "link/inertial": "",
    "link/visual": "name",
    "link/collision": "name",
    **dict.fromkeys(("inertial/origin", "visual/origin", "collision/origin"), _ORIGIN),
    "inertial/mass": "value",
    "inertial/inertia": "ixx ixy ixz iyy iyz izz",
    "visual/geometry": "",
    "visual/material": "name",
    "collision/geometry": "",
    "geometry/box": "size",
    "geometry/sphere": "radius",
    "geometry/cylinder": "radius length",
    "geometry/capsule": "radius length",
    "geometry/mesh": "filename scale",
    "material/color": "rgba",
    "joint/origin": _ORIGIN,
    "joint/parent": "link",
    "joint/child": "link",
    "joint/axis": "xyz",
    "joint/limit": "lower upper velocity acceleration jerk effort",
    "joint/dynamics": "damping friction",
    "joint/mimic": "joint multiplier offset",
    "joint/safety_controller": "soft_lower_limit soft_upper_limit",
}
#: The same of an SRDF.
SRDF: Mapping[str, str] = {
    "robot": "name version",
    "robot/group": "name",
    "group/chain": "base_link tip_link",
    "group/joint": "name",
    "group/link": "name",
    "group/group": "name",
    "robot/group_state": "name group",
    "group_state/joint": "name value",
    "robot/virtual_joint": "name type parent_frame child_link",
    "robot/passive_joint": "name",
    "robot/disable_collisions": "link1 link2 reason",
    "robot/enable_collisions": "link1 link2 reason",
    "robot/disable_default_collisions": "link",
}
#: What no motion depends on: extensions of simulators and drivers, what only other checkers use.
_HARMLESS = frozenset(
    ("gazebo", "transmission", "material", "ros2_control",
     "sensor", "plugin", "verbose", "calibration",
     "texture", "k_position", "k_velocity", "end_effector", "link_sphere_approximation",
     "joint_property", "link_sphere", "mujoco", "drake", "isaac")
)  # fmt: skip
_UNREAD = "that no motion depends on are not read"
#: What is told last: it seldom changes a motion.
_LAST = (
    "has no collision geometry: nothing", "tip_link is ", "no DH table", _UNREAD,
    "pair(s) with links that the robot does not have",
)  # fmt: skip
_NAME = re.compile(r"'[^']*'")


def unread_notes(robot: Element, read: Mapping[str, str], foreign: Iterable[str] = ()) -> list[str]:
    """Notes on elements and attributes that are not read, those that matter by their place.

    Args:
        robot: The root.
        read: Attributes of each element that is read, as in `URDF`.
        foreign: Elements of other XML namespaces, which were taken out.
    """
    notes: list[str] = []
    harmless = Counter(foreign)
    waiting: list[tuple[Element, str, str]] = [(robot, "robot", "the robot")]
    while waiting:
        element, path, where = waiting.pop()
        known = read[path].split()
        odd = []
        for name in sorted({*element.keys()} - {*known}):
            if name.startswith("{") or name in _HARMLESS:
                harmless[name.rpartition("}")[2]] += 1
            elif near := meant(name, known):
                notes.append(f"{where}: attribute {name!r} of <{element.tag}> is not read{near}")
            else:
                odd.append(name)
        if odd:
            notes.append(f"{where}: <{element.tag}> has {', '.join(odd)}, not read")
        below = [key.partition("/")[2] for key in read if key.startswith(f"{element.tag}/")]
        for child in element:
            if child.tag in below:
                name = child.get("name", "").strip()
                inside = f"{child.tag} {name!r}" if name and path == "robot" else where
                waiting.append((child, f"{element.tag}/{child.tag}", inside))
            elif child.tag in _HARMLESS:
                harmless[child.tag] += 1
            elif isinstance(child.tag, str):
                notes.append(f"{where}: <{child.tag}> is not read{meant(child.tag, below)}")
    notes.reverse()
    if harmless:
        told = ", ".join(f"{name} ({count})" for name, count in sorted(harmless.items()))
        notes.append(f"elements and attributes {_UNREAD}: {told}")
    return notes


def meant(name: str, known: Sequence[str]) -> str:
    """Hint behind a name that is not known: a known one that it may stand for, if any."""
    near = get_close_matches(name, known, 1, 0.75)
    return f"; is {near[0]!r} meant?" if near else ""


def tidy(lint: Iterable[str]) -> list[str]:
    """Notes in the order in which they matter; those that differ by their first name are one.

    Args:
        lint: One sentence each.
    """
    merged: dict[str, list[str]] = {}
    for line in lint:
        merged.setdefault(_NAME.sub("", line, count=1), []).append(line)
    told = [
        lines[0] if len(set(lines)) == 1 else f"{lines[0]} (the same of {_names(lines[1:])})"
        for lines in merged.values()
    ]
    return sorted(told, key=lambda line: any(words in line for words in _LAST))


def _names(lines: list[str], most: int = 12) -> str:
    names = [found[0] for line in lines if (found := _NAME.search(line)) is not None]
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
