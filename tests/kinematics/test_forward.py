"""Forward kinematics beside pinocchio: real robots, positioners, root frames, mimic joints."""

import pickle

import numpy as np
import pytest
from numpy.typing import ArrayLike

from compiled.kernel import kernel
from dynamics.terms import gravity_vector
from kinematics import forward as module
from kinematics.arrays import Array
from kinematics.errors import (
    InvalidLinkName,
    InvalidOption,
    InvalidRobotDescription,
    InvalidRobotState,
    MissingInertia,
)
from kinematics.forward import forward, joint_frames, link_poses
from kinematics.ik.inverse import inverse_kinematics
from kinematics.jacobian import geometric, geometric_rate, pose_and_jacobian
from kinematics.model.chain import Chain, JointType, parents
from kinematics.pose import from_rpy, rotation_z, transform
from kinematics.robots import builtin_urdf
from kinematics.root_frame import frame_names, frame_pose, root_notes, tool_notes
from kinematics.tree.serial_chain import select, serial_chain
from kinematics.tree.srdf import Semantics, named_states, state
from kinematics.urdf.urdf import parse_urdf
from tests.kinematics.samples import Sample, configurations, random_chain, reference, samples
from tests.mimic_joints import MIMIC_JOINTS, mimic_positions, mimic_robot
from tests.mimic_joints import configurations as mimic_joints_configurations
from tests.mimic_joints import urdf as mimic_joints_urdf
from tests.planning.pinocchio_arm import PinocchioArm


def test_equals_the_product_of_the_joints() -> None:
    rng = np.random.default_rng(5)
    for _ in range(50):
        chain = random_chain(rng)
        q = rng.uniform(-3, 3, chain.n)
        T = np.eye(4)
        for i in range(chain.n):
            turns = chain.joint_types[i] == JointType.REVOLUTE
            motion = transform(rotation_z(q[i])) if turns else transform(position=[0, 0, q[i]])
            T = T @ chain.offsets[i] @ motion
            np.testing.assert_allclose(joint_frames(chain, q)[i], T, atol=1e-13)
        np.testing.assert_allclose(forward(chain, q), T @ chain.tip.T_joint_link, atol=1e-13)


@pytest.mark.parametrize("sample", samples(), ids=lambda sample: sample.name)
def test_batches_are_where_pinocchio_puts_them(sample: Sample) -> None:
    arm = reference(sample)
    chain = arm.chain
    q = np.array(list(configurations(chain, 21)))
    poses, tips = link_poses(chain, q), forward(chain, q)
    for k, row in enumerate(q):
        for link, T in zip(chain.links, poses[k], strict=True):
            np.testing.assert_allclose(T, arm.pose(row, link.name), atol=1e-12, rtol=0)
        np.testing.assert_array_equal(tips[k], poses[k, chain.index[chain.tip_link]])
        np.testing.assert_array_equal(poses[k], link_poses(chain, row))


def test_what_is_refused() -> None:
    chain = random_chain(np.random.default_rng(8), 3)
    wrong: list[ArrayLike] = [[0, 0], 0.0, [0, 0, 0, 0], [0, np.nan, 0], [0, 0, np.inf]]
    wrong += [["a", "b", "c"], [[0, 0]]]
    for q in wrong:
        with pytest.raises(InvalidRobotState):
            forward(chain, q)
    with pytest.raises(InvalidLinkName, match="nowhere") as error:
        forward(chain, [0, 0, 0], "nowhere")
    assert "link_2" in (error.value.hint or "")
    with pytest.raises(InvalidLinkName):
        link_poses(chain, [0, 0, 0], ["base", "nowhere"])


@kernel
def rows_kernel(q: Array) -> Array:
    """Two rows that are alike."""
    rows = np.empty((2, q.shape[0]))
    rows[:] = q
    return rows


def test_one_configuration_out_of_a_kernel_is_one_like_any_other(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """numba answers arrays whose type of numbers is equal to numpy's own, and not the same."""
    chain = random_chain(np.random.default_rng(6))
    q = np.linspace(-1.0, 1.0, chain.n)
    row = rows_kernel(q)[1]
    expected = forward(chain, q), geometric(chain, q)
    monkeypatch.setattr(module, "pose_batch_kernel", None)
    np.testing.assert_array_equal(forward(chain, row), expected[0])
    np.testing.assert_array_equal(geometric(chain, row), expected[1])


# A slide, a tilting axis and a turning one, none of them through the origin of the next.
CELL = """<link name="floor"/><link name="sledge"/><link name="cradle"/><link name="table"/>
<link name="work"/><link name="lamp"/>
<joint name="slide" type="prismatic"><parent link="floor"/><child link="sledge"/>
<origin xyz="0.7 0.1 0.2" rpy="0.1 -0.2 0.3"/><axis xyz="0 0.6 0.8"/>
<limit lower="-0.5" upper="0.5" velocity="1" effort="100"/></joint>
<joint name="tilt" type="revolute"><parent link="sledge"/><child link="cradle"/>
<origin xyz="0.05 0.2 -0.1" rpy="0.4 0 -0.2"/><axis xyz="1 0 0"/>
<limit lower="-1.5" upper="1.5" velocity="1" effort="100"/></joint>
<joint name="turn" type="revolute"><parent link="cradle"/><child link="table"/>
<origin xyz="0 0.03 0.15"/><axis xyz="0 0 -1"/>
<limit lower="-3" upper="3" velocity="2" effort="100"/></joint>
<joint name="clamp" type="fixed"><parent link="table"/><child link="work"/>
<origin xyz="0.02 0.01 0.1" rpy="0 0.3 0"/></joint>
<joint name="post" type="fixed"><parent link="sledge"/><child link="lamp"/>
<origin xyz="0 0 1"/></joint>
<joint name="stand" type="fixed"><parent link="floor"/><child link="base_link"/>
<origin xyz="0 0 0.3" rpy="0 0 1"/></joint></robot>"""


@pytest.fixture(scope="module")
def urdf() -> str:
    text = builtin_urdf("ur5e")
    base = serial_chain(parse_urdf(text)).base_link
    return text.replace("</robot>", CELL.replace("base_link", base))


def test_links_stand_to_the_work_where_pinocchio_has_them(urdf: str) -> None:
    description = parse_urdf(urdf)
    chain = serial_chain(description, "work")
    assert chain.joint_names[:3] == ("turn", "tilt", "slide")
    assert chain.n == 9
    assert {link.name for link in chain.links} == set(description.links)
    arm = PinocchioArm(urdf=urdf, chain=chain)
    rng = np.random.default_rng(3)
    for values in rng.uniform(-0.5, 0.5, (20, chain.n)):
        for link, T in zip(chain.links, link_poses(chain, values), strict=True):
            np.testing.assert_allclose(T, arm.pose(values, link.name), atol=1e-12)


def test_a_part_of_the_positioner_may_be_held(urdf: str) -> None:
    whole = serial_chain(parse_urdf(urdf), "work")
    held = {"tilt": 0.4, "turn": 1.0}
    chain = serial_chain(parse_urdf(urdf), "sledge", whole.tip_link, held)
    assert chain.joint_names[0] == "slide"
    assert chain.n == 7
    q = np.linspace(-0.4, 0.5, 7)
    T_whole = link_poses(whole, [1.0, 0.4, *q])
    T_work_sledge = T_whole[whole.index["sledge"]]
    for link, T in zip(chain.links, link_poses(chain, q), strict=True):
        np.testing.assert_allclose(T_work_sledge @ T, T_whole[whole.index[link.name]], atol=1e-12)


def test_forces_are_not_known_where_the_root_moves(urdf: str) -> None:
    description = parse_urdf(urdf)
    chain = serial_chain(description, "work", joint_limits={"*": {"effort": 50.0}})
    assert np.isnan(chain.limits.effort).all()
    with pytest.raises(MissingInertia):
        gravity_vector(chain, np.zeros(chain.n))
    assert any("'work'" in line and "turn, tilt, slide" in line
               for line in select(description, "work").lint)  # fmt: skip


def test_only_work_that_a_joint_moves_may_begin_a_chain(urdf: str) -> None:
    with pytest.raises(InvalidRobotDescription, match="does not hang on"):
        serial_chain(parse_urdf(urdf), "lamp", "cradle")
    with pytest.raises(InvalidRobotDescription, match="does not hang on"):
        serial_chain(parse_urdf(urdf), "work", "floor")


def test_a_frame_that_moves_is_refused_with_the_robot_that_has_it(urdf: str) -> None:
    chain = serial_chain(parse_urdf(urdf), "work")
    assert np.array_equal(frame_pose(chain, "work", None, "frame"), np.eye(4))
    with pytest.raises(InvalidLinkName, match="moves with the arm") as error:
        frame_pose(chain, "sledge", None, "frame")
    assert "base_link 'sledge'" in (error.value.hint or "")
    assert "goes into attached" in (error.value.hint or "")


def test_the_world_is_no_name_of_a_frame_that_turns(urdf: str) -> None:
    chain = serial_chain(parse_urdf(urdf), "work")
    assert frame_names(chain) == ["work", "table", "tool"]
    with pytest.raises(InvalidLinkName, match="no frame 'world'"):
        frame_pose(chain, "world", None, "frame")


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


CARRIED = ("crank", "rod", "cover", "flap", "piston", "drum")


@pytest.fixture(scope="module")
def chain() -> Chain:
    return mimic_robot().chain


@pytest.fixture(scope="module")
def oracle(chain: Chain) -> PinocchioArm:
    """The arm in pinocchio, in which the mimic joints are joints like the others."""
    return PinocchioArm(urdf=mimic_joints_urdf(), chain=chain, others=mimic_positions)


def test_mimic_joints_of_the_chain(chain: Chain) -> None:
    assert chain.n == 6
    assert {f.name: f.leader for f in chain.mimic_joints} == {
        "crank_joint": 1, "rod_joint": 1, "cover_joint": 3, "flap_joint": 3, "piston_joint": 2,
        "drum_joint": 0}  # fmt: skip
    flap = next(f for f in chain.mimic_joints if f.name == "flap_joint")
    assert (flap.multiplier, flap.offset) == pytest.approx((-0.15, -0.04))
    before = parents(chain.n, chain.mimic_joints)
    assert (before < np.arange(chain.body_count)).all()
    assert before[chain.link("rod").joint] == chain.link("crank").joint
    assert before[chain.link("drum").joint] == -1
    assert before[chain.link("cover").joint] == 2


@pytest.mark.parametrize("link", [*CARRIED, "flange", "base"])
def test_poses_and_jacobians_against_pinocchio(
    chain: Chain, oracle: PinocchioArm, link: str
) -> None:
    rng = np.random.default_rng(3)
    states = mimic_joints_configurations(20, 1)
    together = forward(chain, states, link)
    every, columns = link_poses(chain, states), geometric(chain, states, link)
    for k, q in enumerate(states):
        expected = oracle.pose(q, link)
        one = link_poses(chain, q)[chain.index[link]]
        for T in (together[k], every[k, chain.index[link]], forward(chain, q, link), one):
            np.testing.assert_allclose(T, expected, atol=1e-12)
        J = oracle.jacobian(q, link)
        np.testing.assert_allclose(columns[k], J, atol=1e-12)
        T, J_walk = pose_and_jacobian(chain, q, link)
        np.testing.assert_allclose(T, expected, atol=1e-12)
        np.testing.assert_allclose(J_walk, J, atol=1e-12)
        rates = rng.uniform(-2.0, 2.0, 6)
        Jd = geometric_rate(chain, q, rates, link)
        np.testing.assert_allclose(Jd, oracle.jacobian_rate(q, rates, link), atol=1e-11)


def test_a_pickled_chain_keeps_its_mimic_joints(chain: Chain) -> None:
    again = pickle.loads(pickle.dumps(chain))
    assert again == chain
    np.testing.assert_array_equal(again.model, chain.model)
    other = serial_chain(
        parse_urdf(mimic_joints_urdf().replace('"0.08"', '"0.09"')), tip_link="flange"
    )
    assert other.content_hash != chain.content_hash


def test_a_multiplier_of_zero_holds_the_joint() -> None:
    fixed = (("stay", "revolute", "fore", "cover", "0 0 0.3", "0 0 1", "j2", 0.0, 0.5),)
    description = parse_urdf(mimic_joints_urdf(fixed))
    assert select(description, tip_link="flange").held["stay"] == 0.5
    assert serial_chain(description, tip_link="flange").mimic_joints == ()


def test_goals_and_tips_on_mimic_joints_are_refused(chain: Chain) -> None:
    with pytest.raises(InvalidOption, match=r"'flap'.*mimics"):
        inverse_kinematics(chain, np.eye(4), link="flap")
    with pytest.raises(InvalidRobotDescription, match="mimics"):
        serial_chain(parse_urdf(mimic_joints_urdf()), tip_link="flap")
    with pytest.raises(InvalidLinkName, match="'nowhere'"):
        forward(chain, np.zeros(6), "nowhere")


def test_a_chain_on_its_own_mimic_joint_is_refused() -> None:
    carrier = (
        '<link name="floor"/><joint name="lift" type="prismatic"><parent link="floor"/>'
        '<child link="base"/><axis xyz="0 0 1"/><limit lower="0" upper="1"/>'
        '<mimic joint="j1"/></joint></robot>'
    )
    text = mimic_joints_urdf(()).replace("</robot>", carrier)
    with pytest.raises(InvalidRobotDescription, match=r"'lift' carries the chain.*'j1'"):
        serial_chain(parse_urdf(text), "base", "flange")


def _one(limits: str, multiplier: float, offset: float, kind: str = "revolute") -> str:
    mimic = ("cover_joint", kind, "fore", "cover", "0.2 0 0.1", "1 0 0", "j4")
    return mimic_joints_urdf(((*mimic, multiplier, offset),), limits)


@pytest.mark.parametrize(
    ("limits", "multiplier", "offset", "expected"),
    [
        ('lower="-1" upper="2"', 1.0, 0.0, (-1.0, 2.0)),
        ('lower="-1" upper="2"', -1.0, 0.0, (-2.0, 1.0)),
        ('lower="-1" upper="0.8"', -0.5, 0.2, (-1.2, 2.4)),
        ('lower="-9" upper="9"', 1.0, 0.0, (-3.0, 3.0)),
        ('lower="4" upper="5"', 1.0, 0.0, (-3.0, 3.0)),
        ('lower="0" upper="0"', 1.0, 0.0, (-3.0, 3.0)),
    ],
)
def test_limits_of_a_mimic_joint_narrow_its_leaders(
    limits: str, multiplier: float, offset: float, expected: tuple[float, float]
) -> None:
    description = parse_urdf(_one(limits, multiplier, offset))
    chain = serial_chain(description, tip_link="flange")
    assert (chain.limits.lower[3], chain.limits.upper[3]) == pytest.approx(expected)
    notes = [line for line in select(description, tip_link="flange").lint if "mimics" in line]
    assert any("'cover_joint'" in line and "'j4'" in line for line in notes)
    if expected != (-3.0, 3.0):
        assert any(f"[{expected[0]:g}, {expected[1]:g}]" in line for line in notes), notes
    elif "9" not in limits:
        assert any("not used" in line for line in notes), notes


def test_rates_of_a_mimic_joint_narrow_its_leaders() -> None:
    text = _one('lower="-9" upper="9"', -4.0, 0.0).replace('velocity="0"', 'velocity="1"')
    chain = serial_chain(parse_urdf(text), tip_link="flange")
    np.testing.assert_allclose(chain.limits.velocity, [2.0, 2.0, 2.0, 0.25, 2.0, 2.0])
    np.testing.assert_allclose(chain.limits.acceleration, np.full(6, 6.0))
    lint = select(parse_urdf(text), tip_link="flange").lint
    assert any("velocity limit leaves 'j4' 0.25" in line for line in lint), lint
    assert not any("acceleration limit leaves" in line for line in lint), lint
    # A speed of 0, as many descriptions have it for joints that mimic, limits nothing.
    still = parse_urdf(_one('lower="-9" upper="9"', -4.0, 0.0))
    assert not any("limit leaves" in line for line in select(still, tip_link="flange").lint)


def test_mimic_joints_are_all_that_is_named(chain: Chain) -> None:
    assert {f.name for f in chain.mimic_joints} == {str(joint[0]) for joint in MIMIC_JOINTS}
