"""Closed forms of calibrated arms: branches kept, folds, edges and singular directions."""

from dataclasses import replace

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.ik.closed_form.analytic import branches, closed_form
from kinematics.ik.inverse import inverse_kinematics
from kinematics.ik.numeric.numeric import SearchOptions, solve, solve_many
from kinematics.jacobian import geometric
from kinematics.robots import builtin_chain
from tests.kinematics.ik.arms import (
    apart,
    calibrated,
    edge_configuration,
)


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
            for other in solve(chain, T, SearchOptions(seed=k, starts=60), solutions=16).solutions:
                if np.linalg.svd(geometric(chain, other.joints), compute_uv=False)[-1] < 1e-2:
                    continue
                compared += 1
                assert apart(found.joints, other.joints).min() < 1e-3
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
