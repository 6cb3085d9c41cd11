"""The built-in robot models: our own URDF and SRDF files, from published parameters.

Where each number comes from is said at the head of each URDF and in docs/robots.md.
"""

from importlib.resources import files

from kinematics.errors import InvalidOption
from kinematics.model.chain import Chain
from kinematics.model.robot_names import builtin_names as builtin_names
from kinematics.tree.serial_chain import serial_chain
from kinematics.tree.srdf import parse_srdf
from kinematics.urdf.urdf import parse_urdf


def builtin_urdf(name: str) -> str:
    """The URDF of a built-in robot: one chain, from the root to the only leaf.

    Raises:
        InvalidOption: There is no such robot; the message lists those there are.
    """
    return _text(name, "urdf")


def builtin_srdf(name: str) -> str:
    """The SRDF of a built-in robot.

    It has the group "arm", the named states of that group ("home" for every robot) and the pairs
    of neighbours that touch by design.

    Raises:
        InvalidOption: There is no such robot; the message lists those there are.
    """
    return _text(name, "srdf")


def builtin_chain(name: str) -> Chain:
    """The chain of a built-in robot, read from its URDF and SRDF.

    Raises:
        InvalidOption: There is no such robot; the message lists those there are.
    """
    return serial_chain(parse_urdf(builtin_urdf(name)), semantics=parse_srdf(builtin_srdf(name)))


def _text(name: str, kind: str) -> str:
    if name not in builtin_names():
        raise InvalidOption(
            f"there is no built-in robot {name!r}",
            hint=f"One of: {', '.join(builtin_names())}.",
            name=name,
        )
    return files("kinematics.robots").joinpath(f"{name}.{kind}").read_text(encoding="utf-8")
