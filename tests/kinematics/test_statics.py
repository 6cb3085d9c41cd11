"""Statics against pinocchio and against virtual work."""

import numpy as np
import pinocchio as pin
import pytest

from kinematics.errors import InvalidOption
from kinematics.forward import forward
from kinematics.robots import builtin_chain, builtin_urdf
from kinematics.velocity import holding_torques
from tests.kinematics.samples import configurations, random_chain

STEP = 1e-6


@pytest.mark.parametrize("name", ["panda", "ur5e", "stanford", "scara"])
def test_a_load_at_any_link_is_what_pinocchio_adds_for_it(name: str) -> None:
    chain = builtin_chain(name)
    model = pin.buildModelFromXML(builtin_urdf(name))
    data = model.createData()
    rng = np.random.default_rng(0)
    still = np.zeros(chain.n)
    for q in configurations(chain, 3):
        for link in chain.links:
            wrench = rng.normal(size=6)
            pin.framesForwardKinematics(model, data, q)
            frame = model.getFrameId(link.name)
            joint = model.frames[frame].parentJoint
            # The wrench at the link's origin in base axes, moved into the joint's frame.
            at_origin = pin.SE3(np.eye(3), data.oMf[frame].translation)
            local = data.oMi[joint].actInv(at_origin.act(pin.Force(wrench)))
            external = pin.StdVec_Force()
            for _ in range(model.njoints):
                external.append(pin.Force.Zero())
            external[joint] = local
            alone = pin.rnea(model, data, q, still, still).copy()
            expected = alone - pin.rnea(model, data, q, still, still, external)
            np.testing.assert_allclose(
                holding_torques(chain, q, wrench, link.name), expected, atol=1e-10
            )


def test_work_of_the_joints_is_the_work_of_the_force() -> None:
    rng = np.random.default_rng(1)
    for _ in range(40):
        chain = random_chain(rng)
        q, dq, force = rng.uniform(-3, 3, chain.n), rng.normal(size=chain.n), rng.normal(size=3)
        point = rng.uniform(-0.5, 0.5, 3)
        ends = [
            T[:3, :3] @ point + T[:3, 3]
            for T in (forward(chain, q + STEP * dq), forward(chain, q - STEP * dq))
        ]
        work = float(force @ (ends[0] - ends[1])) / (2 * STEP)
        torques = holding_torques(chain, q, [*force, 0, 0, 0], point=point)
        assert torques @ dq == pytest.approx(work, abs=1e-7)


def test_batches_and_bad_wrenches() -> None:
    chain = builtin_chain("panda")
    q = np.random.default_rng(2).uniform(-1, 1, (4, 7))
    wrench = np.arange(6.0)
    batch = holding_torques(chain, q, wrench)
    for k in range(4):
        np.testing.assert_allclose(batch[k], holding_torques(chain, q[k], wrench), atol=1e-14)
    for bad in ([0.0] * 5, [np.inf] * 6, "wrench", 1.0):
        with pytest.raises(InvalidOption, match="wrench"):
            holding_torques(chain, q, bad)


def test_a_batch_of_wrenches_goes_with_one_configuration_or_as_many() -> None:
    chain = builtin_chain("panda")
    rng = np.random.default_rng(3)
    q, F = rng.uniform(-1, 1, (4, 7)), rng.normal(size=(4, 6))
    each, same = holding_torques(chain, q, F), holding_torques(chain, q[0], F)
    for k in range(4):
        np.testing.assert_allclose(each[k], holding_torques(chain, q[k], F[k]), atol=1e-13)
        np.testing.assert_allclose(same[k], holding_torques(chain, q[0], F[k]), atol=1e-13)
    with pytest.raises(InvalidOption, match=r"wrenches \(3, 6\) does not fit joints \(4, 7\)"):
        holding_torques(chain, q, F[:3])


def test_torques_are_linear_in_the_wrench() -> None:
    chain = builtin_chain("ur5e")
    rng = np.random.default_rng(4)
    q, F, G = rng.uniform(-1, 1, 6), rng.normal(size=6), rng.normal(size=6)
    both = holding_torques(chain, q, 2.0 * F - 3.0 * G)
    parts = 2.0 * holding_torques(chain, q, F) - 3.0 * holding_torques(chain, q, G)
    np.testing.assert_allclose(both, parts, atol=1e-12)
