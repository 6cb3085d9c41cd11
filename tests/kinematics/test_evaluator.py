"""The evaluator answers what the checked functions do."""

import numpy as np
import pytest
from numpy.typing import ArrayLike

from kinematics.errors import InvalidLinkName, InvalidRobotState
from kinematics.evaluator import KinematicsEvaluator
from kinematics.forward import forward, link_poses
from kinematics.jacobian import geometric, pose_and_jacobian
from kinematics.robots import builtin_chain
from tests.kinematics.samples import random_chain


def test_equals_the_checked_functions() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        chain = random_chain(rng)
        q = rng.uniform(-3, 3, chain.n)
        for link in chain.links:
            one = KinematicsEvaluator(chain, link.name).copy()
            np.testing.assert_array_equal(one.pose(q), forward(chain, q, link.name))
            np.testing.assert_array_equal(one.jacobian(q), geometric(chain, q, link.name))
            T, J = one.pose_and_jacobian(q)
            np.testing.assert_allclose(T, forward(chain, q, link.name), atol=1e-15)
            np.testing.assert_allclose(J, geometric(chain, q, link.name), atol=1e-14)
            np.testing.assert_array_equal(one.link_poses(q), link_poses(chain, q))


def test_what_is_refused() -> None:
    chain = random_chain(np.random.default_rng(2), 3)
    one = KinematicsEvaluator(chain)
    for q in (np.zeros(2), np.full(3, np.nan)):
        for method in (one.pose, one.jacobian, one.link_poses, one.pose_and_jacobian):
            with pytest.raises(InvalidRobotState):
                method(q)
    with pytest.raises(InvalidLinkName, match="nowhere"):
        KinematicsEvaluator(chain, "nowhere")


def test_joints_in_any_form_give_the_same_answers() -> None:
    chain = builtin_chain("panda")
    q = np.random.default_rng(5).uniform(-1.0, 1.0, chain.n)
    apart, frozen = np.zeros((chain.n, 2)), q.copy()
    apart[:, 0] = q
    frozen.setflags(write=False)
    forms: list[ArrayLike] = [
        apart[:, 0],
        q[::-1].copy()[::-1],
        frozen,
        q.astype(">f8"),
        list(q),
        np.ma.array(q),
    ]
    for form in forms:
        np.testing.assert_array_equal(forward(chain, form), forward(chain, q))
        np.testing.assert_array_equal(link_poses(chain, form), link_poses(chain, q))
        np.testing.assert_array_equal(geometric(chain, form), geometric(chain, q))
        for one, other in zip(
            pose_and_jacobian(chain, form), pose_and_jacobian(chain, q), strict=True
        ):
            np.testing.assert_array_equal(one, other)


def test_numbers_that_are_not_one_beside_the_other_are_refused() -> None:
    chain = builtin_chain("panda")
    with pytest.raises(InvalidRobotState, match="one configuration"):
        KinematicsEvaluator(chain).pose(np.zeros((chain.n, 2))[:, 0])
