"""The choice among solutions, whole turns, and the method that is taken."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from kinematics.errors import InvalidOption, InvalidRobotState, NotAvailable
from kinematics.forward import forward
from kinematics.ik.closed_form.analytic import branches
from kinematics.ik.inverse import IkOptions, inverse_kinematics
from kinematics.ik.ranking import margin, order, outside, whole_turns
from kinematics.jacobian import geometric
from kinematics.model.chain import Limits
from kinematics.pose import transform
from kinematics.robots import builtin_chain
from tests.kinematics.ik.arms import apart


def test_whole_turns_are_all_there_are() -> None:
    rng = np.random.default_rng(0)
    for name in ("ur5e", "kr6_sixx", "puma560", "scara", "stanford"):
        chain = builtin_chain(name)
        lower, upper = chain.limits.lower, chain.limits.upper
        for _ in range(20):
            q = rng.uniform(lower, upper)
            turning = chain.joint_types == 0
            turns = np.array(list(itertools.product((-2, -1, 0, 1, 2), repeat=chain.n)))
            copies = q + 2 * np.pi * turns * turning
            inside = ((copies >= lower) & (copies <= upper)).all(axis=1)
            expected = {tuple(row) for row in np.round(copies[inside], 9)}
            found = whole_turns(chain, q, 10_000)
            assert {tuple(np.round(row, 9)) for row in found} == expected
            assert len(found) == len(expected)
            distances = np.linalg.norm(found - q, axis=1)
            assert (np.diff(distances) >= -1e-12).all()
            np.testing.assert_array_equal(found[0], q)
            few = whole_turns(chain, q, 3)
            np.testing.assert_allclose(
                np.linalg.norm(few - q, axis=1), distances[: len(few)], atol=1e-12
            )


def test_whole_turns_outside_and_without_limits() -> None:
    chain = builtin_chain("planar_rr")
    assert len(whole_turns(chain, np.array([0.0, 3.0]), 10)) == 0
    pendulum = builtin_chain("cart_pendulum")
    assert len(whole_turns(pendulum, np.array([0.0, 1.0]), 10)) == 3
    assert len(whole_turns(pendulum, np.array([2.0, 1.0]), 10)) == 0


def test_orders_by_their_definitions() -> None:
    chain = builtin_chain("ur5e")
    seed = np.array([0.3, -1.0, 1.4, -0.7, -1.3, 0.2])
    joints = branches(chain, forward(chain, seed)).joints
    ranked = joints[order(chain, joints, "nearest", seed)]
    assert (np.diff(np.linalg.norm(ranked - seed, axis=1)) >= -1e-9).all()
    ranked = joints[order(chain, joints, "limits", seed)]
    assert (np.diff(margin(chain, ranked)) >= -1e-9).all()
    ranked = joints[order(chain, joints, "manipulability", seed)]
    volumes = np.sqrt([np.linalg.det(J @ J.T) for J in geometric(chain, ranked)])
    assert (np.diff(volumes) <= 1e-9).all()
    with pytest.raises(InvalidOption, match="best"):
        order(chain, joints, "best", seed)  # type: ignore[arg-type]
    assert "elbow" in str(outside(chain, np.array([0.0, 0.0, 4.0, 0.0, 0.0, 0.0])))
    assert outside(chain, np.zeros(6)) is None
    assert margin(builtin_chain("cart_pendulum"), np.array([[1.5, 9.0]])) == pytest.approx(1.0)


def test_all_solutions_with_whole_turns() -> None:
    chain = builtin_chain("ur5e")
    q = np.array([0.3, -1.0, 1.4, -0.7, -1.3, 0.2])
    T = forward(chain, q)
    eight = inverse_kinematics(chain, T, IkOptions(most=100)).solutions
    assert len(eight) == 8
    many = inverse_kinematics(
        chain, T, IkOptions(most=1000, all_turns=True), seed_joints=q
    ).solutions
    # Two whole turns of each joint but the elbow, which turns once.
    assert len(many) == 8 * 2**5
    assert len({tuple(np.round(s.joints, 6)) for s in many}) == len(many)
    assert np.abs(forward(chain, np.array([s.joints for s in many])) - T).max() < 1e-9
    distances = [np.linalg.norm(s.joints - q) for s in many]
    # Turns that are as far either way are equal but for rounding.
    assert np.diff(distances).min() >= -1e-12
    np.testing.assert_allclose(many[0].joints, q, atol=1e-9)


def test_solutions_outside_limits_come_last_and_say_so() -> None:
    chain = builtin_chain("puma560")
    q = np.array([2.7, -3.8, 3.8, 2.9, 1.7, -4.6])
    T = forward(chain, q)
    inside = inverse_kinematics(chain, T, IkOptions(most=100)).solutions
    every = inverse_kinematics(chain, T, IkOptions(most=100, outside_limits=True)).solutions
    assert len(every) == 8
    flags = [s.within_limits for s in every]
    assert flags == sorted(flags, reverse=True)
    assert sum(flags) == len(inside) < 8
    assert all(outside(chain, s.joints) is not None for s in every if not s.within_limits)
    assert len({s.branch for s in every}) == 8


@pytest.mark.parametrize("name", ["panda", "iiwa14"])
def test_redundant_arms_by_parameter_by_seed_and_all_around(name: str) -> None:
    chain = builtin_chain(name)
    rng = np.random.default_rng(2)
    lower, upper = chain.sampling_bounds()
    for _ in range(30):
        q = rng.uniform(lower, upper)
        T = forward(chain, q)
        near = inverse_kinematics(chain, T, seed_joints=q).solutions[0]
        np.testing.assert_allclose(near.joints, q, atol=1e-6)
        assert near.branch is not None
        analytic = inverse_kinematics(chain, T, IkOptions(method="analytic")).solutions
        assert analytic
        assert analytic[0].within_limits
        assert np.abs(forward(chain, analytic[0].joints) - T).max() < 2e-9
    many = inverse_kinematics(chain, T, IkOptions(most=500)).solutions
    assert len(many) > 8
    assert len({s.branch for s in many}) == len(many)
    for solution in many:
        assert apart(forward(chain, solution.joints).ravel(), T.ravel()) < 2e-9


def test_methods_and_their_refusals() -> None:
    chain = builtin_chain("scara")
    T = forward(chain, np.array([0.3, 0.5, 0.1, 0.2]))
    with pytest.raises(NotAvailable):
        inverse_kinematics(builtin_chain("cart_pendulum"), T, IkOptions(method="analytic"))
    with pytest.raises(InvalidOption, match="magic"):
        IkOptions(method="magic")  # type: ignore[arg-type]
    with pytest.raises(InvalidOption, match="ranking 'best'"):
        IkOptions(ranking="best")  # type: ignore[arg-type]
    with pytest.raises(InvalidOption, match="axes"):
        IkOptions(method="analytic", axes=["x"])
    with pytest.raises(InvalidOption, match="most"):
        IkOptions(most=0)
    with pytest.raises(InvalidRobotState):
        inverse_kinematics(chain, T, seed_joints=[0.0])
    far = inverse_kinematics(builtin_chain("ur5e"), transform(None, [3.0, 0.0, 0.0]))
    assert not far.solutions
    assert "reach" in far.advice
    ur5e = builtin_chain("ur5e")
    T = forward(ur5e, [0.3, -1.0, 1.4, -0.7, -1.3, 0.2])
    numeric = inverse_kinematics(ur5e, T, IkOptions(method="numeric"))
    assert numeric.solutions[0].branch is None


def test_a_joint_that_cannot_move_is_as_far_from_its_limits_as_it_will_be() -> None:
    chain = builtin_chain("ur5e")
    lower, upper = chain.limits.lower.copy(), chain.limits.upper.copy()
    lower[1] = upper[1] = 0.3
    lower[4], upper[4] = -np.inf, np.inf
    fixed = replace(chain, limits=replace(chain.limits, lower=lower, upper=upper))
    joints = np.tile(0.5 * (chain.limits.lower + chain.limits.upper), (3, 1))
    joints[:, 1] = 0.3
    joints[1, 4] = 100.0
    joints[2, 0] = chain.limits.upper[0]
    np.testing.assert_allclose(margin(fixed, joints), [0.0, 0.0, 1.0], atol=1e-12)
    unlimited = replace(chain, limits=Limits.unlimited(6))
    assert margin(unlimited, joints).tolist() == [0.0, 0.0, 0.0]


def test_costs_that_differ_by_rounding_keep_their_order() -> None:
    chain = builtin_chain("ur5e")
    seed = np.zeros(6)
    joints = np.array([np.full(6, 1.0 + 1e-15), np.full(6, 1.0), np.full(6, 0.5)])
    assert order(chain, joints, "nearest", seed).tolist() == [2, 0, 1]


def test_what_is_outside_a_limit_is_named_with_the_limit() -> None:
    chain = builtin_chain("ur5e")
    lower, upper = chain.limits.lower, chain.limits.upper
    assert outside(chain, lower) is None
    assert outside(chain, upper) is None
    for values, side in ((lower, -1.0), (upper, 1.0)):
        for j in range(6):
            q = 0.5 * (lower + upper)
            q[j] = values[j] + side * 1e-3
            said = outside(chain, q)
            assert said is not None
            assert repr(chain.joint_names[j]) in said


def test_a_slide_has_no_whole_turns() -> None:
    chain = builtin_chain("scara")
    slide = int(np.flatnonzero(chain.joint_types == 1)[0])
    q = 0.5 * (chain.limits.lower + chain.limits.upper)
    copies = whole_turns(chain, q, 100)
    assert len(copies) >= 1
    assert (copies[:, slide] == q[slide]).all()
    q[slide] = chain.limits.upper[slide] + 1e-3
    assert len(whole_turns(chain, q, 100)) == 0
