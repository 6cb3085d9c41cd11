"""Forward kinematics against pinocchio on real robots, and against plain matrix products."""

import numpy as np
import pytest
from numpy.typing import ArrayLike

from compiled.kernel import kernel
from kinematics import forward as module
from kinematics.arrays import Array
from kinematics.errors import InvalidLinkName, InvalidRobotState
from kinematics.forward import forward, joint_frames, link_poses
from kinematics.jacobian import geometric
from kinematics.model.chain import JointType
from kinematics.pose import rotation_z, transform
from tests.kinematics.samples import Sample, configurations, random_chain, reference, samples


@pytest.mark.parametrize("sample", samples(), ids=lambda sample: sample.name)
def test_every_link_stands_where_pinocchio_puts_it(sample: Sample) -> None:
    arm = reference(sample)
    chain = arm.chain
    for q in configurations(chain, 5):
        poses = link_poses(chain, q)
        for link, T in zip(chain.links, poses, strict=True):
            np.testing.assert_allclose(T, arm.pose(q, link.name), atol=1e-12, rtol=0)
        np.testing.assert_array_equal(forward(chain, q), poses[chain.index[chain.tip_link]])


def test_equals_the_product_of_the_joints() -> None:
    rng = np.random.default_rng(5)
    for _ in range(50):
        chain = random_chain(rng)
        q = rng.uniform(-3, 3, chain.n)
        T = np.eye(4)
        for i in range(chain.n):
            turns = chain.joint_types[i] == JointType.REVOLUTE
            motion = transform(rotation_z(q[i])) if turns else transform(position=[0, 0, q[i]])
            T = T @ chain.offsets[i] @ motion
            np.testing.assert_allclose(joint_frames(chain, q)[i], T, atol=1e-13)
        np.testing.assert_allclose(forward(chain, q), T @ chain.tip.T_joint_link, atol=1e-13)


@pytest.mark.parametrize("sample", samples(), ids=lambda sample: sample.name)
def test_batches_are_where_pinocchio_puts_them(sample: Sample) -> None:
    arm = reference(sample)
    chain = arm.chain
    q = np.array(list(configurations(chain, 21)))
    poses, tips = link_poses(chain, q), forward(chain, q)
    for k, row in enumerate(q):
        for link, T in zip(chain.links, poses[k], strict=True):
            np.testing.assert_allclose(T, arm.pose(row, link.name), atol=1e-12, rtol=0)
        np.testing.assert_array_equal(tips[k], poses[k, chain.index[chain.tip_link]])
        np.testing.assert_array_equal(poses[k], link_poses(chain, row))


def test_frames_stay_rigid_far_out() -> None:
    rng = np.random.default_rng(7)
    for _ in range(20):
        chain = random_chain(rng)
        T = link_poses(chain, rng.uniform(-1e3, 1e3, chain.n))
        R = T[:, :3, :3]
        np.testing.assert_allclose(
            R @ R.transpose(0, 2, 1), np.tile(np.eye(3), (len(T), 1, 1)), atol=1e-13
        )
        np.testing.assert_array_equal(T[:, 3], np.tile([0, 0, 0, 1], (len(T), 1)))


def test_what_is_refused() -> None:
    chain = random_chain(np.random.default_rng(8), 3)
    wrong: list[ArrayLike] = [[0, 0], 0.0, [0, 0, 0, 0], [0, np.nan, 0], [0, 0, np.inf]]
    wrong += [["a", "b", "c"], [[0, 0]]]
    for q in wrong:
        with pytest.raises(InvalidRobotState):
            forward(chain, q)
    with pytest.raises(InvalidLinkName, match="nowhere") as error:
        forward(chain, [0, 0, 0], "nowhere")
    assert "link_2" in (error.value.hint or "")
    with pytest.raises(InvalidLinkName):
        link_poses(chain, [0, 0, 0], ["base", "nowhere"])


@kernel
def rows_kernel(q: Array) -> Array:
    """Two rows that are alike."""
    rows = np.empty((2, q.shape[0]))
    rows[:] = q
    return rows


def test_one_configuration_out_of_a_kernel_is_one_like_any_other(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """numba answers arrays whose type of numbers is equal to numpy's own, and not the same."""
    chain = random_chain(np.random.default_rng(6))
    q = np.linspace(-1.0, 1.0, chain.n)
    row = rows_kernel(q)[1]
    expected = forward(chain, q), geometric(chain, q)
    monkeypatch.setattr(module, "pose_batch_kernel", None)
    np.testing.assert_array_equal(forward(chain, row), expected[0])
    np.testing.assert_array_equal(geometric(chain, row), expected[1])
