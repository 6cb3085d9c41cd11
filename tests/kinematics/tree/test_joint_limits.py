"""Limits of joints: for all of them, of MoveIt's file, and by rules."""

import math
from dataclasses import replace

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
from kinematics.urdf.urdf import parse_urdf
from tests.kinematics.samples import TREE

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
