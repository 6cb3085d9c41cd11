"""The chain as a value: limits, links, configurations, its packed model and its hash."""

import pickle
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from kinematics.errors import InvalidLinkName, InvalidRobotState, MissingLimit
from kinematics.model.chain import Chain, Inertia, JointType, Limits, Link
from kinematics.pose import transform
from kinematics.robots import builtin_chain
from tests.kinematics.samples import random_chain

QUANTITIES = [item.name for item in fields(Limits)]


@pytest.fixture(scope="module")
def chain() -> Chain:
    return random_chain(np.random.default_rng(11), 5)


# ------------------------------------------------------------------------------------ limits


def test_unlimited_positions_are_open_and_all_else_is_not_given() -> None:
    limits = Limits.unlimited(3)
    assert limits.require("lower", "abc").tolist() == [-np.inf] * 3
    assert limits.require("upper", "abc").tolist() == [np.inf] * 3
    for quantity in QUANTITIES[2:]:
        assert np.isnan(getattr(limits, quantity)).all()


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_given_limits_are_answered_as_they_are(quantity: str) -> None:
    values = {name: np.full(2, k + 1.0) for k, name in enumerate(QUANTITIES)}
    np.testing.assert_array_equal(Limits(**values).require(quantity, "ab"), values[quantity])


@pytest.mark.parametrize("quantity", ["velocity", "acceleration", "jerk", "effort"])
def test_every_joint_without_the_limit_is_named(quantity: str) -> None:
    limits = replace(Limits.unlimited(3), **{quantity: np.array([np.nan, 2.0, np.nan])})
    with pytest.raises(MissingLimit, match=rf"no {quantity} limit .* a, c\. Give it") as caught:
        limits.require(quantity, ["a", "b", "c"])
    assert dict(caught.value.details) == {"quantity": quantity, "joints": ["a", "c"]}
    assert f'"a": {{"{quantity}"' in (caught.value.hint or "")


def test_sampling_bounds_are_the_limits_or_one_turn() -> None:
    base = random_chain(np.random.default_rng(1), 4)
    lower = np.array([-np.inf, -1.0, np.nan, -0.5])
    upper = np.array([np.inf, 2.0, 3.0, np.nan])
    low, high = replace(
        base, limits=replace(base.limits, lower=lower, upper=upper)
    ).sampling_bounds()
    np.testing.assert_array_equal(low, [-np.pi, -1.0, -np.pi, -0.5])
    np.testing.assert_array_equal(high, [np.pi, 2.0, 3.0, np.pi])


def test_a_single_limit_beyond_the_turn_gets_the_turn_next_to_it() -> None:
    base = random_chain(np.random.default_rng(1), 2)
    lower, upper = np.array([5.0, -np.inf]), np.array([np.inf, -4.0])
    limits = replace(base.limits, lower=lower, upper=upper)
    low, high = replace(base, limits=limits).sampling_bounds()
    np.testing.assert_allclose(low, [5.0, -4.0 - 2.0 * np.pi])
    np.testing.assert_allclose(high, [5.0 + 2.0 * np.pi, -4.0])


# ------------------------------------------------------------------------------------- links


def test_links_are_found_by_name(chain: Chain) -> None:
    for i, link in enumerate(chain.links):
        assert chain.link(link.name) is link
        assert chain.index[link.name] == i
    assert chain.tip is chain.link(chain.tip_link)
    assert chain.n == len(chain.joint_names) == 5


def test_an_unknown_link_is_answered_with_those_there_are(chain: Chain) -> None:
    with pytest.raises(InvalidLinkName, match="no link 'elbow'") as caught:
        chain.link("elbow")
    assert all(link.name in (caught.value.hint or "") for link in chain.links)
    assert caught.value.details["links"] == [link.name for link in chain.links]


# ---------------------------------------------------------------------------- configurations


@pytest.mark.parametrize("shape", [(5,), (1, 5), (7, 5), (2, 3, 5), (0, 5)])
def test_configurations_keep_shape_and_values(chain: Chain, shape: tuple[int, ...]) -> None:
    q = np.random.default_rng(0).normal(size=shape)
    for form in (q, q.tolist(), q.astype(np.float32), np.asfortranarray(q)):
        if np.shape(form) != shape:  # an empty list has lost its columns
            continue
        answer = chain.configuration(form)
        np.testing.assert_array_equal(answer, np.asarray(form, dtype=np.float64))
        assert answer.flags.c_contiguous
    answer = chain.configuration(q)
    assert answer is not q
    assert not np.shares_memory(answer, q)


@pytest.mark.parametrize(
    ("q", "words"),
    [
        ([0.0] * 4, "4 value.*has 5 joints"),
        ([[0.0] * 6] * 2, "6 value"),
        (np.zeros((5, 1)), "1 value"),
        (0.0, "no value"),
        ([], "0 value"),
        ([0.0, 0.0, np.nan, 0.0, 0.0], "not finite at joint 'joint_2'"),
        ([[0.0] * 5, [0.0, 0.0, 0.0, 0.0, -np.inf]], "not finite at joint 'joint_4'"),
        (["a", 0, 0, 0, 0], "not an array of numbers"),
        ([[0.0] * 5, [0.0]], "not an array of numbers"),
        (None, "no value|not finite|not an array"),
    ],
)
def test_malformed_configurations_are_refused(chain: Chain, q: ArrayLike, words: str) -> None:
    with pytest.raises(InvalidRobotState, match=words) as caught:
        chain.configuration(q, "start")
    assert caught.value.message.startswith("start ")


# ------------------------------------------------------------------------------- the model


def test_motors_gravity_and_friction_have_defaults(chain: Chain) -> None:
    np.testing.assert_array_equal(chain.gravity, [0.0, 0.0, -9.81])
    assert chain.motor_inertia.tolist() == chain.viscous_friction.tolist() == [0.0] * 5


# ------------------------------------------------------------------------------------- hash


def changed(chain: Chain) -> dict[str, Chain]:
    """The chain with one field of each kind changed a little."""
    joint = JointType.PRISMATIC if chain.joint_types[0] == 0 else JointType.REVOLUTE
    offsets = chain.offsets.copy()
    offsets[2, 0, 3] += 1e-12
    limits = {
        f"limits.{name}": replace(chain, limits=replace(chain.limits, **{name: np.full(5, 0.5)}))
        for name in QUANTITIES
    }
    body = Inertia(1.0, np.zeros(3), np.eye(3))

    def with_body(inertia: Inertia) -> Chain:
        first = replace(chain.links[1], inertia=inertia)
        return replace(chain, links=(chain.links[0], first, *chain.links[2:]))

    return limits | {
        "name": replace(chain, name="other"),
        "joint_names": replace(chain, joint_names=("x", *chain.joint_names[1:])),
        "joint_types": replace(chain, joint_types=np.array([joint, *chain.joint_types[1:]])),
        "offsets": replace(chain, offsets=offsets),
        "tip_link": replace(chain, tip_link=chain.links[1].name),
        "base_link": replace(chain, base_link="elsewhere"),
        "continuous": replace(chain, continuous=np.ones(5, dtype=np.bool_)),
        "gravity": replace(chain, gravity=np.array([0.0, 0.0, -1.62])),
        "motor_inertia": replace(chain, motor_inertia=np.full(5, 0.1)),
        "viscous_friction": replace(chain, viscous_friction=np.full(5, 0.1)),
        "link": replace(chain, links=(*chain.links, Link("camera", 1, transform()))),
        "link frame": replace(
            chain, links=(*chain.links[:-1], replace(chain.tip, T_joint_link=transform()))
        ),
        "inertia": with_body(body),
        "mass": with_body(replace(body, mass=2.0)),
        "center of mass": with_body(replace(body, center_of_mass=np.array([0.0, 0.0, 0.1]))),
        "tensor": with_body(replace(body, tensor=2.0 * np.eye(3))),
    }


def test_every_field_counts_in_equality_and_hash(chain: Chain) -> None:
    variants = changed(chain)
    hashes = {name: variant.content_hash for name, variant in variants.items()}
    assert len(set(hashes.values()) | {chain.content_hash}) == len(variants) + 1
    for name, variant in variants.items():
        assert variant != chain, name


def test_equal_content_is_equal_whatever_was_computed_with_it(chain: Chain) -> None:
    other = replace(chain)
    other.memo["note"] = "cached"
    assert other == chain
    assert hash(other) == hash(chain)
    assert chain != "random"
    assert {chain: 1}[other] == 1


def test_pickling_keeps_content_and_drops_what_was_cached(chain: Chain) -> None:
    whole = builtin_chain("panda")
    for original in (chain, whole):
        original.memo["note"] = lambda: None  # could not be pickled
        again: Any = pickle.loads(pickle.dumps(original))
        assert again == original
        assert again.memo == {}
        np.testing.assert_array_equal(again.model, original.model)
        del original.memo["note"]
