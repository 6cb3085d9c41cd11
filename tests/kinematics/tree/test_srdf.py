"""SRDF texts and limits of joints: what is kept, dropped and refused."""

import contextlib
import math
import pickle
from dataclasses import replace
from itertools import combinations
from random import Random
from xml.etree import ElementTree

import numpy as np
import pytest

from kinematics.errors import InvalidRobotDescription
from kinematics.model.chain import Limits
from kinematics.tree.joint_limits import (
    apply_rules,
    limits_of_chain,
    moveit_joint_limits,
    moveit_notes,
    parse_rule,
    soft_limit_notes,
)
from kinematics.tree.serial_chain import serial_chain
from kinematics.tree.srdf import Semantics, check_semantics, parse_srdf
from kinematics.urdf.urdf import parse_urdf
from tests.kinematics.samples import TREE

SRDF = """<?xml version="1.0"?>
<robot name="tree">
  <!-- the arm, with and without its rail -->
  <group name="arm"><chain base_link="carriage" tip_link="hand"/></group>
  <group name="whole"><chain base_link="rail" tip_link="hand"/></group>
  <group name="fingers"><joint name="left_finger_joint"/><link name="right_finger"/></group>
  <group name="both"><group name="arm"/><group name="fingers"/></group>
  <group name="two"><chain base_link="rail" tip_link="hand"/>
    <chain base_link="rail" tip_link="mast"/></group>
  <group_state name="home" group="arm">
    <joint name="shoulder" value="0.5"/><joint name="elbow" value="-1.25"/>
  </group_state>
  <group_state name="open" group="fingers"><joint name="left_finger_joint" value="0.04"/>
    <joint name="floating_one" value="0 0 0 0 0 0 1"/></group_state>
  <group_state name="home"><joint name="slide" value="0"/></group_state>
  <virtual_joint name="v" type="fixed" parent_frame="map" child_link="world"/>
  <end_effector name="e" parent_link="hand" group="fingers"/>
  <passive_joint name="right_finger_joint"/>
  <disable_collisions link1="upper" link2="carriage" reason="Adjacent"/>
  <disable_collisions link1="carriage" link2="upper" reason="Never"/>
  <disable_collisions link1="hand" link2="ghost" reason="Never"/>
</robot>
"""


def test_everything_a_chain_needs_is_kept() -> None:
    srdf = parse_srdf(SRDF)
    assert srdf.name == "tree"
    assert dict(srdf.chains) == {"arm": ("carriage", "hand"), "whole": ("rail", "hand")}
    assert srdf.disabled_collisions == {("carriage", "upper"), ("ghost", "hand")}
    assert dict(srdf.states["arm"]["home"]) == {"shoulder": 0.5, "elbow": -1.25}
    assert dict(srdf.states["fingers"]["open"]) == {"left_finger_joint": 0.04}
    assert dict(srdf.states[""]["home"]) == {"slide": 0.0}


def test_what_is_not_obeyed_is_told_by_name() -> None:
    assert parse_srdf(SRDF).notes == (
        "groups of the SRDF that are not one chain are not offered: fingers, both, two",
        "joint 'floating_one' has several values in state 'open' of the SRDF: they are not read",
        "elements and attributes that no motion depends on are not read: end_effector (1)",
    )
    more = (
        '<disable_colisions link1="a" link2="b"/><passive_joint name="elbow"/>'
        '<link_sphere_approximation link="hand"><sphere center="0 0 0" radius="0"/>'
        '</link_sphere_approximation><joint_property joint_name="elbow"/>'
        '<group_state name="s" group="arm"><joint name="elbow" valeu="1" value="0"/></group_state>'
    )
    srdf = parse_srdf(SRDF.replace("</robot>", more + "</robot>"))
    lint = check_semantics(srdf, parse_urdf(TREE))
    for words in (
        "the robot: <disable_colisions> is not read; is 'disable_collisions' meant?",
        "group_state 's': attribute 'valeu' of <joint> is not read; is 'value' meant?",
        "joint 'elbow' is a passive_joint of the SRDF",
        "end_effector (1), joint_property (1), link_sphere_approximation (1)",
    ):
        assert any(words in line for line in lint), words
    assert pickle.loads(pickle.dumps(srdf)).notes == srdf.notes


@pytest.mark.parametrize("seed", range(8))
def test_groups_stand_for_their_links(seed: int) -> None:
    """Random groups of a random tree, each link asked by itself."""
    random = Random(seed)
    carrier = {f"l{k}": f"l{random.randrange(k)}" for k in range(1, 12)}
    links = ["l0", *carrier]
    joints = "".join(
        f'<joint name="j{child[1:]}" type="fixed"><parent link="{parent}"/><child link="{child}"/>'
        "</joint>"
        for child, parent in carrier.items()
    )
    description = parse_urdf(
        f"<robot name='r'>{''.join(f'<link name={name!r}/>' for name in links)}{joints}</robot>"
    )

    def beyond(link: str, other: str) -> bool:
        """Whether a link is another or is carried by it."""
        return link == other or (link in carrier and beyond(carrier[link], other))

    base, tip, single, jointed = (random.choice(links[1:]) for _ in range(4))
    srdf = parse_srdf(
        f'<robot name="r"><group name="chain"><chain base_link="{base}" tip_link="{tip}"/></group>'
        f'<group name="few"><link name="{single}"/><joint name="j{jointed[1:]}"/><link name="x"/>'
        '<group name="all"/></group><group name="all"><group name="chain"/><group name="few"/>'
        '</group><group name="gone"><chain base_link="l0" tip_link="nowhere"/></group></robot>'
    )
    between = {link for link in links if beyond(tip, link) != beyond(base, link)}
    expected = {"chain": between, "few": between | {single, jointed}, "gone": set()}
    expected["all"] = expected["few"]
    found = pickle.loads(pickle.dumps(srdf)).group_links(description)
    assert {name: set(of) for name, of in found.items()} == expected
    assert all(list(of) == sorted(of, key=links.index) for of in found.values())


def test_unknown_names_in_pairs_and_states_are_told() -> None:
    tree = parse_urdf(TREE)
    lint = check_semantics(parse_srdf(SRDF), tree)
    assert "1 pair(s) with links that the robot does not have: 'ghost'" in lint[0]
    assert lint[1:] == parse_srdf(SRDF).notes
    lint = check_semantics(parse_srdf(SRDF.replace('"elbow"', '"knee"')), tree)
    assert any("'knee'" in line and "'home'" in line for line in lint)


def test_pairs_of_another_variant_share_one_line() -> None:
    others = [f"other_{k}" for k in range(30)]
    pairs = "".join(
        f'<disable_collisions link1="{a}" link2="{b}"/>' for a, b in combinations(others, 2)
    )
    lint = check_semantics(
        parse_srdf(SRDF.replace("</robot>", pairs + "</robot>")), parse_urdf(TREE)
    )
    (line,) = (line for line in lint if "other_" in line)
    assert f"{30 * 29 // 2 + 1} pair(s)" in line
    assert all(repr(name) in line for name in ("ghost", *others))


def test_a_link_paired_with_itself_is_told_and_allows_nothing() -> None:
    text = SRDF.replace('link1="hand" link2="ghost"', 'link1="hand" link2="hand"')
    srdf = parse_srdf(text)
    assert srdf.disabled_collisions == {("carriage", "upper")}
    assert pickle.loads(pickle.dumps(srdf)).own_pairs == ("hand",)
    line, *notes = check_semantics(srdf, parse_urdf(TREE))
    assert "'hand' with itself" in line
    assert tuple(notes) == srdf.notes


def may_touch(text: str, a: str, b: str) -> bool:
    """Whether MoveIt lets two links touch, by its own steps.

    ``AllowedCollisionMatrix(srdf)`` sets defaults, then enabled and at last disabled pairs, each
    over what was there; ``getAllowedCollision`` takes a pair's entry before the default of either
    link (moveit/moveit: moveit_core/collision_detection/src/collision_matrix.cpp).
    """
    root = ElementTree.fromstring(text)
    defaults = {e.attrib["link"] for e in root.iter("disable_default_collisions")}
    entries = {}
    for tag, allowed in (("enable_collisions", False), ("disable_collisions", True)):
        for e in root.iter(tag):
            entries[frozenset((e.attrib["link1"], e.attrib["link2"]))] = allowed
    return entries.get(frozenset((a, b)), bool(defaults & {a, b}))


@pytest.mark.parametrize("seed", range(30))
def test_links_may_touch_that_may_in_moveit(seed: int) -> None:
    random = Random(seed)
    links = [f"l{i}" for i in range(6)]

    def pairs(tag: str, count: int) -> list[str]:
        drawn = (random.sample(links, 2) for _ in range(count))
        return [f'<{tag} link1="{a}" link2="{b}" reason="User"/>' for a, b in drawn]

    free = random.sample(links, random.randrange(4))
    elements = [
        *(f'<disable_default_collisions link="{link}"/>' for link in free),
        *pairs("enable_collisions", random.randrange(6)),
        *pairs("disable_collisions", random.randrange(6)),
    ]
    random.shuffle(elements)
    text = f"<robot name='r'>{''.join(elements)}</robot>"
    srdf = pickle.loads(pickle.dumps(parse_srdf(text)))
    expected = {pair for pair in combinations(links, 2) if may_touch(text, *pair)}
    assert srdf.allowed_pairs(links) == expected
    assert srdf.names_allowed_pairs == ("disable" in text)


def test_defaults_are_told_with_what_moveit_would_not_look_at() -> None:
    text = SRDF.replace("</robot>", '<disable_default_collisions link="hand"/></robot>')
    (line,) = (x for x in check_semantics(parse_srdf(text), parse_urdf(TREE)) if "'hand'" in x
               and "ghost" not in x)  # fmt: skip
    assert "disable_default_collisions" in line
    assert "obstacles" in line
    unknown = SRDF.replace("</robot>", '<enable_collisions link1="hand" link2="tail"/></robot>')
    lint = check_semantics(parse_srdf(unknown), parse_urdf(TREE))
    assert any("enables" in line and "'tail'" in line for line in lint)


def test_unknown_link_of_a_chain_is_told() -> None:
    srdf = Semantics("x", chains={"arm": ("rail", "hook")})
    (line,) = check_semantics(srdf, parse_urdf(TREE))
    assert "'arm'" in line
    assert "'hook'" in line


def test_virtual_joints_name_the_root_frame() -> None:
    srdf = parse_srdf(SRDF)
    assert srdf.root_aliases("world") == ("map",)
    assert srdf.root_aliases("rail") == ()
    # moveit_core/robot_model: the planning frame of MoveIt is the parent frame of such a joint.
    floating = parse_srdf(SRDF.replace('name="v" type="fixed"', 'name="v" type="floating"'))
    assert floating.root_aliases("world") == ("map",)
    assert any("'v'" in line and "does not move" in line for line in floating.notes)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<srdf/>", ["<srdf>", "<robot>"]),
        ("<robot><group/></robot>", ["<group>", "'name'"]),
        ('<robot><group name="g"><chain tip_link="t"/></group></robot>', ["'g'", "base_link"]),
        ('<robot><disable_collisions link1="a"/></robot>', ["link2"]),
        ('<robot><group_state group="g"/></robot>', ["<group_state>", "'name'"]),
        (
            '<robot><group_state name="s"><joint name="j" value="nan"/></group_state></robot>',
            ["'s'", "'j'", "nan"],
        ),
        ('<robot><group_state name="s"><joint name="j"/></group_state></robot>', ["'j'", "value"]),
        (SRDF.replace('name="whole"', 'name="arm"'), ["'arm'", "two groups"]),
        (
            '<robot><group_state name="s" group="g"/><group_state name="s" group="g"/></robot>',
            ["'s'", "two states"],
        ),
    ],
)
def test_faults_are_refused(text: str, words: list[str]) -> None:
    with pytest.raises(InvalidRobotDescription) as error:
        parse_srdf(text)
    said = f"{error.value} {error.value.hint}"
    assert all(word in said for word in words), said


def test_every_truncation_is_refused() -> None:
    data = SRDF.rstrip().encode()
    for end in range(0, len(data), 17):
        with pytest.raises(InvalidRobotDescription):
            parse_srdf(data[:end])


def test_flipped_bytes_never_escape() -> None:
    data = SRDF.encode()
    for i in range(0, len(data), 3):
        with contextlib.suppress(InvalidRobotDescription):
            parse_srdf(data[:i] + bytes([(data[i] * 7 + i) % 256]) + data[i + 1 :])


YAML = """
default_velocity_scaling_factor: 0.1
joint_limits:
  elbow:
    has_velocity_limits: true
    max_velocity: 1.5
    has_acceleration_limits: true
    max_acceleration: 3
    has_jerk_limits: false
    max_jerk: 0
    has_position_limits: true
    min_position: -1
    max_position: 1e0
  slide:
    has_velocity_limits: false
    max_velocity: 9.0
"""


def test_one_value_for_all_joints_gives_way_to_named_ones() -> None:
    given = {"elbow": {"acceleration": 7.0}, "*": {"acceleration": 5.0, "jerk": 50.0}}
    limits = serial_chain(parse_urdf(TREE), tip_link="hand", joint_limits=given).limits
    np.testing.assert_array_equal(limits.acceleration, [5, 5, 7])
    np.testing.assert_array_equal(limits.jerk, [50, 50, 50])
    np.testing.assert_array_equal(limits.velocity, [1.5, 2, math.nan])


@pytest.mark.parametrize(
    ("soft", "given", "told"),
    [
        ('soft_lower_limit="-1.5" soft_upper_limit="2.6"', {}, True),
        ('soft_lower_limit="-1.5" soft_upper_limit="2.6"', {"lower": -1.5}, False),
        ('soft_lower_limit="-2" soft_upper_limit="2.5"', {}, False),
        ('k_velocity="10"', {}, False),
        ('soft_lower_limit="0" soft_upper_limit="0"', {}, False),
    ],
)
def test_soft_limits_that_are_narrower_are_told(
    soft: str, given: dict[str, float], told: bool
) -> None:
    limit = '<limit lower="-2" upper="2.5"'
    assert TREE.count(limit) == 1
    tree = parse_urdf(TREE.replace(limit, f"<safety_controller {soft}/>{limit}"))
    chain = serial_chain(tree, tip_link="hand", joint_limits={"elbow": given})
    notes = soft_limit_notes(tuple(tree.joints.values()), chain.limits, chain.joint_names)
    assert [("elbow [-1.5, 2.6]" in note) for note in notes] == [True] * told


def test_moveit_file() -> None:
    read = moveit_joint_limits(YAML)
    assert read == {
        "elbow": {"velocity": 1.5, "acceleration": 3.0, "lower": -1.0, "upper": 1.0},
        "slide": {},
    }


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: [", "no readable YAML"),
        ("limits: {}", "no mapping joint_limits"),
        ("[]", "no mapping joint_limits"),
        ("joint_limits: {elbow: 3}", "'elbow' needs named fields"),
        ("joint_limits: {elbow: {has_jerk_limits: true}}", "'elbow' has has_jerk_limits"),
        ("joint_limits: {elbow: {has_jerk_limits: true, max_jerk: .nan}}", "max_jerk"),
        ("joint_limits: {elbow: {}, elbow: {}}", "twice"),
        ("joint_limits: *x", "stands for nothing"),
    ],
)
def test_texts_that_are_refused(text: str, words: str) -> None:
    with pytest.raises(InvalidRobotDescription, match=words):
        moveit_joint_limits(text)


def test_scaling_factors_that_slow_moveits_plans_are_told() -> None:
    note, off = moveit_notes(YAML + "default_acceleration_scaling_factor: 0.5\n")
    assert "'slide' has no velocity limit in MoveIt" in off
    assert "velocity_scaling_factor 0.1 and default_acceleration_scaling_factor 0.5" in note
    assert moveit_notes(YAML.replace("factor: 0.1", "factor: 1.0")) == [off]
    assert moveit_notes("joint_limits: {}") == []


def test_limits_of_other_joints_are_told() -> None:
    values = {"elbow": {"velocity": 1.0}, "finger": {}, "knee": {}, "*": {"jerk": 1.0}}
    used, lint = limits_of_chain(values, ["elbow"], ["elbow", "finger"])
    assert set(used) == {"elbow", "*"}
    assert len(lint) == 2
    assert "finger" in lint[0]
    assert "off the chain" in lint[0]
    assert "knee" in lint[1]


def test_rules_fill_only_what_is_missing() -> None:
    bare = Limits.unlimited(3)
    limits = replace(
        bare,
        velocity=np.array([1.0, 2.0, math.nan]),
        acceleration=np.array([4.0, math.nan, math.nan]),
    )
    rules = {"jerk": "10 x acceleration", "acceleration": "10 x velocity"}
    ruled, notes = apply_rules(limits, rules, ["a", "b", "c"])
    np.testing.assert_array_equal(ruled.acceleration, [4, 20, math.nan])
    np.testing.assert_array_equal(ruled.jerk, [40, 200, math.nan])
    assert notes == [
        "acceleration limits of b are ruled: 10 x velocity",
        "jerk limits of a, b are ruled: 10 x acceleration",
    ]


@pytest.mark.parametrize(
    ("quantity", "rule"),
    [
        ("acceleration", "ten x velocity"),
        ("acceleration", "10 x acceleration"),
        ("acceleration", "0 x velocity"),
        ("acceleration", "10 velocity"),
        ("jerk", "10 x effort"),
        ("velocity", "10 x velocity"),
    ],
)
def test_rules_that_are_none(quantity: str, rule: str) -> None:
    with pytest.raises(InvalidRobotDescription, match=quantity):
        parse_rule(quantity, rule)


def test_rules_are_read_in_several_spellings() -> None:
    for rule in ("2.5 x velocity", "2.5*velocity", " 2.5 × velocity "):
        assert parse_rule("jerk", rule) == (2.5, "velocity")


def test_limits_count_as_moveit_counts_them() -> None:
    """Of position they have no flag, and others are on where MoveIt 1 finds no flag.

    moveit/moveit: moveit_ros/planning/robot_model_loader/src/robot_model_loader.cpp.
    """
    text = """
joint_limits:
  a: {max_velocity: 1.0, min_position: -2}
  b: {has_velocity_limits: false, max_velocity: 1.0, has_position_limits: true, max_position: 2}
  c: {has_acceleration_limits: false, max_acceleration: 3, has_position_limits: false,
      max_position: 1}
"""
    assert moveit_joint_limits(text) == {
        "a": {"velocity": 1.0, "lower": -2.0}, "b": {"upper": 2.0}, "c": {},
    }  # fmt: skip
    assert moveit_notes(text) == [
        (
            "joint_limits: joint 'b' has no velocity limit in MoveIt (has_velocity_limits is "
            "false): here that of the URDF holds"
        ),
        "joint_limits: joint 'c': max_acceleration is not used, has_acceleration_limits is false",
        "joint_limits: joint 'c': max_position is not used, has_position_limits is false",
    ]


def test_fields_that_are_not_read_are_told() -> None:
    text = "cartesian_limits: {}\njoint_limits: {a: {max_velocty: 1, stiffness: 3, k_position: 2}}"
    assert sorted(moveit_notes(text)) == [
        "joint_limits: cartesian_limits of the text are not read",
        "joint_limits: joint 'a': k_position, of other readers, not read",
        "joint_limits: joint 'a': max_velocty is not read; is 'max_velocity' meant?",
        "joint_limits: joint 'a': stiffness is not read",
    ]
