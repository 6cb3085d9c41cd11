"""Arms that miss their closed form: branches by symmetry, by degree, and near the exact arm's."""

import numpy as np
import pytest
from scipy.optimize import brentq

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.ik.closed_form.analytic import branches, closed_form
from kinematics.jacobian import geometric
from kinematics.model.chain import Chain
from kinematics.robots import builtin_chain
from tests.kinematics.ik import symmetries
from tests.kinematics.ik.arms import arm_of, calibrated
from tests.kinematics.ik.symmetries import distance, regular, regular_cases, wrapped

NAMES = ("ur5e", "kr6_sixx")


def free_arm(name: str, size: float, seed: int = 0) -> Chain:
    """A robot whose axes miss its form by up to ``size`` [m], [rad], without limits."""
    chain = calibrated(builtin_chain(name), size, np.random.default_rng(seed))
    return arm_of(list(chain.offsets), chain.tip.T_joint_link)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("size", [1e-6, 1e-4, 1e-3])
def test_branches_are_right_and_come_in_pairs_of_opposite_determinants(
    name: str, size: float
) -> None:
    chain = free_arm(name, size)
    assert closed_form(chain).miss > 1e-10
    for q, T, table in regular_cases(chain, 1, 5):
        assert np.abs(forward(chain, table.joints) - T).max() < 1e-8
        assert np.abs(wrapped(table.joints - q)).max(axis=1).min() < 1e-7
        assert np.sign(symmetries.determinants(chain, table.joints)).sum() == 0


@pytest.mark.parametrize("name", NAMES)
def test_turning_the_first_or_last_joint_turns_its_angle_in_every_branch(name: str) -> None:
    chain = free_arm(name, 1e-3)
    for k, (_, T, table) in enumerate(regular_cases(chain, 2, 3)):
        angle = -1.0 + 0.7 * k
        for joint, pose in (
            (0, symmetries.turned_before(chain, T, angle)),
            (5, symmetries.turned_behind(chain, T, angle)),
        ):
            moved = table.joints.copy()
            moved[:, joint] += angle
            assert distance(branches(chain, pose).joints, moved) < 1e-7


@pytest.mark.parametrize("name", NAMES)
def test_the_branches_approach_those_of_the_exact_arm_as_the_miss_does(name: str) -> None:
    exact = builtin_chain(name)
    exact = arm_of(list(exact.offsets), exact.tip.T_joint_link)
    for q, _, _ in regular_cases(exact, 3, 3):
        T = forward(exact, q)
        expected = branches(exact, T).joints
        away = [distance(branches(free_arm(name, s), T).joints, expected) for s in (1e-4, 1e-6)]
        # The least singular value of a regular case is 1e-2: an error becomes a hundred times it.
        assert away[0] < 100 * 6e-4
        assert away[1] < 100 * 6e-6


def singular_configuration(chain: Chain, q: Array, joint: int) -> Array | None:
    """The configuration nearest to q along a joint at which the determinant vanishes."""

    def determinant(angle: float) -> float:
        moved = q.copy()
        moved[joint] = angle
        return float(np.linalg.det(geometric(chain, moved)))

    grid = q[joint] + np.linspace(-np.pi, np.pi, 73)
    values = [determinant(angle) for angle in grid]
    for i in np.argsort(np.abs(grid[:-1] - q[joint])):
        if values[i] * values[i + 1] < 0.0:
            moved = q.copy()
            moved[joint] = brentq(determinant, grid[i], grid[i + 1], xtol=1e-15)
            return moved
    return None


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("joint", [2, 4])
def test_a_configuration_at_a_fold_is_among_the_branches_of_its_pose(name: str, joint: int) -> None:
    chain, rng = free_arm(name, 1e-4), np.random.default_rng(4)
    tried = 0
    for _ in range(4):
        q = singular_configuration(chain, rng.uniform(-2.0, 2.0, 6), joint)
        if q is None:
            continue
        tried += 1
        assert np.linalg.svd(geometric(chain, q), compute_uv=False)[-1] < 1e-7
        T = forward(chain, q)
        table = branches(chain, T, seed_joints=q)
        assert np.abs(forward(chain, table.joints) - T).max() < 1e-8
        # Two branches meet there: rounding of the pose moves them by the root of it.
        assert np.abs(wrapped(table.joints - q)).max(axis=1).min() < 1e-3
    assert tried >= 2


@pytest.mark.parametrize("name", NAMES)
def test_the_same_question_has_the_same_answer(name: str) -> None:
    chain = free_arm(name, 1e-3)
    rng = np.random.default_rng(5)
    targets = forward(chain, rng.uniform(-2.0, 2.0, (6, 6)))
    batch = branches(chain, targets, threads=2)
    assert batch.counts is not None
    for k, T in enumerate(targets):
        once, twice = branches(chain, T), branches(chain, T)
        np.testing.assert_array_equal(once.table, twice.table)
        np.testing.assert_array_equal(batch.table[k, : batch.counts[k]], once.table)


@pytest.mark.parametrize("name", NAMES)
def test_no_branch_is_answered_twice(name: str) -> None:
    chain, rng = free_arm(name, 1e-3), np.random.default_rng(6)
    for _ in range(6):
        q = rng.uniform(-2.0, 2.0, 6)
        q[4] *= 0.01  # near the straight wrist
        joints = branches(chain, forward(chain, q)).joints
        for i, row in enumerate(joints):
            others = np.delete(joints, i, axis=0)
            if regular(chain, row, 1e-4) and len(others):
                assert np.abs(wrapped(others - row)).max(axis=1).min() > 1e-6


def test_out_of_reach_no_branch_is_invented() -> None:
    for name in NAMES:
        chain = free_arm(name, 1e-3)
        T = forward(chain, np.array([0.3, -1.2, 1.4, -0.8, -1.1, 0.4]))
        T[:3, 3] *= 5.0
        assert len(branches(chain, T).table) == 0
