"""Limits merged into a URDF, read back by our reader and by pinocchio."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from kinematics.errors import InvalidRobotDescription
from kinematics.forward import forward
from kinematics.model.chain import Chain, Limits
from kinematics.robots import builtin_chain, builtin_urdf
from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from kinematics.urdf.writer import with_limits


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
