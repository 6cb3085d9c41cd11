"""Chains from work on a positioner to the tip of an arm beside it, against pinocchio."""

import numpy as np
import pytest

from dynamics.terms import gravity_vector
from kinematics.errors import InvalidLinkName, InvalidRobotDescription, MissingInertia
from kinematics.forward import link_poses
from kinematics.robots import builtin_urdf
from kinematics.root_frame import frame_names, frame_pose
from kinematics.tree.serial_chain import select, serial_chain
from kinematics.urdf.urdf import parse_urdf
from tests.planning.pinocchio_arm import PinocchioArm

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
