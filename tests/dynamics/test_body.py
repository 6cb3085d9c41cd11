"""Bodies of a chain and the columns of their rows."""

import pickle
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import ArrayLike

from dynamics.forward import forward_dynamics
from dynamics.inverse import inverse_dynamics
from dynamics.model.body import (
    bodies,
    joints_without_inertia,
    massless_joints,
    scale_masses,
)
from dynamics.terms import mass_matrix
from kinematics.errors import InvalidOption, MissingInertia
from kinematics.model.chain import Chain, Inertia, Link
from tests.dynamics.samples import pinocchio_model, random_chain


def without(chain: Chain, *names: str) -> Chain:
    """The chain with the inertia of some links taken away."""
    links = tuple(
        replace(link, inertia=None) if link.name in names else link for link in chain.links
    )
    return replace(chain, links=links)


@pytest.mark.parametrize("seed", range(10))
def test_merges_like_pinocchio(seed: int) -> None:
    chain = random_chain(seed, 1 + seed % 6)
    packed, model = bodies(chain), pinocchio_model(chain)
    for i in range(chain.n):
        body = model.inertias[i + 1]
        assert packed.masses[i] == pytest.approx(body.mass, rel=1e-13)
        np.testing.assert_allclose(packed.centers[i], body.lever, atol=1e-13)
        np.testing.assert_allclose(packed.tensors[i], body.inertia, atol=1e-13)


def test_a_frame_without_inertia_fixed_to_a_body_adds_nothing() -> None:
    chain = random_chain(1)
    links = (*chain.links, Link("camera_optical", 3, np.eye(4)))
    more = bodies(replace(chain, links=links))
    np.testing.assert_array_equal(more.masses, bodies(chain).masses)
    np.testing.assert_array_equal(more.tensors, bodies(chain).tensors)


def test_a_robot_whose_links_all_lack_an_inertia_is_refused_and_they_are_named() -> None:
    chain = random_chain(1, 4)
    bare = replace(chain, links=tuple(replace(link, inertia=None) for link in chain.links))
    with pytest.raises(MissingInertia, match=r"'joint0', .*'joint3'.*link3, rider, tool") as caught:
        mass_matrix(bare, np.zeros(4))
    assert caught.value.details["joints"] == list(chain.joint_names)


def test_a_joint_beyond_which_nothing_has_inertia_is_massless() -> None:
    whole = random_chain(1, 4)
    chain = without(without(whole, "link3"), "link2")
    q, qd, qdd = np.random.default_rng(5).uniform(-1.0, 1.0, (3, 4))
    D = mass_matrix(chain, q)
    assert not D[2:].any()
    assert not D[:, 2:].any()
    torques = inverse_dynamics(chain, q, qd, qdd)
    model = pinocchio_model(whole)
    for i in (2, 3):
        model.inertias[i + 1] = pin.Inertia.Zero()
    expected = pin.rnea(model, model.createData(), q, qd, qdd)
    np.testing.assert_allclose(torques, expected, atol=1e-10)
    assert joints_without_inertia(chain) == ("joint2", "joint3")
    with pytest.raises(MissingInertia, match="'joint2'"):
        forward_dynamics(chain, q, qd, torques)


def test_a_motor_is_an_inertia_to_its_joint() -> None:
    chain = without(random_chain(1, 3), "link2")
    driven = replace(chain, motor_inertia=np.array([0.0, 0.0, 0.2]))
    assert joints_without_inertia(chain) == ("joint2",)
    assert joints_without_inertia(driven) == ()
    q, qd, qdd = np.random.default_rng(6).uniform(-1.0, 1.0, (3, 3))
    torques = inverse_dynamics(driven, q, qd, qdd)
    np.testing.assert_allclose(forward_dynamics(driven, q, qd, torques), qdd, atol=1e-9)


def test_one_of_two_bodies_of_a_joint_is_enough() -> None:
    # Joint 0 carries a second body, so one of the two is enough.
    assert bodies(without(random_chain(1, 4), "link0")).masses[0] > 0.0


def test_links_without_inertia_are_massless_where_a_later_one_has_some() -> None:
    """As pinocchio has it, where the body has mass 0."""
    whole = random_chain(1, 4)
    chain = without(whole, "link1")
    assert massless_joints(chain) == (1,)
    assert massless_joints(whole) == ()
    zero = Inertia(0.0, np.zeros(3), np.zeros((3, 3)))
    links = tuple(replace(k, inertia=zero) if k.name == "link1" else k for k in whole.links)
    model = pinocchio_model(replace(whole, links=links))
    data, rng = model.createData(), np.random.default_rng(5)
    for q, qd, qdd in rng.uniform(-2.0, 2.0, (20, 3, 4)):
        expected = pin.rnea(model, data, q, qd, qdd)
        np.testing.assert_allclose(inverse_dynamics(chain, q, qd, qdd), expected, atol=1e-10)
        back = forward_dynamics(chain, q, qd, expected)
        np.testing.assert_allclose(back, qdd, atol=1e-7)


def test_inertia_without_mass_counts() -> None:
    chain = without(random_chain(1, 3), "link2")
    rotor = Link("rotor", 2, np.eye(4), Inertia(0.0, np.zeros(3), np.diag([1.0, 2.0, 3.0])))
    packed = bodies(replace(chain, links=(*chain.links, rotor)))
    assert packed.masses[2] == 0.0
    np.testing.assert_array_equal(packed.tensors[2], np.diag([1.0, 2.0, 3.0]))


def test_the_base_does_not_count() -> None:
    chain = random_chain(2)
    assert "base" in without(chain, "base").index
    np.testing.assert_array_equal(bodies(without(chain, "base")).masses, bodies(chain).masses)


def test_arrays_are_read_only_and_survive_pickling() -> None:
    packed = bodies(random_chain(2))
    for array in packed:
        assert not array.flags.writeable
    copy = pickle.loads(pickle.dumps(packed))
    np.testing.assert_array_equal(copy.tensors, packed.tensors)


def test_gravity_can_be_replaced() -> None:
    chain = random_chain(2)
    np.testing.assert_array_equal(bodies(chain, [0, 0, -1.62]).gravity, [0, 0, -1.62])
    np.testing.assert_array_equal(bodies(chain).gravity, chain.gravity)
    for wrong in ([0.0, 0.0], [0.0, 0.0, np.inf]):
        with pytest.raises(InvalidOption, match="gravity"):
            bodies(chain, wrong)


def test_scaled_masses_scale_the_mass_matrix() -> None:
    chain = random_chain(3)
    q = np.linspace(-1, 1, chain.n)
    np.testing.assert_allclose(
        mass_matrix(scale_masses(chain, 1.7), q), 1.7 * mass_matrix(chain, q), rtol=1e-12
    )
    factors = np.linspace(0.5, 2.0, chain.n)
    np.testing.assert_allclose(
        bodies(scale_masses(chain, factors)).masses, factors * bodies(chain).masses, rtol=1e-14
    )


@pytest.mark.parametrize("factors", [0.0, -1.0, np.nan, np.inf, [1.0, 2.0], [[1.0] * 6]])
def test_wrong_factors_are_refused(factors: ArrayLike) -> None:
    with pytest.raises(InvalidOption, match="6, one for each joint"):
        scale_masses(random_chain(3), factors)
