"""Joints off the chain that mimic one of it, against pinocchio with the mimics as joints."""

import pickle

import numpy as np
import pytest

from kinematics.errors import InvalidLinkName, InvalidOption, InvalidRobotDescription
from kinematics.forward import forward, link_poses
from kinematics.ik.inverse import inverse_kinematics
from kinematics.jacobian import geometric, geometric_rate, pose_and_jacobian
from kinematics.model.chain import Chain, parents
from kinematics.tree.serial_chain import select, serial_chain
from kinematics.urdf.urdf import parse_urdf
from tests.mimic_joints import MIMIC_JOINTS, configurations, mimic_positions, mimic_robot, urdf
from tests.planning.pinocchio_arm import PinocchioArm

CARRIED = ("crank", "rod", "cover", "flap", "piston", "drum")


@pytest.fixture(scope="module")
def chain() -> Chain:
    return mimic_robot().chain


@pytest.fixture(scope="module")
def oracle(chain: Chain) -> PinocchioArm:
    """The arm in pinocchio, in which the mimic joints are joints like the others."""
    return PinocchioArm(urdf=urdf(), chain=chain, others=mimic_positions)


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
    states = configurations(20, 1)
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
    other = serial_chain(parse_urdf(urdf().replace('"0.08"', '"0.09"')), tip_link="flange")
    assert other.content_hash != chain.content_hash


def test_a_multiplier_of_zero_holds_the_joint() -> None:
    fixed = (("stay", "revolute", "fore", "cover", "0 0 0.3", "0 0 1", "j2", 0.0, 0.5),)
    description = parse_urdf(urdf(fixed))
    assert select(description, tip_link="flange").held["stay"] == 0.5
    assert serial_chain(description, tip_link="flange").mimic_joints == ()


def test_goals_and_tips_on_mimic_joints_are_refused(chain: Chain) -> None:
    with pytest.raises(InvalidOption, match=r"'flap'.*mimics"):
        inverse_kinematics(chain, np.eye(4), link="flap")
    with pytest.raises(InvalidRobotDescription, match="mimics"):
        serial_chain(parse_urdf(urdf()), tip_link="flap")
    with pytest.raises(InvalidLinkName, match="'nowhere'"):
        forward(chain, np.zeros(6), "nowhere")


def test_a_chain_on_its_own_mimic_joint_is_refused() -> None:
    carrier = (
        '<link name="floor"/><joint name="lift" type="prismatic"><parent link="floor"/>'
        '<child link="base"/><axis xyz="0 0 1"/><limit lower="0" upper="1"/>'
        '<mimic joint="j1"/></joint></robot>'
    )
    text = urdf(()).replace("</robot>", carrier)
    with pytest.raises(InvalidRobotDescription, match=r"'lift' carries the chain.*'j1'"):
        serial_chain(parse_urdf(text), "base", "flange")


def _one(limits: str, multiplier: float, offset: float, kind: str = "revolute") -> str:
    mimic = ("cover_joint", kind, "fore", "cover", "0.2 0 0.1", "1 0 0", "j4")
    return urdf(((*mimic, multiplier, offset),), limits)


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
