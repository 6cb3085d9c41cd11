"""A Panda with fingers that move, in three files of text that the tests put together."""

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import armwright as aw
from kinematics.robots import builtin_srdf, builtin_urdf
from obstacles.robots.robot_geometry import RobotGeometry

LEADER, MIMIC_JOINT = "claw_left", "claw_right"
_PLATE = """<link name="{0}_plate"><collision><origin xyz="0 0 0.02"/>
<geometry><box size="0.02 0.01 0.04"/></geometry></collision></link>
<joint name="{0}" type="prismatic"><parent link="panda_hand"/><child link="{0}_plate"/>
<origin xyz="0 0 0.0934"/><axis xyz="0 {1} 0"/>
<limit lower="0" upper="0.06" velocity="0.2" effort="20"/>{2}</joint>"""
_STATES = """<group name="claws"><joint name="claw_left"/></group>
<group_state name="open" group="claws"><joint name="claw_left" value="0.055"/></group_state>
<group_state name="close" group="claws"><joint name="claw_left" value="0.025"/></group_state>"""


def urdf() -> str:
    """The built-in Panda with two plates that slide sidewards."""
    plates = _PLATE.format(LEADER, 1, "") + _PLATE.format(
        MIMIC_JOINT, -1, f'<mimic joint="{LEADER}"/>'
    )
    return builtin_urdf("panda").replace("</robot>", f"{plates}</robot>")


def srdf() -> str:
    """Its states open and close."""
    return builtin_srdf("panda").replace("</robot>", f"{_STATES}</robot>")


@cache
def robot() -> RobotGeometry:
    """The robot, its plates together."""
    with TemporaryDirectory() as folder:
        files = Path(folder, "claws.urdf"), Path(folder, "claws.srdf")
        files[0].write_text(urdf(), "utf-8")
        files[1].write_text(srdf(), "utf-8")
        return aw.load_robot(files[0], srdf=files[1])
