"""Arms that miss their closed form: branches by symmetry, at folds, near the exact arm's."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.ik.closed_form.analytic import branches, closed_form
from kinematics.ik.inverse import inverse_kinematics
from kinematics.ik.numeric.numeric import SearchOptions, solve_many
from kinematics.jacobian import geometric
from kinematics.model.chain import Chain
from kinematics.robots import builtin_chain
from tests.kinematics.ik.arms import (
    apart,
    arm_of,
    calibrated,
    edge_configuration,
    searched,
)
from tests.kinematics.ik.symmetries import distance, regular, regular_cases, wrapped

NAMES = ("ur5e", "kr6_sixx")


def free_arm(name: str, size: float, seed: int = 0) -> Chain:
    """A robot whose axes miss its form by up to ``size`` [m], [rad], without limits."""
    chain = calibrated(builtin_chain(name), size, np.random.default_rng(seed))
    return arm_of(list(chain.offsets), chain.tip.T_joint_link)


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


@pytest.mark.parametrize("size", [1e-12, 1e-7, 1e-4, 3e-3])
@pytest.mark.parametrize("name", ["ur5e", "kr6_sixx"])
def test_calibrated_arms_keep_their_branches(name: str, size: float) -> None:
    rng = np.random.default_rng(4)
    nominal = builtin_chain(name)
    compared = 0
    for _ in range(3):
        chain = calibrated(nominal, size, rng)
        form = closed_form(chain)
        assert form.kind == closed_form(nominal).kind
        for k in range(12):
            q = rng.uniform(-np.pi, np.pi, 6)
            T = forward(chain, q)
            found = branches(chain, T)
            assert found.position_error.max() < 1e-9
            assert found.orientation_error.max() < 1e-9
            assert apart(found.joints, q).min() < 1e-6
            if k > 1:
                continue
            compared += searched(chain, T, found.joints, k)
    assert compared > 20


@pytest.mark.parametrize("size", [1e-7, 1e-5, 1e-3])
@pytest.mark.parametrize("name", ["ur5e", "elbow_wrist"])
def test_calibrated_arms_keep_both_sides_of_a_fold(name: str, size: float) -> None:
    rng = np.random.default_rng(8)
    whole = np.full(6, np.pi)
    twins = 0
    for _ in range(4):
        chain = calibrated(builtin_chain(name), size, rng)
        chain = replace(chain, limits=replace(chain.limits, lower=-whole, upper=whole))
        for _ in range(4):
            q = rng.uniform(-np.pi, np.pi, 6)
            # Hardly bent: where the form has one branch, the true arm may have two.
            q[2] = (0.0 if name == "ur5e" else 0.5 * np.pi) + 10.0 ** rng.uniform(-4.0, -1.0)
            T = forward(chain, q)
            found = branches(chain, T).joints
            seeds = np.clip(q + rng.normal(size=(60, 6)) * 0.3, -np.pi, np.pi)
            search = solve_many(
                chain, np.tile(T, (60, 1, 1)), SearchOptions(0, 1, 1e-10, 1e-10),
                seed_joints=seeds, threads=1,
            )  # fmt: skip
            for other in search.joints[search.solved]:
                if np.linalg.svd(geometric(chain, other), compute_uv=False)[-1] > 1e-5:
                    assert apart(found, other).min() < 1e-4
                    twins += bool(1e-4 < apart(other[None], q)[0] < 0.3)
    assert twins > 20


@pytest.mark.parametrize("size", [1e-9, 1e-5, 1e-3])
@pytest.mark.parametrize("name", ["ur5e", "kr6_sixx", "iiwa14"])
def test_calibrated_arms_answer_edge_poses(name: str, size: float) -> None:
    rng = np.random.default_rng(12)
    for _ in range(3):
        chain = calibrated(builtin_chain(name), size, rng)
        for k in range(40):
            q = edge_configuration(chain, rng, k)
            T = forward(chain, q)
            found = inverse_kinematics(chain, T, seed_joints=q)
            assert found.solutions, q
            assert np.abs(forward(chain, found.solutions[0].joints) - T).max() < 3e-6


def twice_singular(rng: np.random.Generator) -> Array:
    """Three joints within 1e-9 to 0.1 rad of a right angle: wrist, shoulder, elbow at once."""
    q = rng.uniform(-np.pi, np.pi, 6)
    near = np.round(q / (np.pi / 2)) * np.pi / 2
    near += rng.choice([-1.0, 1.0], 6) * 10.0 ** rng.uniform(-9.0, -1.0, 6)
    which = rng.permutation(6)[:3]
    q[which] = near[which]
    return np.array(q)


@pytest.mark.parametrize("size", [1e-7, 1e-5, 1e-4, 1e-3, 3e-3])
@pytest.mark.parametrize("name", ["ur5e", "puma560", "elbow_wrist"])
def test_calibrated_arms_keep_their_branches_where_several_things_are_singular(
    name: str, size: float
) -> None:
    rng = np.random.default_rng(11)
    compared = 0
    for _ in range(5):
        chain = calibrated(builtin_chain(name), size, rng)
        for _ in range(6):
            q = twice_singular(rng)
            T = forward(chain, q)
            found = branches(chain, T).joints
            assert len(found), q
            assert np.abs(forward(chain, found) - T).max() < 3e-9
            J = geometric(chain, np.vstack([q, found]))
            least = np.linalg.svd(J, compute_uv=False)[:, -1]
            away = apart(found, q).min()
            # Nearer than its singular value can tell, two branches are one within 1e-9.
            if least[0] > 3e-7 and not (away < 0.02 and 0.25 * away * least[0] < 1.5e-9):
                assert away < 3e-5, q
            # Branches come and go in pairs whose determinants have opposite signs; two that are one
            # within 1e-9 have singular values below 1e-4.
            if least.min() > 1e-4:
                compared += 1
                assert np.sign(np.linalg.det(J[1:])).sum() == 0.0, q
    assert compared > 4
