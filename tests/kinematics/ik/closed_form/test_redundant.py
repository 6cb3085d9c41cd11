"""The closed form of S-R-S arms: the arm angle by its geometric definition, and its branches."""

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.forward import forward, joint_frames
from kinematics.ik.closed_form.analytic import branches, parameter
from kinematics.model.chain import Chain
from kinematics.robots import builtin_chain


def arm_angle(chain: Chain, q: Array) -> float:
    """The angle of the elbow's normal about the line from shoulder to wrist.

    It is counted from the horizontal across that line; the normal is axis 4, turned round on one
    side of the elbow.
    """
    F = joint_frames(chain, q)
    shoulder, wrist = F[1, :3, 3], F[5, :3, 3]
    s = (wrist - shoulder) / np.linalg.norm(wrist - shoulder)
    r = np.cross([0.0, 0.0, 1.0], s)
    r = r / np.linalg.norm(r) if np.linalg.norm(r) > 1e-8 else np.array([0.0, 1.0, 0.0])
    z = np.sign(np.sin(q[3])) * F[3, :3, 2]
    return float(np.arctan2(z @ np.cross(s, r), z @ r))


def wrapped(angle: float) -> float:
    return float(np.remainder(angle + np.pi, 2.0 * np.pi) - np.pi)


def random_joints(chain: Chain, count: int, seed: int) -> Array:
    lower, upper = chain.sampling_bounds()
    return np.random.default_rng(seed).uniform(lower, upper, (count, chain.n))


def test_the_parameter_is_the_arm_angle() -> None:
    chain = builtin_chain("iiwa14")
    for q in random_joints(chain, 200, 0):
        assert wrapped(parameter(chain, q) - arm_angle(chain, q)) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("bend", [None, 1e-2, 1e-4])
def test_branches_have_the_arm_angle_asked_for_and_reach_the_pose(bend: float | None) -> None:
    chain = builtin_chain("iiwa14")
    rng = np.random.default_rng(1)
    for q in random_joints(chain, 40, 2):
        if bend is not None:
            q[3], q[5] = bend, -bend  # near the stretched arm and the straight wrist
        T, psi = forward(chain, q), rng.uniform(-np.pi, np.pi)
        table = branches(chain, T, parameters=[psi], seed_joints=q)
        assert len(table.joints) == 8
        for row in table.joints:
            assert np.abs(forward(chain, row) - T).max() < 1e-9
            # Where the arm is stretched the elbow's plane is known as well as its bend.
            error = wrapped(arm_angle(chain, row) - psi)
            assert abs(error) < 1e-9 / (1.0 if bend is None else bend)


def test_every_sign_of_elbow_shoulder_and_wrist_is_answered_once() -> None:
    chain = builtin_chain("iiwa14")
    q = np.array([0.3, 0.8, -0.4, 1.1, 0.5, -0.9, 0.2])
    table = branches(chain, forward(chain, q), seed_joints=q)
    signs = {
        (bool(np.sin(row[1]) > 0.0), bool(np.sin(row[3]) > 0.0), bool(np.sin(row[5]) > 0.0))
        for row in table.joints
    }
    assert len(signs) == len(table.joints) == 8
    assert np.abs(table.joints - q).max(axis=1).min() < 1e-9
