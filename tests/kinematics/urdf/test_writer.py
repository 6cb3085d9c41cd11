"""URDF and SRDF of a chain, read back."""

from dataclasses import replace

import numpy as np
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
    SphereGeometry,
)
from kinematics.tree.serial_chain import serial_chain
from kinematics.tree.srdf import named_states, parse_srdf
from kinematics.urdf.urdf import parse_urdf
from kinematics.urdf.writer import srdf_text, urdf_text, with_limits

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
