"""Robots and random values that the tests of kinematics share."""

import importlib.metadata
import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from kinematics.arrays import Array
from kinematics.model.chain import Chain, Limits, Link
from kinematics.pose import from_axis_angle, rotation_x, rotation_z, transform
from kinematics.robots import builtin_names, builtin_urdf
from kinematics.tree.description import RobotDescription
from kinematics.tree.serial_chain import select, serial_chain
from kinematics.urdf.urdf import parse_urdf
from tests.planning.pinocchio_arm import PinocchioArm

#: An arm on a rail with what files have: a base above, odd axes, a gripper that mimics, a camera.
TREE = """<?xml version="1.0"?>
<robot name="tree" xmlns:gz="http://gazebosim.org/schema">
  <material name="grey"><color rgba="0.5 0.5 0.5 1"/></material>
  <link name="world"/>
  <joint name="stand" type="fixed">
    <parent link="world"/><child link="rail"/><origin xyz="0.1 -0.2 0.5" rpy="0.2 0.1 -0.7"/>
    <axis xyz="0 0 0"/>
  </joint>
  <link name="rail"><collision><geometry><box size="1 0.2 0.1"/></geometry></collision></link>
  <joint name="slide" type="prismatic">
    <parent link="rail"/><child link="carriage"/><origin xyz="0 0 0.1" rpy="0 1.57 0"/>
    <axis xyz="1 2 -0.5"/>
    <limit lower="-0.4" upper="0.9" velocity="1.5" effort="200" acceleration="3" jerk="40"/>
    <dynamics damping="2.5" friction="0.5"/>
  </joint>
  <link name="carriage">
    <inertial>
      <origin xyz="0.01 0.02 -0.03" rpy="0.3 -0.2 1.1"/><mass value="3.5"/>
      <inertia ixx="0.03" ixy="0.001" ixz="-0.002" iyy="0.04" iyz="0.003" izz="0.05"/>
    </inertial>
    <collision name="a"><geometry><sphere radius="0.1"/></geometry></collision>
    <collision name="b">
      <origin xyz="0 0 0.2"/><geometry><cylinder radius="0.05" length="0.3"/></geometry>
    </collision>
  </link>
  <joint name="mast_joint" type="revolute">
    <parent link="carriage"/><child link="mast"/><origin xyz="0.1 0.1 0"/>
    <axis xyz="0 0 1"/><limit lower="0.2" upper="1" velocity="1" effort="1"/>
  </joint>
  <link name="mast"/>
  <joint name="shoulder" type="continuous">
    <parent link="carriage"/><child link="upper"/><origin xyz="0 0.1 0.2" rpy="1 0 0"/>
    <axis xyz="0 -1 0"/><limit velocity="2" effort="80"/>
  </joint>
  <link name="upper">
    <collision><geometry><capsule radius="0.05" length="0.4"/></geometry></collision>
  </link>
  <joint name="elbow" type="revolute">
    <parent link="upper"/><child link="fore"/><origin xyz="0.4 0 0"/>
    <limit lower="-2" upper="2.5" velocity="0" effort="40"/>
  </joint>
  <link name="fore">
    <collision><geometry><mesh filename="package://tree/meshes/fore.stl"/></geometry></collision>
  </link>
  <joint name="flange" type="fixed">
    <parent link="fore"/><child link="hand"/><origin xyz="0.3 0 0" rpy="0 0.7 0"/>
  </joint>
  <link name="hand">
    <collision>
      <geometry><mesh filename="hand.obj" scale="0.001 -0.001 0.001"/></geometry>
    </collision>
  </link>
  <joint name="left_finger_joint" type="prismatic">
    <parent link="hand"/><child link="left_finger"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="0.04" velocity="0.1" effort="5"/>
  </joint>
  <link name="left_finger"/>
  <joint name="right_finger_joint" type="prismatic">
    <parent link="hand"/><child link="right_finger"/><axis xyz="0 -1 0"/>
    <limit lower="0" upper="0.04" velocity="0.1" effort="5"/>
    <mimic joint="left_finger_joint" multiplier="0.5" offset="0.01"/>
  </joint>
  <link name="right_finger"/>
  <transmission name="t"><type>SimpleTransmission</type></transmission>
  <gazebo reference="hand"><gravity>true</gravity></gazebo>
  <gz:plugin><gz:link name="hand"/></gz:plugin>
</robot>
"""


def arm(joint: str = "", **changes: str) -> str:
    """A one-joint robot, the text of its joint or any part replaced."""
    parts = {
        "type": "revolute",
        "axis": '<axis xyz="0 0 1"/>',
        "limit": '<limit lower="-1" upper="1" velocity="1" effort="1"/>',
        "origin": '<origin xyz="0 0 0.1" rpy="0 0 0"/>',
        "parent": '<parent link="base"/>',
        "child": '<child link="tip"/>',
        "extra": "",
        "base": '<link name="base"/>',
        "tip": '<link name="tip"/>',
        "more": "",
    }
    p = parts | changes
    joint = joint or (
        f'<joint name="swing" type="{p["type"]}">{p["parent"]}{p["child"]}{p["origin"]}'
        f"{p['axis']}{p['limit']}{p['extra']}</joint>"
    )
    return f'<robot name="one">{p["base"]}{p["tip"]}{joint}{p["more"]}</robot>'


def random_rotation(rng: np.random.Generator) -> Array:
    """A rotation, evenly drawn."""
    q = rng.normal(size=4)
    x, y, z, w = q / np.linalg.norm(q)
    return from_axis_angle([x, y, z], 2.0 * math.atan2(math.hypot(x, y, z), w))


def random_offset(rng: np.random.Generator) -> Array:
    """A fixed transform: generic, or exactly or nearly one of the special cases of two axes."""
    R, p, w = random_rotation(rng), rng.uniform(-0.5, 0.5, 3), rng.normal(size=3)
    turn = rotation_z(rng.uniform(-3.0, 3.0))
    tiny = 10.0 ** rng.uniform(-16.0, -3.0)
    match rng.integers(9):
        case 0:  # parallel
            R = turn
        case 1:  # antiparallel
            R = turn @ rotation_x(math.pi)
        case 2:  # the same axis
            R, p = turn, np.array([0.0, 0.0, p[2]])
        case 3:  # intersecting in the origins
            p = np.zeros(3)
        case 4:  # intersecting elsewhere
            p = p[0] * R[:, 2] + np.array([0.0, 0.0, p[2]])
        case 5:  # nearly parallel
            R = from_axis_angle(w, tiny) @ turn
        case 6:  # nearly antiparallel
            R = rotation_x(math.pi) @ from_axis_angle(w, tiny)
        case 7:  # nearly intersecting
            p = tiny * w
        case _:
            pass
    return transform(R, p)


def random_chain(rng: np.random.Generator, n: int | None = None) -> Chain:
    """A chain of revolute and prismatic joints with special and generic axes."""
    n = int(rng.integers(1, 9)) if n is None else n
    links = [Link("base", -1, np.eye(4))]
    links += [Link(f"link_{i}", i, random_offset(rng)) for i in range(n)]
    return Chain(
        name="random",
        joint_names=tuple(f"joint_{i}" for i in range(n)),
        joint_types=rng.integers(0, 2, n),
        offsets=np.array([random_offset(rng) for _ in range(n)]),
        links=tuple(links),
        base_link="base",
        tip_link=f"link_{n - 1}",
        limits=Limits.unlimited(n),
        continuous=np.zeros(n, dtype=np.bool_),
    )


#: Arms of example-robot-data: folder, base and tip.
REAL = {
    "panda": ("panda_description/urdf", "panda_link0", "panda_hand_tcp"),
    "ur5_robot": ("ur_description/urdf", "base_link", "tool0"),
    "ur10_robot": ("ur_description/urdf", "world", "ee_link"),
    "ur3_gripper": ("ur_description/urdf", "world", "wrist_2_link"),
    "kinova": ("kinova_description/robots", "base", "j2s6s200_end_effector"),
    "xarm7": ("xarm_description/urdf", "world", "link_eef"),
    "z1": ("z1_description/urdf", "world", "gripperMover"),
    "so101": ("so_arm_description/urdf", "base_link", "gripper_frame_link"),
    "tiago": ("tiago_description/robots", "base_footprint", "arm_7_link"),
    "baxter": ("baxter_description/urdf", "torso", "left_gripper"),
    "pr2": ("pr2_description/urdf", "torso_lift_link", "r_wrist_roll_link"),
}


@dataclass(frozen=True)
class Sample:
    """A robot by its text, and the chain to cut out of it."""

    name: str
    text: str
    base: str | None = None
    tip: str | None = None
    held: dict[str, float] = field(default_factory=dict)

    def description(self) -> RobotDescription:
        return parse_urdf(self.text)

    def chain(self) -> Chain:
        return serial_chain(self.description(), self.base, self.tip, self.held)


def samples() -> list[Sample]:
    """The tree in several cuts, the built-in robots, and real ones where the extra is there."""
    tree = [
        Sample("tree", TREE, None, "hand", {"mast_joint": 0.7, "left_finger_joint": 0.03}),
        Sample("tree-from-carriage", TREE, "carriage", "fore"),
        Sample("tree-finger", TREE, "upper", "hand", {"slide": -0.2, "shoulder": 4.0}),
        Sample("tree-mast", TREE, "rail", "mast", {"shoulder": -2.0, "elbow": 1.0}),
    ]
    built_in = [Sample(name, builtin_urdf(name)) for name in builtin_names()]
    return tree + built_in + real_robots()


def real_robots() -> list[Sample]:
    """Those of ``REAL``."""
    files = importlib.metadata.files("example-robot-data") or []
    found = []
    for name, (folder, base, tip) in REAL.items():
        end = f"robots/{folder}/{name}.urdf"
        path = next(file.locate() for file in files if file.as_posix().endswith(end))
        text = Path(str(path)).read_text(encoding="utf-8")
        found.append(Sample(name, text, base, tip))
    return found


def configurations(chain: Chain, count: int, seed: int = 3) -> list[Array]:
    """Inside the limits, at both ends of them, and at 0."""
    lower, upper = chain.sampling_bounds()
    inside = np.random.default_rng(seed).uniform(lower, upper, (count, chain.n))
    return [*inside, lower, upper, np.zeros(chain.n)]


def reference(sample: Sample) -> PinocchioArm:
    """The same robot in pinocchio, everything off the chain held as the chain holds it."""
    held = select(sample.description(), sample.base, sample.tip, sample.held).held
    return PinocchioArm(urdf=sample.text, chain=sample.chain(), others=lambda _: held)
