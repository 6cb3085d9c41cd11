"""Chains cut out of trees: joints, frames, limits, tips, and fingers off the chain."""

import math
import pickle
from dataclasses import FrozenInstanceError, replace
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest

from kinematics.errors import InvalidOption, InvalidRobotDescription
from kinematics.forward import forward, link_poses
from kinematics.model.chain import MAX_JOINTS, JointType
from kinematics.tree.chain_ends import likely_tip
from kinematics.tree.description import (
    JOINT_TYPES,
    Mimic,
    RobotDescription,
)
from kinematics.tree.fingers import Fingers, fingers
from kinematics.tree.serial_chain import select, serial_chain
from kinematics.tree.srdf import Semantics, parse_srdf
from kinematics.urdf.urdf import parse_urdf
from tests.kinematics.samples import TREE, Sample, arm, real_robots

ARM = Semantics("tree", chains={"arm": ("carriage", "hand"), "fingers": ("carriage", "hand")})


@pytest.fixture(scope="module")
def tree() -> RobotDescription:
    return parse_urdf(TREE)


def test_joints_and_links(tree: RobotDescription) -> None:
    chain = serial_chain(tree, tip_link="hand")
    assert chain.joint_names == ("slide", "shoulder", "elbow")
    assert list(chain.joint_types) == [JointType.PRISMATIC, JointType.REVOLUTE, JointType.REVOLUTE]
    assert list(chain.continuous) == [False, True, False]
    assert (chain.base_link, chain.tip_link, chain.links[0].name) == ("world", "hand", "world")
    carriers = {link.name: link.joint for link in chain.links}
    assert carriers == {"world": -1, "rail": -1, "carriage": 0, "mast": 0, "upper": 1, "fore": 2,
                        "hand": 2, "left_finger": 2, "right_finger": 2}  # fmt: skip
    np.testing.assert_array_equal(chain.viscous_friction, [2.5, 0, 0])
    np.testing.assert_array_equal(chain.gravity, [0, 0, -9.81])
    carriage = chain.link("carriage").inertia
    assert carriage is not None
    assert carriage.mass == 3.5
    assert chain.link("hand").inertia is None


def test_links_above_the_base_stay_with_it(tree: RobotDescription) -> None:
    whole = serial_chain(tree, tip_link="hand")
    part = serial_chain(tree, "upper", "hand", {"slide": 0.25, "shoulder": -3.0})
    assert part.joint_names == ("elbow",)
    assert part.links[0].name == "upper"
    assert {link.name for link in part.links} == set(tree.links)
    T_world = link_poses(whole, [0.25, -3.0, 0.7])
    T_part = link_poses(part, [0.7])
    assert (part.base_link, part.root_link) == ("upper", "world")
    np.testing.assert_array_equal(part.link("world").T_joint_link, np.eye(4))
    for link in tree.links:
        expected = T_world[whole.index[link]]
        np.testing.assert_allclose(T_part[part.index[link]], expected, atol=1e-14)


def test_limits(tree: RobotDescription) -> None:
    limits = serial_chain(tree, tip_link="hand").limits
    np.testing.assert_array_equal(limits.lower, [-0.4, -math.inf, -2])
    np.testing.assert_array_equal(limits.upper, [0.9, math.inf, 2.5])
    np.testing.assert_array_equal(limits.velocity, [1.5, 2, math.nan])
    np.testing.assert_array_equal(limits.acceleration, [3, math.nan, math.nan])
    np.testing.assert_array_equal(limits.jerk, [40, math.nan, math.nan])
    np.testing.assert_array_equal(limits.effort, [200, 80, 40])


def test_limits_can_be_replaced(tree: RobotDescription) -> None:
    new = {"elbow": {"velocity": 1.25, "lower": -1.0, "jerk": 9}, "slide": {"acceleration": 2.0}}
    limits = serial_chain(tree, tip_link="hand", joint_limits=new).limits
    assert (limits.velocity[2], limits.lower[2], limits.upper[2], limits.jerk[2]) == (
        1.25,
        -1,
        2.5,
        9,
    )
    assert limits.acceleration[0] == 2.0


def test_positions_end_an_endless_joint(tree: RobotDescription) -> None:
    new = {"shoulder": {"lower": -1.0, "upper": 1.0}}
    assert not serial_chain(tree, tip_link="hand", joint_limits=new).continuous.any()


def test_range_left_out_can_be_given() -> None:
    description = parse_urdf(arm(limit='<limit velocity="1" effort="1"/>'))
    open_ended = serial_chain(description)
    assert (open_ended.limits.lower[0], open_ended.limits.upper[0]) == (-math.inf, math.inf)
    assert open_ended.continuous[0]
    one_sided = serial_chain(description, joint_limits={"swing": {"lower": -1}})
    assert (one_sided.limits.lower[0], one_sided.limits.upper[0]) == (-1.0, math.inf)
    assert not one_sided.continuous[0]
    chain = serial_chain(description, joint_limits={"swing": {"lower": -1, "upper": 2}})
    assert chain.limits.upper[0] == 2.0


def test_a_range_the_wrong_way_round_is_needed_on_the_chain_only() -> None:
    """Grippers of vendors have it: myCobot's by a sign of its mimic joints, the Magician's."""
    swapped = '<limit lower="1" upper="-0.5" velocity="1" effort="1"/>'
    description = parse_urdf(arm(limit=swapped))
    with pytest.raises(InvalidRobotDescription, match="'swing' has the lower limit 1") as error:
        serial_chain(description)
    assert "joint_limits" in str(error.value.hint)
    given = {"swing": {"lower": -0.5, "upper": 1.0}}
    chain = serial_chain(description, joint_limits=given)
    assert (chain.limits.lower[0], chain.limits.upper[0]) == (-0.5, 1.0)

    finger = (
        '<link name="jaw"/><joint name="jaw_j" type="prismatic"><parent link="tip"/>'
        f'<child link="jaw"/>{swapped}</joint>'
    )
    description = parse_urdf(arm(more=finger))
    assert math.isnan(description.joints["jaw_j"].range[0])
    assert select(description, tip_link="tip").held["jaw_j"] == 0.0
    assert select(description, tip_link="tip", held={"jaw_j": 0.3}).held["jaw_j"] == 0.3


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ({"knee": {"velocity": 1.0}}, ["'knee'", "unknown", "elbow"]),
        ({"mast_joint": {"velocity": 1.0}}, ["'mast_joint'", "held"]),
        ({"elbow": {"speed": 1.0}}, ["'elbow'", "'speed'", "velocity"]),
        ({"elbow": {"velocity": 0.0}}, ["'elbow'", "velocity", "positive"]),
        ({"elbow": {"velocity": math.nan}}, ["'elbow'", "velocity", "finite"]),
        ({"elbow": {"jerk": -1.0}}, ["'elbow'", "jerk", "positive"]),
        ({"elbow": {"upper": math.inf}}, ["'elbow'", "upper", "finite"]),
        ({"elbow": {"lower": 3.0}}, ["'elbow'", "lower", "upper"]),
    ],
)
def test_wrong_limits(
    tree: RobotDescription, limits: dict[str, dict[str, float]], words: list[str]
) -> None:
    with pytest.raises(InvalidRobotDescription) as error:
        serial_chain(tree, tip_link="hand", joint_limits=limits)
    said = f"{error.value} {error.value.hint}"
    assert all(word in said for word in words), said


# ------------------------------------------------------------------------------ base and tip


def test_likely_tip_is_told(tree: RobotDescription) -> None:
    chosen = select(tree)
    assert (chosen.base_link, chosen.tip_link) == ("world", "hand")
    told = next(line for line in chosen.lint if "tip_link" in line)
    assert "mast, left_finger, right_finger" in told


def test_srdf_names_the_chain(tree: RobotDescription) -> None:
    chosen = select(tree, semantics=ARM)
    assert (chosen.base_link, chosen.tip_link) == ("carriage", "hand")
    assert (select(tree, "rail", "mast", semantics=ARM).joints) == ("slide", "mast_joint")
    assert select(tree, None, "hand", semantics=ARM).base_link == "carriage"
    assert select(tree, None, "mast", semantics=ARM).base_link == "world"
    assert select(tree, "carriage", semantics=ARM).tip_link == "hand"


def test_several_chains_are_the_candidates(tree: RobotDescription) -> None:
    two = Semantics("tree", chains={"left": ("rail", "hand"), "right": ("rail", "mast")})
    with pytest.raises(InvalidRobotDescription) as error:
        serial_chain(tree, semantics=two)
    assert error.value.details["candidates"] == ["hand", "mast"]
    assert "hand, mast" in (error.value.hint or "")


def test_group_called_arm_is_the_chain(tree: RobotDescription) -> None:
    two = Semantics("tree", chains={"arm": ("rail", "hand"), "mast": ("rail", "mast")})
    chosen = select(tree, semantics=two)
    assert (chosen.base_link, chosen.tip_link) == ("rail", "hand")
    assert any("mast" in line and "group" in line for line in chosen.lint)


@pytest.mark.parametrize(
    ("base", "tip", "words"),
    [
        ("nowhere", "hand", ["base_link", "'nowhere'", "carriage"]),
        (None, "nowhere", ["tip_link", "'nowhere'", "carriage"]),
        ("hand", "rail", ["'rail'", "does not hang on", "'hand'"]),
        ("mast", "rail", ["'rail'", "does not hang on", "'mast'"]),
        ("fore", "hand", ["no joint moves", "'fore'", "'hand'"]),
        ("hand", "hand", ["no joint moves"]),
        ("hand", "right_finger", ["'right_finger_joint'", "mimics", "'left_finger_joint'"]),
    ],
)
def test_wrong_ends(tree: RobotDescription, base: str | None, tip: str, words: list[str]) -> None:
    with pytest.raises(InvalidRobotDescription) as error:
        serial_chain(tree, base, tip)
    said = f"{error.value} {error.value.hint}"
    assert all(word in said for word in words), said


@pytest.mark.parametrize("type_", ["floating", "planar"])
def test_free_joints_only_off_the_chain(type_: str) -> None:
    free = (
        f'<link name="body"/><joint name="free" type="{type_}"><parent link="body"/>'
        '<child link="base"/><origin xyz="1 0 0"/></joint>'
    )
    description = parse_urdf(arm(more=free))
    with pytest.raises(InvalidRobotDescription, match=f"'free'.*{type_}"):
        serial_chain(description, "body", "tip")
    assert select(description).base_link == "base"
    chain = serial_chain(description, base_link="base")
    np.testing.assert_array_equal(forward(chain, [0.3], "base")[:3, 3], [1, 0, 0])
    assert any("'free'" in line for line in select(description, "base").lint)
    with pytest.raises(InvalidRobotDescription, match=f"'free'.*{type_}"):
        serial_chain(description, base_link="base", held={"free": 0.0})


@pytest.mark.parametrize("type_", ["floating", "planar"])
@pytest.mark.parametrize("types", ["F", "RF", "FX", "RFR", "PXF", "RXFXR"])
def test_free_joints_on_the_way_to_the_tip_are_refused_by_their_name(
    types: str, type_: str
) -> None:
    names = {"F": type_, "R": "continuous", "P": "prismatic", "X": "fixed"}
    links = "".join(f'<link name="l{i}"/>' for i in range(len(types) + 1))
    joints = "".join(
        f'<joint name="{kind}{i}" type="{names[kind]}"><parent link="l{i}"/>'
        f'<child link="l{i + 1}"/></joint>'
        for i, kind in enumerate(types)
    )
    with pytest.raises(InvalidRobotDescription) as error:
        select(parse_urdf(f"<robot>{links}{joints}</robot>"))
    assert f"'F{types.index('F')}'" in error.value.message
    assert f"is {type_}, which is not supported" in error.value.message
    assert error.value.details["joint"] == f"F{types.index('F')}"


def test_long_chains_are_refused() -> None:
    count = MAX_JOINTS + 1
    links = "".join(f'<link name="{i}"/>' for i in range(count + 1))
    joints = "".join(
        f'<joint name="j{i}" type="continuous"><parent link="{i}"/><child link="{i + 1}"/></joint>'
        for i in range(count)
    )
    description = parse_urdf(f"<robot>{links}{joints}</robot>")
    with pytest.raises(InvalidRobotDescription, match=str(MAX_JOINTS)):
        serial_chain(description)
    assert serial_chain(description, "1").n == MAX_JOINTS


@pytest.mark.parametrize("gravity", [[0, 0], [0, 0, math.nan], "down"])
def test_wrong_gravity(tree: RobotDescription, gravity: object) -> None:
    with pytest.raises(InvalidRobotDescription, match="gravity"):
        serial_chain(tree, tip_link="hand", gravity=gravity)  # type: ignore[arg-type]


# ------------------------------------------------------------------------------- held joints


def test_held_joints_stand_nearest_to_zero(tree: RobotDescription) -> None:
    chosen = select(tree, tip_link="hand")
    assert dict(chosen.held) == {
        "mast_joint": 0.2, "left_finger_joint": 0.0, "right_finger_joint": 0.01}  # fmt: skip
    assert any("'mast_joint'" in line and "0.2" in line for line in chosen.lint)


def test_mimic_of_a_mimic() -> None:
    def finger(name: str, leader: str) -> str:
        mimic = f'<mimic joint="{leader}" multiplier="-2" offset="0.5"/>' if leader else ""
        return (
            f'<link name="{name}"/><joint name="{name}_j" type="revolute"><parent link="tip"/>'
            f'<child link="{name}"/><limit lower="-9" upper="9"/>{mimic}</joint>'
        )

    text = arm(more=finger("c", "b_j") + finger("b", "a_j") + finger("a", ""))
    held = select(parse_urdf(text), tip_link="tip", held={"a_j": 1.0}).held
    assert held["b_j"] == pytest.approx(-1.5)
    assert held["c_j"] == pytest.approx(3.5)


@pytest.mark.parametrize(
    ("held", "words"),
    [
        ({"knee": 0.0}, ["'knee'", "no such joint", "mast_joint"]),
        ({"elbow": 0.0}, ["'elbow'", "part of the chain"]),
        ({"stand": 0.0}, ["'stand'", "fixed"]),
        ({"right_finger_joint": 0.0}, ["'right_finger_joint'", "mimics"]),
        ({"mast_joint": 0.0}, ["'mast_joint'", "outside", "0.2"]),
        ({"mast_joint": 1.001}, ["'mast_joint'", "outside", "1"]),
        ({"mast_joint": math.inf}, ["'mast_joint'", "inf"]),
        ({"mast_joint": math.nan}, ["'mast_joint'", "nan"]),
    ],
)
def test_wrong_held(tree: RobotDescription, held: dict[str, float], words: list[str]) -> None:
    with pytest.raises(InvalidRobotDescription) as error:
        serial_chain(tree, tip_link="hand", held=held)
    said = f"{error.value} {error.value.hint}"
    assert all(word in said for word in words), said


@pytest.mark.parametrize("end", [0.2, 1.0])
def test_a_joint_may_be_held_at_its_limit(tree: RobotDescription, end: float) -> None:
    assert select(tree, tip_link="hand", held={"mast_joint": end}).held["mast_joint"] == end


def chain_ends_tree(*joints: tuple[str, str, str]) -> RobotDescription:
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


CHAIN_ENDS_ARM = chain("base", "a", 6)


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
    choice = likely_tip(chain_ends_tree(*CHAIN_ENDS_ARM, *more), "base")
    assert choice.tip == tip
    assert choice.candidates[0] == tip


def test_two_arms_are_not_clear() -> None:
    both = [*chain("base", "l", 6), *chain("base", "r", 6), ("fixed", "base", "camera")]
    tools = [("fixed", "l6", "l_tool"), ("fixed", "r6", "r_tool"), ("fixed", "l6", "l_lens")]
    choice = likely_tip(chain_ends_tree(*both, *tools), "base")
    assert choice.tip is None
    assert choice.candidates == ("l_tool", "r_tool", "l_lens", "camera")
    assert likely_tip(chain_ends_tree(*both, *tools), "l1").tip == "l_tool"


def test_arm_on_a_torso_beats_the_head() -> None:
    torso = [("prismatic", "base", "torso"), *chain("torso", "a", 7), *chain("torso", "head", 2)]
    assert likely_tip(chain_ends_tree(*torso), "base").tip == "a7"


@pytest.mark.parametrize(("kind", "tip"), [("prismatic", "tool0"), ("revolute", "left")])
def test_jaws_end_short_arms_too(kind: str, tip: str) -> None:
    # A turning link and a rod that turns with it may be the last joint of a palletiser.
    description = chain_ends_tree(
        *chain("base", "a", 3),
        ("fixed", "a3", "tool0"),
        (kind, "a3", "left"),
        (kind, "a3", "right"),
    )
    joints = dict(description.joints)
    joints["to_right"] = replace(joints["to_right"], mimic=Mimic("to_left"))
    assert likely_tip(replace(description, joints=joints), "base").tip == tip


@pytest.mark.parametrize("kind", JOINT_TYPES)
def test_only_joints_of_one_degree_of_freedom_move(kind: str) -> None:
    joint = parse_urdf(arm(type=kind)).joints["swing"]
    assert joint.moves == (kind in {"revolute", "continuous", "prismatic"})


def test_maps_and_arrays_cannot_be_changed(tree: RobotDescription) -> None:
    with pytest.raises(TypeError):
        del tree.joints["slide"]  # type: ignore[attr-defined]
    with pytest.raises(FrozenInstanceError):
        tree.root = "hand"  # type: ignore[misc]
    with pytest.raises(ValueError, match="read-only"):
        tree.joints["slide"].T_parent_joint[0, 3] = 1.0
    solid = tree.links["carriage"].collisions[0]
    with pytest.raises(ValueError, match="read-only"):
        solid.T_link_element[0, 3] = 1.0


def test_pickling_keeps_every_field(tree: RobotDescription) -> None:
    copy = pickle.loads(pickle.dumps(tree))
    assert (copy.name, copy.root, copy.lint) == (tree.name, tree.root, tree.lint)
    for name, joint in tree.joints.items():
        other = copy.joints[name]
        assert (other.type, other.parent, other.child, other.mimic) == (
            joint.type,
            joint.parent,
            joint.child,
            joint.mimic,
        )
        np.testing.assert_array_equal(other.T_parent_joint, joint.T_parent_joint)
        np.testing.assert_array_equal(
            [other.lower, other.upper, other.velocity], [joint.lower, joint.upper, joint.velocity]
        )
    for name, link in tree.links.items():
        assert [c.geometry for c in copy.links[name].collisions] == [
            c.geometry for c in link.collisions
        ]


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
