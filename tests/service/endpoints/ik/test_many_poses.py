"""Many poses of one request are solved by the batch kernels."""

import json
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from kinematics.forward import forward
from kinematics.ik import inverse
from kinematics.robots import builtin_chain, builtin_urdf
from service.endpoints.ik import task
from service.storage.caches.cache_key import builtin_reference
from tests.service.poses import as_pose, draws


@pytest.mark.parametrize(
    ("robot", "more"),
    [
        ("panda", {}),
        ("ur5e", {}),
        ("ur5e", {"method": "numeric"}),
        ("panda", {"axes": ["x", "y", "z", "rx", "ry"]}),
        ("ur5e", {"choice": "limits"}),
    ],
)
def test_many_poses_are_solved_in_one_call_of_the_batch_kernels(
    robot: str, more: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    chain = builtin_chain(robot)
    targets = [forward(chain, q) for q in draws(robot, 40, seed=8)]
    unreachable = {"position": [9.0, 0.0, 0.0]}
    body = {"poses": [*map(as_pose, targets), unreachable], **more}
    calls = []

    def counted(*args: Any, **kwargs: Any) -> Any:
        calls.append(args)
        return inverse.inverse_kinematics(*args, **kwargs)

    monkeypatch.setattr("service.endpoints.ik.task.inverse_kinematics", counted)
    answer = task.ik(builtin_reference(robot), None, json.dumps(body).encode())
    assert isinstance(answer, bytes)
    assert len(calls) == 1, "the pose out of reach alone is looked at by itself"
    found = json.loads(answer)
    assert [item["index"] for item in found["unsolved"]] == [40]
    assert found["unsolved"][0]["code"] == "NO_IK_SOLUTION"
    assert found["solutions"][40] == []
    model = pin.buildModelFromXML(builtin_urdf(robot))
    data, frame = model.createData(), model.getFrameId(chain.tip_link)
    tolerance = 1e-6 if more.get("method") == "numeric" or "axes" in more else 1e-8
    for T, solutions in zip(targets, found["solutions"], strict=False):
        (solution,) = solutions
        q = np.array(solution["joints"])
        assert solution["within_limits"]
        assert (q >= chain.limits.lower).all()
        assert (q <= chain.limits.upper).all()
        full = pin.neutral(model)
        for name, value in zip(chain.joint_names, q, strict=True):
            full[model.joints[model.getJointId(name)].idx_q] = value
        pin.framesForwardKinematics(model, data, full)
        reached = data.oMf[frame].homogeneous
        np.testing.assert_allclose(reached[:3, 3], T[:3, 3], atol=tolerance)
        compared = reached[:3, :3] if "axes" not in more else reached[:3, 2]
        expected = T[:3, :3] if "axes" not in more else T[:3, 2]
        np.testing.assert_allclose(compared, expected, atol=2 * tolerance)
