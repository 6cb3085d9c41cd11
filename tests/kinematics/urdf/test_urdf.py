"""URDF: what the reader takes and refuses, looks of links, and chains written and read back."""

import contextlib
import math
import random
import re
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio
import pinocchio as pin
import pytest

from kinematics.errors import InvalidRobotDescription
from kinematics.forward import forward
from kinematics.model.chain import Chain, Limits
from kinematics.model.dh import DhRow, DhTable, chain_from_dh, dh_from_chain
from kinematics.pose import from_rpy, transform
from kinematics.robots import builtin_chain, builtin_urdf
from kinematics.tree.description import (
    BoxGeometry,
    CapsuleGeometry,
    CollisionElement,
    CylinderGeometry,
    MeshGeometry,
    Mimic,
    RobotDescription,
    SphereGeometry,
)
from kinematics.tree.serial_chain import serial_chain
from kinematics.tree.srdf import named_states, parse_srdf
from kinematics.urdf.urdf import MAX_LINKS, parse_urdf
from kinematics.urdf.visuals import read_visuals, with_visual_solids
from kinematics.urdf.writer import srdf_text, urdf_text, with_limits
from tests.kinematics.samples import TREE, Sample, arm, random_rotation, real_robots

TWO = (
    '<robot name="two"><link name="a"/><link name="b"/><link name="c"/>'
    '<joint name="ab" type="fixed"><parent link="{}"/><child link="{}"/></joint>'
    '<joint name="bc" type="fixed"><parent link="{}"/><child link="{}"/></joint></robot>'
)


#: What is wrong: (text, words that the message or the hint must have).
FAULTS: dict[str, tuple[str, list[str]]] = {
    "other root": ("<sdf><model/></sdf>", ["<sdf>", "<robot>"]),
    "no links": ('<robot name="none"/>', ["no <link>"]),
    "two links of a name": (arm(more='<link name="tip"/>'), ["'tip'", "two links"]),
    "two joints of a name": (arm() .replace("</robot>", "") + arm()[arm().index("<joint"):],
                             ["'swing'", "two joints"]),
    "link without name": (arm(more="<link/>"), ["<link>", "'name'"]),
    "joint without name": (arm('<joint type="fixed"/>'), ["<joint>", "'name'"]),
    "joint without type": (arm('<joint name="swing"/>'), ["'swing'", "'type'"]),
    "unknown type": (arm(type="ball"), ["'swing'", "'ball'", "revolute"]),
    "no parent": (arm(parent=""), ["'swing'", "<parent>"]),
    "no child": (arm(child=""), ["'swing'", "<child>"]),
    "two child elements": (arm(extra='<child link="base"/>'), ["'swing'", "<child>"]),
    "parent without link": (arm(parent="<parent/>"), ["'swing'", "'link'"]),
    "unknown parent": (arm(parent='<parent link="bass"/>'), ["'swing'", "'bass'", "base"]),
    "unknown child": (arm(child='<child link="top"/>'), ["'swing'", "'top'"]),
    "two parents": (TWO.format("a", "c", "b", "c"), ["'c'", "two parents", "'ab'", "'bc'"]),
    "two roots": (arm(more='<link name="alone"/>'), ["2 roots", "base", "alone"]),
    "cycle": (TWO.format("b", "c", "c", "b"), ["cycle", "b", "c"]),
    "nothing but a cycle": (
        TWO.format("a", "b", "b", "a").replace('<link name="c"/>', ""), ["cycle", "a", "b"]),
    "own parent": (arm(child='<child link="base"/>'), ["base"]),
    "zero axis": (arm(axis='<axis xyz="0 0 0"/>'), ["'swing'", "axis", "direction"]),
    "tiny axis": (arm(axis='<axis xyz="0 1e-30 0"/>'), ["'swing'", "axis", "direction"]),
    "axis without xyz": (arm(axis="<axis/>"), ["'swing'", "'xyz'"]),
    "NaN axis": (arm(axis='<axis xyz="0 nan 1"/>'), ["'swing'", "finite", "nan"]),
    "infinite axis": (arm(axis='<axis xyz="0 1e999 1"/>'), ["'swing'", "finite"]),
    "short axis": (arm(axis='<axis xyz="0 1"/>'), ["'swing'", "3 number"]),
    "two axes": (arm(extra='<axis xyz="1 0 0"/>'), ["'swing'", "<axis>"]),
    "NaN origin": (arm(origin='<origin xyz="0 nan 0"/>'), ["'swing'", "xyz", "nan"]),
    "inf origin": (arm(origin='<origin rpy="inf 0 0"/>'), ["'swing'", "rpy", "inf"]),
    "long origin": (arm(origin='<origin xyz="0 0 0 1"/>'), ["'swing'", "3 number"]),
    "worded origin": (arm(origin='<origin xyz="0 zero 0"/>'), ["'swing'", "zero"]),
    "astronomic origin": (arm(origin='<origin xyz="0 0 1e300"/>'), ["'swing'", "units"]),
    "wrong quaternion": (arm(origin='<origin quat_xyzw="0 0 0 2"/>'), ["'swing'", "norm"]),
    "two rotations": (arm(origin='<origin rpy="0 0 0" quat_xyzw="0 0 0 1"/>'), ["both"]),
    "NaN limit": (arm(limit='<limit lower="nan" upper="1"/>'), ["'swing'", "lower", "nan"]),
    "infinite limit": (arm(limit='<limit lower="0" upper="inf"/>'), ["'swing'", "upper", "inf"]),
    "negative damping": (arm(extra='<dynamics damping="-1"/>'), ["'swing'", "damping"]),
    "mimics nobody": (arm(extra='<mimic joint="nobody"/>'), ["'swing'", "'nobody'"]),
    "mimics itself": (arm(extra='<mimic joint="swing"/>'), ["'swing'", "itself"]),
    "mimic without joint": (arm(extra="<mimic/>"), ["'swing'", "'joint'"]),
    "too many links": (
        '<robot name="x">' + "".join(f'<link name="{i}"/>' for i in range(MAX_LINKS + 1))
        + "</robot>", [str(MAX_LINKS)]),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_are_refused_by_name(fault: str) -> None:
    text, words = FAULTS[fault]
    with pytest.raises(InvalidRobotDescription) as error:
        parse_urdf(text)
    said = f"{error.value} {error.value.hint}"
    assert all(word in said for word in words), said
    with pytest.raises(InvalidRobotDescription):
        parse_urdf(text.encode())


def test_the_sample_arm_is_accepted() -> None:
    description = parse_urdf(arm())
    assert description.root == "base"
    assert [j.name for j in description.joints.values()] == ["swing"]


def test_tree() -> None:
    tree = parse_urdf(TREE)
    assert (tree.name, tree.root) == ("tree", "world")
    assert len(tree.links) == 9
    assert len(tree.joints) == 8
    slide, elbow = tree.joints["slide"], tree.joints["elbow"]
    assert (slide.type, slide.parent, slide.child) == ("prismatic", "rail", "carriage")
    limits = (slide.lower, slide.upper, slide.velocity, slide.effort)
    assert limits == (-0.4, 0.9, 1.5, 200.0)
    assert (slide.acceleration, slide.jerk, slide.damping, slide.friction) == (3, 40, 2.5, 0.5)
    np.testing.assert_allclose(slide.axis, np.array([1, 2, -0.5]) / math.sqrt(5.25), atol=1e-15)
    assert math.isnan(elbow.velocity)
    assert math.isnan(elbow.acceleration)
    np.testing.assert_array_equal(elbow.axis, [1, 0, 0])
    shoulder = tree.joints["shoulder"]
    assert (shoulder.lower, shoulder.upper) == (-math.inf, math.inf)
    mimic = tree.joints["right_finger_joint"]
    assert mimic.mimic == Mimic("left_finger_joint", 0.5, 0.01)
    assert tree.joints["stand"].mimic is None


def test_geometries() -> None:
    tree = parse_urdf(TREE)
    solids = {name: [c.geometry for c in link.collisions] for name, link in tree.links.items()}
    assert solids["rail"] == [BoxGeometry((1.0, 0.2, 0.1))]
    assert solids["carriage"] == [SphereGeometry(0.1), CylinderGeometry(0.05, 0.3)]
    assert solids["upper"] == [CapsuleGeometry(0.05, 0.4)]
    assert solids["fore"] == [MeshGeometry("package://tree/meshes/fore.stl", (1.0, 1.0, 1.0))]
    assert solids["hand"] == [MeshGeometry("hand.obj", (0.001, -0.001, 0.001))]
    T = tree.links["carriage"].collisions[1].T_link_element
    np.testing.assert_array_equal(T[:3, 3], [0, 0, 0.2])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (arm(axis=""), ["'swing'", "axis", "x"]),
        (arm(limit='<limit lower="0" upper="1"/>'), ["'swing'", "no velocity limit"]),
        (arm(limit='<limit lower="0" upper="1" velocity="0"/>'), ["'swing'", "is 0"]),
        (arm(limit='<limit lower="0" upper="1" velocity="-1"/>'), ["'swing'", "velocity", "-1"]),
        (arm(limit='<limit lower="0" upper="1" effort="-1"/>'), ["'swing'", "effort", "not given"]),
        (arm(limit='<limit lower="0" upper="1" jerk="-1"/>'), ["'swing'", "jerk", "not given"]),
        (arm(limit='<limit upper="1" velocity="1"/>'), ["'swing'", "'lower'", "0"]),
        (arm(limit='<limit velocity="1"/>'), ["'swing'", "neither", "unlimited"]),
        (arm(limit=""), ["'swing'", "revolute", "neither", "joint_limits"]),
        (arm(limit="", type="prismatic"), ["'swing'", "prismatic", "neither", "unlimited"]),
        (arm(limit='<limit lower="1" upper="1"/>'), ["'swing'", "can't move"]),
        (arm(limit='<limit lower="1" upper="-1"/>'), ["'swing'", "1 above", "-1", "not known"]),
        (arm(limit='<limit lower="-180" upper="180"/>'), ["'swing'", "-180 to 180", "radians"]),
    ],
)
def test_what_is_odd_is_told(text: str, words: list[str]) -> None:
    lint = parse_urdf(text).lint
    assert any(all(word in line for word in words) for line in lint), lint


def test_ranges_of_some_turns_or_of_a_slide_are_no_degrees() -> None:
    for limit, type_ in (('"-20" upper="20"', "revolute"), ('"0" upper="180"', "prismatic")):
        lint = parse_urdf(arm(limit=f"<limit lower={limit}/>", type=type_)).lint
        assert not any("degrees" in line for line in lint), lint


def test_axis_of_a_fixed_joint_means_nothing() -> None:
    joint = parse_urdf(arm(type="fixed", axis='<axis xyz="0 0 0"/>', limit="")).joints["swing"]
    assert not joint.moves


def test_inertia_is_pinocchios() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        R = random_rotation(rng)
        tensor = R @ np.diag([0.3, 0.4, 0.5]) @ R.T
        rpy, xyz = rng.uniform(-3, 3, (2, 3))
        upper = zip(("xx", "xy", "xz", "yy", "yz", "zz"), tensor[np.triu_indices(3)], strict=True)
        entries = " ".join(f'i{axes}="{value!r}"' for axes, value in upper).replace(
            "np.float64", ""
        )
        inside = (
            f'<inertial><origin xyz="{" ".join(map(str, xyz))}" rpy="{" ".join(map(str, rpy))}"/>'
            f'<mass value="2.5"/><inertia {re.sub("[()]", "", entries)}/></inertial>'
        )
        text = arm(tip=f'<link name="tip">{inside}</link>')
        ours = parse_urdf(text).links["tip"].inertia
        theirs = pin.buildModelFromXML(text).inertias[1]
        assert ours is not None
        assert ours.mass == theirs.mass
        np.testing.assert_allclose(ours.center_of_mass, theirs.lever, atol=1e-15)
        np.testing.assert_allclose(ours.tensor, theirs.inertia, atol=1e-14)


def build(text: str | bytes) -> None:
    """Whatever the text, it is either a chain or refused as a description."""
    with contextlib.suppress(InvalidRobotDescription):
        serial_chain(parse_urdf(text), tip_link="hand")


def test_every_truncation_is_refused() -> None:
    data = TREE.rstrip().encode()
    for end in range(0, len(data), 23):
        with pytest.raises(InvalidRobotDescription):
            parse_urdf(data[:end])


def test_flipped_bytes_never_escape() -> None:
    draw = random.Random(4)
    data = TREE.encode()
    for _ in range(500):
        broken = bytearray(data)
        for _ in range(draw.randint(1, 4)):
            broken[draw.randrange(len(broken))] = draw.randrange(256)
        build(bytes(broken))


def test_odd_attribute_values_never_escape() -> None:
    odd = ["", " ", "nan", "-inf", "1e999", "0", "-1", "x", "0 0", "0 0 0", "1 2 3 4", "hand",
           "1e300", "floating", "slide", "\u0661", "9" * 400]  # fmt: skip
    # The first two of each attribute of each element: what is read once and what is read again.
    seen = Counter[tuple[str, str]]()
    for element in re.finditer(r"<([\w:]+)[^<>]*>", TREE):
        for match in re.finditer(r'([\w:]+)="([^"]*)"', element[0]):
            kind, at = (element[1], match[1]), element.start()
            seen[kind] += 1
            if seen[kind] <= 2 and not match[1].startswith("xmlns"):
                for value in odd:
                    build(TREE[: at + match.start(2)] + value + TREE[at + match.end(2) :])
    assert len(seen) > 40


def test_left_out_elements_never_escape() -> None:
    lines = TREE.split("\n")
    for i in range(1, len(lines)):
        build("\n".join(lines[:i] + lines[i + 1 :]))
        for tag in re.findall(r"<\w+[^<>]*/>", lines[i]):
            build(TREE.replace(tag, "", 1))


@pytest.mark.parametrize("sample", real_robots(), ids=lambda sample: sample.name)
def test_real_files_are_accepted(sample: Sample) -> None:
    assert sample.chain().n >= 5


@pytest.mark.parametrize(
    ("limits", "told"),
    [('velocity="1"', False), ('lower="-1" upper="1" velocity="1"', True), ('upper="3"', True)],
)
def test_limits_of_a_continuous_joint_are_told_to_be_unused(limits: str, told: bool) -> None:
    parsed = parse_urdf(
        f'<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="continuous">'
        f'<parent link="a"/><child link="b"/><axis xyz="0 0 1"/><limit {limits} effort="1"/>'
        "</joint></robot>"
    )
    assert (parsed.joints["j"].lower, parsed.joints["j"].upper) == (-np.inf, np.inf)
    assert any("'j' is continuous" in line for line in parsed.lint) == told


BOX = '<geometry><box size="1 2 3"/></geometry>'
URDF = f"""<robot name="arm">
  <link name="base"><visual><origin xyz="0 0 0.5"/>{BOX}</visual>
    <visual><geometry><mesh filename="base.dae" scale="2 2 2"/></geometry></visual></link>
  <link name="solid"><visual>{BOX}</visual>
    <collision><geometry><sphere radius="1"/></geometry></collision></link>
  <link name="odd"><visual>{BOX}</visual><visual><geometry/></visual></link>
  <link name="frame"/>
  <joint name="a" type="fixed"><parent link="base"/><child link="solid"/></joint>
  <joint name="b" type="fixed"><parent link="base"/><child link="odd"/></joint>
  <joint name="c" type="fixed"><parent link="base"/><child link="frame"/></joint>
</robot>"""


def seen() -> RobotDescription:
    return with_visual_solids(parse_urdf(URDF), read_visuals(URDF))


def test_links_without_solids_are_given_what_they_look_like() -> None:
    links = seen().links
    box, mesh = links["base"].collisions
    assert box.geometry == BoxGeometry((1.0, 2.0, 3.0))
    np.testing.assert_array_equal(box.T_link_element[:3, 3], [0.0, 0.0, 0.5])
    assert mesh.geometry == MeshGeometry("base.dae", (2.0, 2.0, 2.0))
    (ball,) = links["solid"].collisions
    assert ball.geometry == SphereGeometry(1.0)


def test_half_a_link_is_no_solid() -> None:
    assert seen().links["odd"].collisions == ()


def test_what_was_done_is_told() -> None:
    lint = "\n".join(seen().lint)
    assert "links collide as they look, as visual_solids asks: 'base'" in lint
    assert "'base' has no collision geometry" not in lint
    assert "it gives link 'odd' no solids" in lint
    assert "link 'odd' has no collision geometry" in lint
    assert "link 'frame' has no collision geometry" in lint


VISUALS_URDF = """<robot name="seen">
  <material name="blue"><color rgba="0 0 1 0.5"/></material>
  <link name="base">
    <visual><origin xyz="0.1 0.2 0.3" rpy="0.1 -0.2 0.3"/><geometry><box size="1 2 3"/></geometry>
      <material name="blue"/></visual>
    <visual><geometry><sphere radius="0.5"/></geometry>
      <material name="red"><color rgba="1 0 0 1"/></material></visual>
    {more}
  </link>
  <link name="arm"><visual><geometry><cylinder radius="0.1" length="2"/></geometry>
    <material name="red"/></visual></link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
</robot>"""


def test_places_and_colours_are_those_of_pinocchio(tmp_path: Path) -> None:
    file = tmp_path / "seen.urdf"
    file.write_text(VISUALS_URDF.format(more=""))
    model = pinocchio.buildModelFromUrdf(str(file))
    theirs = pinocchio.buildGeomFromUrdf(model, str(file), pinocchio.GeometryType.VISUAL)
    found = read_visuals(file.read_text())
    ours = [item for link in ("base", "arm") for item in found.links[link]]
    assert not found.faults
    assert len(ours) == len(theirs.geometryObjects)
    for item, other in zip(ours, theirs.geometryObjects, strict=True):
        np.testing.assert_allclose(item.T_link_element, other.placement.homogeneous, atol=1e-12)
        assert item.color is not None
        np.testing.assert_allclose(item.color, other.meshColor, atol=1e-12)
    assert ours[0].geometry == BoxGeometry((1.0, 2.0, 3.0))


@pytest.mark.parametrize(("visual", "words"), [
    ("<visual/>", "must have one geometry"),
    ("<visual><geometry><torus/></geometry></visual>", "torus"),
    ("<visual><geometry><sphere radius='wide'/></geometry></visual>", "wide"),
    ("<visual><origin xyz='1 2'/><geometry><sphere radius='1'/></geometry></visual>", "xyz"),
])  # fmt: skip
def test_what_can_not_be_read_is_told(visual: str, words: str) -> None:
    found = read_visuals(VISUALS_URDF.format(more=visual))
    assert words in found.faults["base"]
    assert set(found.links) == {"base", "arm"}


@pytest.mark.parametrize(("rgba", "expected"), [
    ("2 -1 0.5 1", (1.0, 0.0, 0.5, 1.0)),
    ("0.25 0.5 0.75", (0.25, 0.5, 0.75, 1.0)),
    ("red", None),
    ("1 1 x 1", None),
])  # fmt: skip
def test_colours_that_are_odd(rgba: str, expected: tuple[float, ...] | None) -> None:
    mesh = f"""<visual><geometry><mesh filename="a.stl"/></geometry>
      <material name="odd"><color rgba="{rgba}"/></material></visual>"""
    last = read_visuals(VISUALS_URDF.format(more=mesh)).links["base"][-1]
    assert last.color == expected
    assert last.geometry == MeshGeometry("a.stl")


NAMES = ("panda", "ur5e", "iiwa14", "kr6_sixx", "puma560", "scara", "stanford", "planar_rr")


def back(chain: Chain) -> Chain:
    return serial_chain(parse_urdf(urdf_text(chain)))


def table_chain(name: str) -> Chain:
    return chain_from_dh(name, dh_from_chain(builtin_chain(name)))


@pytest.mark.parametrize("name", NAMES)
def test_a_chain_is_read_back_with_its_poses_limits_and_damping(name: str) -> None:
    chain = table_chain(name)
    copy = back(chain)
    assert copy.joint_names == chain.joint_names
    assert (copy.base_link, copy.tip_link) == (chain.base_link, chain.tip_link)
    np.testing.assert_array_equal(copy.joint_types, chain.joint_types)
    for quantity in ("lower", "upper", "velocity", "acceleration", "jerk", "effort"):
        given, told = getattr(chain.limits, quantity), getattr(copy.limits, quantity)
        np.testing.assert_array_equal(told, given, err_msg=quantity)
    np.testing.assert_array_equal(copy.viscous_friction, chain.viscous_friction)
    q = np.random.default_rng(1).uniform(-2.0, 2.0, (20, chain.n))
    np.testing.assert_allclose(forward(copy, q), forward(chain, q), rtol=0, atol=1e-12)


def test_pinocchio_reads_the_same_robot() -> None:
    chain = table_chain("panda")
    model = pin.buildModelFromXML(urdf_text(chain))
    data = model.createData()
    tool = model.getFrameId("tool")
    for q in np.random.default_rng(3).uniform(-1.0, 1.0, (5, 7)):
        pin.framesForwardKinematics(model, data, q)
        told = data.oMf[tool].homogeneous
        np.testing.assert_allclose(told, forward(chain, q), rtol=0, atol=1e-12)
    masses = sum(link.inertia.mass for link in chain.links if link.inertia is not None)
    assert pin.computeTotalMass(model) == pytest.approx(masses, rel=1e-12)


def test_solids_names_and_comments() -> None:
    row = DhRow("revolute", a=0.5, lower=-np.inf, upper=np.inf, mass=1.0, motor_inertia=0.1,
                coulomb_friction=0.7, viscous_friction=0.2)  # fmt: skip
    chain = chain_from_dh('an "arm" & more', DhTable("standard", (row,)))
    T = transform(from_rpy([0.1, 0.2, 0.3]), [0.1, 0.0, 0.2])
    solids = {"link_1": [CollisionElement(T, CapsuleGeometry(0.05, 0.4)),
                         CollisionElement(np.eye(4), SphereGeometry(0.1))]}  # fmt: skip
    text = urdf_text(chain, solids, ["left out -- a box"])
    description = parse_urdf(text)
    assert description.name == 'an "arm" & more'
    first, second = description.links["link_1"].collisions
    assert first.geometry == CapsuleGeometry(0.05, 0.4)
    np.testing.assert_allclose(first.T_link_element, T, atol=1e-15)
    assert second.geometry == SphereGeometry(0.1)
    assert "<!-- left out - - a box -->" in text
    assert "motor inertias at the joints: 0.1" in text
    joint = description.joints["joint_1"]
    assert (joint.type, joint.damping, joint.friction) == ("continuous", 0.2, 0.7)
    box = {"link_1": [CollisionElement(np.eye(4), BoxGeometry((1.0, 1.0, 1.0)))]}
    with pytest.raises(InvalidRobotDescription, match="not written"):
        urdf_text(chain, box)


def limited(chain: Chain, seed: int) -> Chain:
    """The chain with other limits, some of them not known."""
    random = np.random.default_rng(seed)
    velocity, acceleration, jerk, effort = random.uniform(0.1, 90.0, (4, chain.n))
    jerk[0] = np.nan
    lower, upper = chain.limits.lower * 0.9, chain.limits.upper * 0.8
    return replace(chain, limits=Limits(lower, upper, velocity, acceleration, jerk, effort))


@pytest.mark.parametrize("name", ["panda", "ur5e", "scara", "stanford"])
def test_limits_are_read_back_and_nothing_else_changes(name: str) -> None:
    chain = limited(builtin_chain(name), 3)
    before = serial_chain(parse_urdf(builtin_urdf(name)))
    copy = serial_chain(parse_urdf(with_limits(builtin_urdf(name), chain)))
    for quantity in ("lower", "upper", "velocity", "acceleration", "effort"):
        np.testing.assert_array_equal(
            getattr(copy.limits, quantity), getattr(chain.limits, quantity)
        )
    np.testing.assert_array_equal(copy.limits.jerk[1:], chain.limits.jerk[1:])
    np.testing.assert_array_equal(copy.limits.jerk[0], before.limits.jerk[0])
    for q in np.random.default_rng(4).uniform(-0.5, 0.5, (5, chain.n)):
        np.testing.assert_array_equal(forward(copy, q), forward(before, q))


def test_pinocchio_reads_the_merged_limits() -> None:
    chain = limited(builtin_chain("panda"), 5)
    model = pin.buildModelFromXML(with_limits(builtin_urdf("panda"), chain))
    np.testing.assert_array_equal(model.upperPositionLimit[:7], chain.limits.upper)
    np.testing.assert_array_equal(model.velocityLimit[:7], chain.limits.velocity)
    np.testing.assert_array_equal(model.effortLimit[:7], chain.limits.effort)


def test_a_joint_without_limits_gets_them() -> None:
    text = """<robot name="one"><link name="a"/><link name="b"/>
      <joint name="turn" type="continuous"><parent link="a"/><child link="b"/>
      <axis xyz="0 0 1"/></joint></robot>"""
    chain = serial_chain(parse_urdf(text))
    one = np.array([2.5])
    known = replace(chain.limits, velocity=one, effort=3.0 * one)
    merged = with_limits(text, replace(chain, limits=known))
    assert '<limit effort="7.5" velocity="2.5" />' in merged
    assert "lower" not in merged


def test_what_is_no_urdf_is_refused() -> None:
    with pytest.raises(InvalidRobotDescription):
        with_limits("<html/>", builtin_chain("panda"))


ALLOWED = {("hand", "link<1>"): "adjacent", ("a&b", "hand"): 'suspected: "5 mm"'}


@pytest.mark.parametrize("name", ["panda", "ur5e", "scara", "stanford"])
def test_chain_states_and_pairs_are_read_back(name: str) -> None:
    chain = builtin_chain(name)
    states = {"home": np.full(chain.n, 0.1), 'odd "&" name': np.linspace(-1.0, 1e-17, chain.n)}
    semantics = parse_srdf(srdf_text(chain, states, ALLOWED))
    assert dict(semantics.chains) == {"arm": (chain.base_link, chain.tip_link)}
    assert semantics.disabled_collisions == set(ALLOWED)
    read, _ = named_states(chain, semantics)
    assert set(read) == set(states)
    for key, q in states.items():
        np.testing.assert_array_equal(read[key], q)


def test_pinocchio_reads_the_named_states() -> None:
    chain = builtin_chain("panda")
    q = np.linspace(0.0, -0.6, 7)
    model = pin.buildModelFromXML(builtin_urdf("panda"))
    pin.loadReferenceConfigurationsFromXML(model, srdf_text(chain, {"ready": q}, {}))
    np.testing.assert_array_equal(model.referenceConfigurations["ready"][:7], q)
