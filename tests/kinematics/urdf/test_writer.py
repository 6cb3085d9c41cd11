"""URDF written of chains, read back by our reader and by pinocchio."""

import numpy as np
import pinocchio as pin
import pytest

from kinematics.errors import InvalidRobotDescription
from kinematics.forward import forward
from kinematics.model.chain import Chain
from kinematics.model.dh import chain_from_dh, dh_from_chain
from kinematics.model.dh_table import DhRow, DhTable
from kinematics.pose import from_rpy, transform
from kinematics.robots import builtin_chain
from kinematics.tree.description import (
    BoxGeometry,
    CapsuleGeometry,
    CollisionElement,
    SphereGeometry,
)
from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from kinematics.urdf.writer import urdf_text

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


@pytest.mark.parametrize("name", ["panda", "puma560", "stanford"])
def test_the_round_trip_of_urdf_and_table_is_exact(name: str) -> None:
    first = builtin_chain(name)
    second = back(chain_from_dh(name, dh_from_chain(first)))
    third = back(chain_from_dh(name, dh_from_chain(second)))
    q = np.random.default_rng(2).uniform(-2.0, 2.0, (20, first.n))
    np.testing.assert_allclose(forward(second, q), forward(first, q), rtol=0, atol=1e-12)
    np.testing.assert_allclose(forward(third, q), forward(first, q), rtol=0, atol=1e-12)


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
