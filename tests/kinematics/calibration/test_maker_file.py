"""Kinematics files of Universal Robots."""

import numpy as np
import pytest

from kinematics.calibration.maker_file import maker_origins, with_origins
from kinematics.errors import InvalidRobotDescription
from kinematics.forward import forward
from kinematics.robots import builtin_urdf
from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf

#: As ur_calibration writes it of a UR5e.
FILE = """
kinematics:
  shoulder:
    x: 0
    y: 0
    z: 0.1626214052
    roll: -0
    pitch: 0
    yaw: -1.5e-07
  upper_arm:
    x: 0.0000512
    y: 0
    z: 0
    roll: 1.570298
    pitch: 0
    yaw: -0.0000151
  forearm:
    x: -0.4250811
    y: 0
    z: 0
    roll: 0.000713
    pitch: 0.000268
    yaw: -0.0000063
  wrist_1:
    x: -0.3921733
    y: 0.0000437
    z: 0.1332904
    roll: 0.001328
    pitch: -0.000314
    yaw: 0.0000021
  wrist_2:
    x: 0.0000238
    y: -0.0996711
    z: 0.0000302
    roll: 1.5704934
    pitch: 0
    yaw: -0.0000023
  wrist_3:
    x: -0.0000371
    y: 0.0995932
    z: -0.0000204
    roll: 1.5710011
    pitch: 3.1415926
    yaw: 3.1415924
  hash: calib_1234567890
"""


def test_the_joints_stand_where_the_file_has_them() -> None:
    description = parse_urdf(builtin_urdf("ur5e"))
    found = with_origins(description, FILE)
    moved = {name for name, joint in found.joints.items()
             if joint.T_parent_joint is not description.joints[name].T_parent_joint}  # fmt: skip
    assert len(moved) == 6
    before, after = serial_chain(description), serial_chain(found)
    q = np.random.default_rng(0).uniform(-3.0, 3.0, (50, 6))
    off = np.linalg.norm((forward(after, q) - forward(before, q))[:, :3, 3], axis=1)
    assert 1e-4 < off.max() < 5e-3
    shoulder = maker_origins(FILE)["shoulder"]
    np.testing.assert_allclose(after.offsets[0], before.offsets[0], atol=2e-4)
    np.testing.assert_allclose(found.joints["shoulder_pan_joint"].T_parent_joint, shoulder)


@pytest.mark.parametrize(
    ("text", "about"),
    [
        ("kinematics: {}", "no kinematics"),
        ("[1, 2", "calibration:"),
        ("kinematics: {shoulder: {x: 0, y: 0}}", "shoulder does not have"),
        (FILE.replace("forearm", "elbow_cover"), "0 joints carry a link elbow_cover_link"),
    ],
)
def test_other_files_are_refused(text: str, about: str) -> None:
    with pytest.raises(InvalidRobotDescription, match=about):
        with_origins(parse_urdf(builtin_urdf("ur5e")), text)
