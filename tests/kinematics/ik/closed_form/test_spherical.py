"""Branches as symmetry and the Jacobian demand them, spherical wrists, and arm angles."""

from dataclasses import replace

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.forward import forward, joint_frames
from kinematics.ik.closed_form.analytic import branches, closed_form, parameter
from kinematics.model.chain import Chain
from kinematics.pose import inverse
from kinematics.robots import builtin_chain
from tests.kinematics.ik import symmetries
from tests.kinematics.ik.arms import GENERAL, general_arm, random_joints, reversed_arm
from tests.kinematics.ik.symmetries import distance, labels, regular_cases, wrapped

KINDS = [kind for kind in GENERAL if kind.startswith("spherical")]
ALL = [*GENERAL, "ur5e"]


def arm(kind: str, seed: int) -> Chain:
    """A random arm of a kind, or a built-in one."""
    if kind in GENERAL:
        return general_arm(np.random.default_rng(seed), kind)
    return builtin_chain(kind)


@pytest.mark.parametrize("kind", ALL)
def test_branches_come_in_pairs_of_opposite_determinants(kind: str) -> None:
    # Far poses have none, and branches come and go in such pairs.
    chain = arm(kind, 1)
    for q, _, table in regular_cases(chain, 1, 8):
        signs = np.sign(symmetries.determinants(chain, table.joints))
        assert signs.sum() == 0
        assert np.abs(wrapped(table.joints - q)).max(axis=1).min() < 1e-8


@pytest.mark.parametrize("kind", [kind for kind in ALL if kind != "three parallel"])
def test_the_names_signs_multiply_to_that_of_the_determinant(kind: str) -> None:
    chain = arm(kind, 2)
    ratios = set()
    for _, _, table in regular_cases(chain, 2, 8):
        signs = np.sign(symmetries.determinants(chain, table.joints))
        ratios |= {
            int(sign) * symmetries.product_of_signs(name)
            for sign, name in zip(signs, labels(table), strict=True)
        }
    assert len(ratios) == 1


@pytest.mark.parametrize("kind", [kind for kind in KINDS if "1 and 2 parallel" not in kind])
def test_the_sign_of_the_shoulder_is_the_side_of_the_wrist_that_joint_1_turned_to(
    kind: str,
) -> None:
    chain = general_arm(np.random.default_rng(2), kind)
    for _, _, table in regular_cases(chain, 2, 6):
        assert len(set(labels(table))) == len(table.table)
        for name, row in zip(labels(table), table.joints, strict=True):
            lever = symmetries.first_lever(chain, row, 4)
            assert ("shoulder+" in name) == (lever < 0.0)


@pytest.mark.parametrize("kind", ALL)
def test_turning_the_first_or_last_joint_turns_its_angle_in_every_branch(kind: str) -> None:
    chain = arm(kind, 3)
    for k, (_, T, table) in enumerate(regular_cases(chain, 3, 4)):
        for other, moved in symmetries.turned(chain, T, table, -2.0 + k):
            assert distance(other.joints, moved) < 1e-8
            assert sorted(labels(other)) == sorted(labels(table))


@pytest.mark.parametrize("kind", ALL)
def test_the_arm_from_tip_to_base_has_the_same_branches_backwards(kind: str) -> None:
    chain = arm(kind, 14)
    back = reversed_arm(chain)
    assert closed_form(back).reverse
    for _, T, table in regular_cases(chain, 4, 4):
        other = branches(back, inverse(T))
        assert distance(other.joints, -table.joints[:, ::-1]) < 1e-8
        assert sorted(map(symmetries.product_of_signs, labels(other))) == sorted(
            map(symmetries.product_of_signs, labels(table))
        )


@pytest.mark.parametrize("factor", [0.1, 7.0])
@pytest.mark.parametrize("kind", KINDS[:3])
def test_an_arm_of_another_size_has_the_same_angles(kind: str, factor: float) -> None:
    chain = general_arm(np.random.default_rng(5), kind)
    large = symmetries.scaled(chain, factor)
    for _, T, table in regular_cases(chain, 5, 4):
        pose = T.copy()
        pose[:3, 3] *= factor
        assert distance(branches(large, pose).joints, table.joints) < 1e-7


@pytest.mark.parametrize("kind", KINDS)
def test_the_wrist_flips_without_moving_the_arm(kind: str) -> None:
    chain = general_arm(np.random.default_rng(6), kind)
    for _, _, table in regular_cases(chain, 6, 6):
        arms = wrapped(table.joints[:, :3])
        for name, arm in zip(labels(table), arms, strict=True):
            flip = "wrist-" if "wrist+" in name else "wrist+"
            same = np.abs(wrapped(arms - arm)).max(axis=1) < 1e-8
            assert same.sum() == 2
            assert flip in "".join(np.array(labels(table))[same])


@pytest.mark.parametrize("kind", KINDS)
def test_the_wrist_point_is_the_same_in_all_branches(kind: str) -> None:
    chain = general_arm(np.random.default_rng(17), kind)
    for q, _, table in regular_cases(chain, 7, 4):
        centre = joint_frames(chain, q)[3, :3, 3]
        for row in table.joints:
            frames = joint_frames(chain, row)
            np.testing.assert_allclose(frames[3:, :3, 3], [centre] * 3, atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_a_straight_wrist_is_answered_at_the_seed_with_its_own_joints(kind: str) -> None:
    chain = general_arm(np.random.default_rng(8), kind)
    # Where axes 4 and 6 are one, which skew axes of a general wrist never are.
    offsets = chain.offsets.copy()
    offsets[5, :3, :3] = offsets[4, :3, :3].T
    chain = replace(chain, offsets=offsets)
    rng = np.random.default_rng(9)
    for _ in range(6):
        q = rng.uniform(-np.pi, np.pi, 6)
        q[4] = 0.0
        T = forward(chain, q)
        table = branches(chain, T, seed_joints=q)
        assert np.abs(forward(chain, table.joints) - T).max() < 1e-8
        assert np.abs(table.joints - q).max(axis=1).min() < 1e-6
        # Another seed has the same sum of angles, near its own.
        seed = q.copy()
        seed[3] += 0.7
        near = branches(chain, T, seed_joints=seed)
        row = near.joints[np.abs(near.joints[:, :3] - q[:3]).max(axis=1).argmin()]
        assert row[3] == pytest.approx(seed[3], abs=1e-6)
        assert row[3] + row[5] == pytest.approx(q[3] + q[5], abs=1e-6)


# ------------------------------------------------------------------------------------ pieces


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
