"""Calibrations as makers of arms write them: where joints are, in their parent links."""

from dataclasses import replace

from kinematics.arrays import Array
from kinematics.errors import InvalidRobotDescription
from kinematics.pose import from_rpy, transform
from kinematics.readers.yaml_reader import UnreadableYaml, fields_of, finite_number, read_yaml
from kinematics.tree.description import RobotDescription

_KEYS = ("x", "y", "z", "roll", "pitch", "yaw")
_HINT = "Give the text of a kinematics file as ur_calibration writes it."


def maker_origins(text: str) -> dict[str, Array]:
    """Frames of joints in their parent links (4, 4), by the link that each carries.

    Args:
        text: A YAML file of Universal Robots: kinematics, then shoulder, upper_arm and so on with
            x, y, z, roll, pitch and yaw [m, rad].

    Raises:
        InvalidRobotDescription: The text is no such file.
    """
    try:
        links = fields_of((fields_of(read_yaml(text)) or {}).get("kinematics"))
    except UnreadableYaml as error:
        raise InvalidRobotDescription(f"calibration: {error}", hint=_HINT) from None
    found = {}
    for name, entry in (links or {}).items():
        fields = fields_of(entry)
        if fields is None:  # the hash
            continue
        found_numbers = (finite_number(fields.get(key)) for key in _KEYS)
        numbers = [number for number in found_numbers if number is not None]
        if len(numbers) < len(_KEYS):
            raise InvalidRobotDescription(
                f"calibration: {name} does not have all of {', '.join(_KEYS)}", hint=_HINT
            )
        found[str(name)] = transform(from_rpy(numbers[3:]), numbers[:3])
    if not found:
        raise InvalidRobotDescription("calibration: the text has no kinematics", hint=_HINT)
    return found


def with_origins(description: RobotDescription, text: str) -> RobotDescription:
    """A description whose joints are where a maker's file has them.

    Args:
        description: The tree.
        text: The file.

    Raises:
        InvalidRobotDescription: The text is no such file, or names a link that is not there.
    """
    joints = dict(description.joints)
    for name, T in maker_origins(text).items():
        carrying = [
            joint
            for joint in joints.values()
            if joint.type != "fixed" and joint.child.removesuffix("_link").endswith(name)
        ]
        if len(carrying) != 1:
            raise InvalidRobotDescription(
                f"calibration: {len(carrying)} joints carry a link {name}_link",
                hint="The file is of another arm, or the links have other names.",
            )
        joints[carrying[0].name] = replace(carrying[0], T_parent_joint=T)
    return replace(description, joints=joints)
