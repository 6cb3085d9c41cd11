"""Frames that requests name, and the UR5 whose chain begins away from the root."""

import numpy as np
import pytest

from kinematics.errors import InvalidLinkName, InvalidRobotState
from kinematics.forward import forward
from kinematics.model.chain import Chain
from kinematics.pose import from_rpy, transform
from kinematics.root_frame import frame_names, frame_pose, root_notes, tool_notes
from kinematics.tree.serial_chain import serial_chain
from kinematics.tree.srdf import Semantics, named_states, state
from kinematics.urdf.urdf import parse_urdf

#: A mount of 0.9144 m and 1.57 rad before the chain, as a UR5 on its stand has it.
MOUNTED = """<robot name="mounted">
  <link name="stand"/><link name="base_link"/><link name="arm"/><link name="tool0"/>
  <joint name="mount" type="fixed"><parent link="stand"/><child link="base_link"/>
    <origin xyz="0 0 0.9144" rpy="0 0 1.57"/></joint>
  <joint name="turn" type="revolute"><parent link="base_link"/><child link="arm"/>
    <axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="1" effort="1"/></joint>
  <joint name="end" type="fixed"><parent link="arm"/><child link="tool0"/>
    <origin xyz="0.5 0 0"/></joint>
</robot>"""
SRDF = Semantics(
    "mounted",
    chains={"manipulator": ("base_link", "tool0")},
    states={
        "manipulator": {"home": {"turn": 0.5}, "part": {"turn": 0.1, "other": 1.0}},
        "other": {"home": {"turn": 0.7}, "closed": {"finger": 0.0}},
    },
    virtual_frames=(("cell", "stand"),),
)


@pytest.fixture(scope="module")
def mounted() -> Chain:
    return serial_chain(parse_urdf(MOUNTED), semantics=SRDF)


def test_poses_are_in_the_root_frame_wherever_the_chain_begins(mounted: Chain) -> None:
    assert (mounted.base_link, mounted.root_link) == ("base_link", "stand")
    mount = transform(from_rpy([0.0, 0.0, 1.57]), [0.0, 0.0, 0.9144])
    whole = serial_chain(parse_urdf(MOUNTED))
    assert (whole.base_link, whole.root_link) == ("stand", "stand")
    for angle in (-2.0, 0.0, 0.3):
        arm = transform(from_rpy([0.0, 0.0, angle])) @ transform(position=[0.5, 0.0, 0.0])
        np.testing.assert_allclose(forward(mounted, [angle]), mount @ arm, atol=1e-15)
        np.testing.assert_array_equal(forward(mounted, [angle]), forward(whole, [angle]))


def test_frames(mounted: Chain) -> None:
    assert frame_names(mounted) == ["base_link", "stand", "cell", "tool"]
    mount = frame_pose(mounted, "base_link", None, "frame")
    np.testing.assert_allclose(mount[:3, 3], [0, 0, 0.9144])
    for root in ("stand", "cell"):
        np.testing.assert_array_equal(frame_pose(mounted, root, None, "frame"), np.eye(4))
    plain = serial_chain(parse_urdf(MOUNTED))
    np.testing.assert_array_equal(frame_pose(plain, "world", None, "frame"), np.eye(4))
    with pytest.raises(InvalidLinkName):
        frame_pose(mounted, "world", None, "frame")
    tool = frame_pose(mounted, "tool", np.array([0.3]), "frame")
    np.testing.assert_array_equal(tool, forward(mounted, [0.3]))


@pytest.mark.parametrize(
    ("frame", "words"),
    [
        ("arm", "'arm' moves with the arm"),
        ("shelf", "no frame 'shelf'"),
        ("tool", "nothing says where the tool is"),
    ],
)
def test_frames_that_are_refused(mounted: Chain, frame: str, words: str) -> None:
    with pytest.raises(InvalidLinkName, match=rf"scene\.frame: .*{words}") as error:
        frame_pose(mounted, frame, None, "scene.frame")
    assert error.value.hint


def test_note_where_the_chain_begins_elsewhere(mounted: Chain) -> None:
    (note,) = root_notes(mounted)
    assert all(word in note for word in ("'stand'", "'base_link'", "0.9144 m", "1.57 rad"))
    assert root_notes(serial_chain(parse_urdf(MOUNTED))) == []


def test_note_where_a_link_is_called_tool_that_is_not_the_tip(mounted: Chain) -> None:
    assert tool_notes(mounted) == []
    tip = serial_chain(parse_urdf(MOUNTED.replace('"tool0"', '"tool"')))
    assert tool_notes(tip) == []
    rack = MOUNTED.replace('"base_link"', '"tool"')
    assert tool_notes(serial_chain(parse_urdf(rack))) == [
        "the frame 'tool' of a request is the tip 'tool0', not the link 'tool'"
    ]


def test_states_of_all_joints_are_offered(mounted: Chain) -> None:
    states, lint = named_states(mounted, SRDF)
    assert {name: list(q) for name, q in states.items()} == {
        "home": [0.5], "part": [0.1], "other/home": [0.7],
    }  # fmt: skip
    assert lint == []
    assert state(states, "home", "start")[0] == 0.5
    with pytest.raises(InvalidRobotState, match=r"start: .*'away'"):
        state(states, "away", "start")


def test_states_outside_of_the_limits_are_offered_and_told(mounted: Chain) -> None:
    named = {"far": {"turn": 3.5}, "rounded": {"turn": 3.0000005}, "edge": {"turn": -3.0}}
    states, lint = named_states(mounted, Semantics("mounted", states={"manipulator": named}))
    assert list(states) == ["far", "rounded", "edge"]
    assert lint == ["state 'far' of the SRDF has turn at 3.5, limits -3 to 3"]
