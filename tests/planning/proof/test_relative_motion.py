"""Bounds of one link's motion seen from another, against dense samples of pinocchio's frames."""

import numpy as np
import pinocchio as pin
import pytest

from kinematics.arrays import Array
from kinematics.forward import joint_frames
from kinematics.robots import builtin_chain, builtin_urdf
from planning.proof.motion_bounds import JOINT_COLUMNS, VALUE, enclose
from planning.proof.relative_motion import axis_motion, relative_motion

NAMES = ["panda", "stanford"]


def frames_at(model: pin.Model, q: Array, n: int) -> Array:
    """Frames of the first n joints in the base frame, (n + 1, 4, 4), the base itself last."""
    data = model.createData()
    pin.forwardKinematics(model, data, np.concatenate([q, np.zeros(model.nq - n)]))
    poses = [data.oMi[k + 1].homogeneous for k in range(n)]
    return np.array([*poses, np.eye(4)])


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("outwards", [True, False])
def test_points_axes_and_turns_stay_within_their_bounds(name: str, outwards: bool) -> None:
    chain, random = builtin_chain(name), np.random.default_rng(3)
    model, n = pin.buildModelFromXML(builtin_urdf(name)), chain.n
    tightest = np.inf
    for _ in range(40):
        c = random.normal(size=(n, 5)) * 0.5 ** np.arange(5)
        half, at = float(10.0 ** random.uniform(-3.0, -0.5)), 0.5
        joints = np.empty((n, JOINT_COLUMNS))
        enclose(c, at, half, np.empty((2, 5)), joints)
        pair = sorted(random.choice(np.arange(-1, n), 2, replace=False).tolist())
        reference, carrier = pair if outwards else pair[::-1]
        frames = frames_at(model, joints[:, VALUE], n)
        local, axis = random.normal(size=3) * 0.3, random.normal(size=3)
        axis /= np.linalg.norm(axis)
        point = (frames[carrier] @ np.append(local, 1.0))[:3]
        direction = frames[carrier][:3, :3] @ axis
        ours = joint_frames(chain, joints[:, VALUE])
        asked = (chain.joint_types, ours)
        spread = relative_motion(*asked, tuple(point.tolist()), carrier, reference, joints, half)
        swung, bent = axis_motion(
            *asked, tuple(direction.tolist()), carrier, reference, joints, half
        )
        for s in np.linspace(-half, half, 21):
            q = np.array([np.polynomial.polynomial.polyval(at + s, row) for row in c])
            then = frames_at(model, q, n)
            X = frames[reference] @ np.linalg.inv(then[reference]) @ then[carrier]
            moved = (X @ np.append(local, 1.0))[:3] - point
            assert np.linalg.norm(moved) <= spread.moved + 1e-9
            linear = moved - s * np.array(spread.velocity)
            assert np.linalg.norm(linear) <= spread.bend + 1e-9
            turn = pin.log3(X[:3, :3] @ frames[carrier][:3, :3].T)
            assert np.linalg.norm(turn) <= spread.turned + 1e-9
            swing = X[:3, :3] @ axis - direction
            assert np.linalg.norm(swing) <= swung + 1e-9
            rate = np.cross(spread.turn_rate, direction)
            assert np.linalg.norm(swing - s * rate) <= bent + 1e-9
            if abs(s) == half and np.linalg.norm(moved) > 1e-6:
                tightest = min(tightest, spread.moved / float(np.linalg.norm(moved)))
    assert tightest < 1.5
