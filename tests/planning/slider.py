"""A ball that slides on a table: collisions of it have closed forms."""

from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from obstacles.robots.robot_geometry import RobotGeometry, robot_geometry

#: A ball of 5 cm on a table of two slides, in the plane z = 0.
SLIDER = """<robot name="slider"><link name="base"/><link name="x"/>
<link name="ball"><collision><geometry><sphere radius="0.05"/></geometry></collision></link>
<joint name="jx" type="prismatic"><parent link="base"/><child link="x"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
<joint name="jy" type="prismatic"><parent link="x"/><child link="ball"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"""


def slider() -> RobotGeometry:
    """Two slides, in x and in y, that carry the ball."""
    description = parse_urdf(SLIDER)
    limits = {name: {"acceleration": 2.0} for name in ("jx", "jy")}
    return robot_geometry(serial_chain(description, joint_limits=limits), description)
