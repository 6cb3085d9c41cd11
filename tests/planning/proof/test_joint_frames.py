"""The proof's frames of the joints beside pinocchio's and beside those that planners use."""

import numpy as np
import pinocchio as pin
import pytest

from kinematics.forward import frames_kernel
from planning.proof.joint_frames import forward_kernel
from tests.dynamics.samples import pinocchio_model, random_chain


@pytest.mark.parametrize("seed", range(8))
def test_frames_are_those_of_pinocchio_and_of_the_planners(seed: int) -> None:
    chain = random_chain(seed, 1 + seed)
    model = pinocchio_model(chain)
    data = model.createData()
    rng = np.random.default_rng(seed)
    own, planners = np.zeros((2, chain.n, 4, 4))
    for _ in range(20):
        q = rng.uniform(-3.0, 3.0, chain.n)
        forward_kernel(chain.joint_types, chain.offsets, q, own)
        frames_kernel(chain.model, q, planners)
        assert np.array_equal(own, planners)
        pin.forwardKinematics(model, data, q)
        for j in range(chain.n):
            expected = data.oMi[j + 1].homogeneous[:3]
            np.testing.assert_allclose(own[j, :3], expected, atol=1e-13)
