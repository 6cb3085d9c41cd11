"""Fingers off a chain: where pinocchio has their links, and what is refused."""

import pickle

import numpy as np
import pinocchio as pin
import pytest

from kinematics.errors import InvalidOption
from kinematics.tree.fingers import Fingers, fingers
from kinematics.tree.serial_chain import select, serial_chain
from kinematics.tree.srdf import parse_srdf
from tests.kinematics.samples import Sample, real_robots

_SRDF = """<robot name="panda"><group_state name="open" group="hand">
<joint name="panda_finger_joint1" value="0.04"/></group_state>
<group_state name="ready" group="arm"><joint name="panda_joint1" value="0.1"/>
<joint name="panda_finger_joint1" value="0.02"/></group_state>
<group_state name="open" group="claw"><joint name="panda_finger_joint1" value="0.03"/>
</group_state></robot>"""


def _robot(name: str) -> Sample:
    return next(sample for sample in real_robots() if sample.name == name)


def _fingers(sample: Sample) -> Fingers:
    description = sample.description()
    return fingers(description, select(description, sample.base, sample.tip))


@pytest.mark.parametrize(
    ("name", "leader", "values"),
    [
        ("panda", "panda_finger_joint1", (0.0, 0.013, 0.04)),
        ("pr2", "r_gripper_l_finger_joint", (0.0, 0.21, 0.548)),
    ],
)
def test_links_of_fingers_are_where_pinocchio_has_them(
    name: str, leader: str, values: tuple[float, ...]
) -> None:
    sample = _robot(name)
    chain, known = serial_chain(sample.description(), sample.base, sample.tip), _fingers(sample)
    model = pin.buildModelFromXML(sample.text)
    data = model.createData()
    for value in values:
        positions = known.with_positions({leader: value})
        q = pin.neutral(model)
        for finger in known.joints:
            if finger.leader:
                q[model.joints[model.getJointId(finger.joint.name)].idx_q] = finger.position(
                    positions
                )
        pin.framesForwardKinematics(model, data, q)

        def placement(link: str) -> pin.SE3:
            return data.oMf[model.getFrameId(link)]

        poses = known.link_poses(chain, positions)
        moving = [link for link in poses if not np.allclose(poses[link], np.eye(4))]
        assert len(moving) >= 2
        for link, T_joint_link in poses.items():
            T_joint_tip = chain.link(chain.tip_link).T_joint_link
            by_pinocchio = (placement(chain.tip_link).inverse() * placement(link)).homogeneous
            np.testing.assert_allclose(T_joint_tip @ by_pinocchio, T_joint_link, atol=1e-12)


def test_only_joints_behind_the_last_one_are_fingers() -> None:
    known = _fingers(_robot("pr2"))
    assert set(known.positions) == {"r_gripper_l_finger_joint"}
    moving = {finger.joint.name for finger in known.moving(frozenset(known.positions))}
    joints = _robot("pr2").description().joints.values()
    assert moving == {j.name for j in joints if j.moves and j.name.startswith("r_gripper")}


def test_states_of_the_gripper_are_those_that_name_none_of_the_chain() -> None:
    sample = _robot("panda")
    description = sample.description()
    chosen = select(description, sample.base, sample.tip)
    known = fingers(description, chosen, parse_srdf(_SRDF))
    states = {name: dict(values) for name, values in known.states.items()}
    assert states == {
        "open": {"panda_finger_joint1": 0.04},
        "claw/open": {"panda_finger_joint1": 0.03},
    }
    again = pickle.loads(pickle.dumps(known))
    assert dict(again.positions) == dict(known.positions)
    assert {name: dict(values) for name, values in again.states.items()} == states


@pytest.mark.parametrize(
    ("joint", "value", "told"),
    [
        ("panda_finger_joint1", 0.05, "outside its limits"),
        ("panda_finger_joint1", -0.001, "outside its limits"),
        ("panda_finger_joint1", float("nan"), "outside its limits"),
        ("panda_finger_joint2", 0.01, "no joint of a gripper"),
        ("panda_joint1", 0.0, "no joint of a gripper"),
    ],
)
def test_what_no_gripper_can_do_is_refused(joint: str, value: float, told: str) -> None:
    with pytest.raises(InvalidOption, match=told):
        _fingers(_robot("panda")).with_positions({joint: value})
