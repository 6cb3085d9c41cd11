"""Arms that follow seams in the benchmark, each with pinocchio's model of it."""

from typing import NamedTuple

import pinocchio

from kinematics.robots import builtin_srdf, builtin_urdf
from kinematics.serial_chain import serial_chain
from kinematics.srdf import parse_srdf
from kinematics.urdf import parse_urdf
from obstacles.robot_geometry import RobotGeometry, robot_geometry

#: Speed of the tool [m/s].
SPEED = 0.1
STARTS = {
    "panda": [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785],
    "ur5e": [0.2, -1.2, 1.5, -1.9, -1.57, 0.2],
    "kr6_sixx": [0.1, -1.2, 1.5, 0.1, 1.2, 0.1],
    "iiwa_rail": [0.0, 0.1, 0.6, 0.0, -1.5, 0.1, 1.0, 0.0],
}
_RAIL = """<link name="rail"/><joint name="rail_joint" type="prismatic"><parent link="rail"/>
<child link="iiwa_link_0"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" velocity="1" effort="1000"/></joint>"""


class Arm(NamedTuple):
    """An arm with pinocchio's model of it."""

    robot: RobotGeometry
    urdf: str
    model: pinocchio.Model
    data: pinocchio.Data
    frame: int


def load(name: str) -> Arm:
    """An arm of the benchmark."""
    urdf = builtin_urdf("iiwa14" if name == "iiwa_rail" else name)
    semantics, limits = None, None
    if name == "iiwa_rail":
        urdf = urdf.replace("</robot>", _RAIL + "</robot>")
        limits = {"rail_joint": {"acceleration": 2.0, "jerk": 50.0}}
        for k in range(1, 8):
            limits[f"iiwa_joint_{k}"] = {"acceleration": 8.0, "jerk": 500.0}
    else:
        semantics = parse_srdf(builtin_srdf(name))
    description = parse_urdf(urdf)
    chain = serial_chain(description, semantics=semantics, joint_limits=limits)
    model = pinocchio.buildModelFromXML(urdf)
    robot = robot_geometry(chain, description, {}, semantics)
    return Arm(robot, urdf, model, model.createData(), model.getFrameId(chain.tip_link))
