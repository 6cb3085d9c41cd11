"""The link that is most likely meant as the tip."""

from dataclasses import replace
from itertools import pairwise

import pytest

from kinematics.tree.chain_ends import likely_tip
from kinematics.tree.description import Mimic, RobotDescription
from kinematics.urdf.urdf import parse_urdf


def tree(*joints: tuple[str, str, str]) -> RobotDescription:
    """A robot of joints (type, parent, child)."""
    names = dict.fromkeys(name for _, *ends in joints for name in ends)
    links = "".join(f'<link name="{name}"/>' for name in names)
    text = "".join(
        f'<joint name="to_{child}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        '<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>'
        for kind, parent, child in joints
    )
    return parse_urdf(f'<robot name="r">{links}{text}</robot>')


def chain(start: str, prefix: str, count: int) -> list[tuple[str, str, str]]:
    """So many revolute joints in a row, below a link."""
    names = [start, *(f"{prefix}{i}" for i in range(1, count + 1))]
    return [("revolute", *pair) for pair in pairwise(names)]


ARM = chain("base", "a", 6)


@pytest.mark.parametrize(
    ("more", "tip"),
    [
        ([("fixed", "a6", "wrist_camera_link"), ("fixed", "a6", "tool0")], "tool0"),
        ([("fixed", "a6", "tool0"), ("fixed", "tool0", "camera_optical_frame")], "tool0"),
        ([("fixed", "a6", "flange"), ("fixed", "flange", "hand_tcp")], "hand_tcp"),
        ([("fixed", "a6", "ee_link"), ("fixed", "a6", "mount")], "ee_link"),
        ([("fixed", "a6", "camera_link"), ("fixed", "a3", "label")], "a6"),
        ([("revolute", "a6", "left_finger"), ("revolute", "a6", "right_finger")], "a6"),
        (
            [
                ("fixed", "a6", "palm"),
                ("revolute", "palm", "left_finger"),
                ("revolute", "palm", "right_finger"),
                ("fixed", "palm", "grasp_frame"),
            ],
            "grasp_frame",
        ),
        ([("revolute", "base", "wheel_1"), ("revolute", "base", "wheel_2")], "a6"),
        ([("revolute", "base", "pan"), ("revolute", "pan", "tilt")], "a6"),
    ],
)
def test_tip_of_one_arm(more: list[tuple[str, str, str]], tip: str) -> None:
    choice = likely_tip(tree(*ARM, *more), "base")
    assert choice.tip == tip
    assert choice.candidates[0] == tip


def test_two_arms_are_not_clear() -> None:
    both = [*chain("base", "l", 6), *chain("base", "r", 6), ("fixed", "base", "camera")]
    tools = [("fixed", "l6", "l_tool"), ("fixed", "r6", "r_tool"), ("fixed", "l6", "l_lens")]
    choice = likely_tip(tree(*both, *tools), "base")
    assert choice.tip is None
    assert choice.candidates == ("l_tool", "r_tool", "l_lens", "camera")
    assert likely_tip(tree(*both, *tools), "l1").tip == "l_tool"


def test_arm_on_a_torso_beats_the_head() -> None:
    torso = [("prismatic", "base", "torso"), *chain("torso", "a", 7), *chain("torso", "head", 2)]
    assert likely_tip(tree(*torso), "base").tip == "a7"


@pytest.mark.parametrize(("kind", "tip"), [("prismatic", "tool0"), ("revolute", "left")])
def test_jaws_end_short_arms_too(kind: str, tip: str) -> None:
    # A turning link and a rod that turns with it may be the last joint of a palletiser.
    description = tree(
        *chain("base", "a", 3),
        ("fixed", "a3", "tool0"),
        (kind, "a3", "left"),
        (kind, "a3", "right"),
    )
    joints = dict(description.joints)
    joints["to_right"] = replace(joints["to_right"], mimic=Mimic("to_left"))
    assert likely_tip(replace(description, joints=joints), "base").tip == tip
