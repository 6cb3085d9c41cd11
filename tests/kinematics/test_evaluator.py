"""The evaluator answers what the checked functions do."""

import numpy as np
import pytest

from kinematics.errors import InvalidLinkName, InvalidRobotState
from kinematics.evaluator import KinematicsEvaluator
from kinematics.forward import forward, link_poses
from kinematics.jacobian import geometric
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
