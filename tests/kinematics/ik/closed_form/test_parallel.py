"""Arms with three parallel axes: symmetry, the plane of the three, and its singular poses."""

from dataclasses import replace

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.forward import forward, joint_frames
from kinematics.ik.closed_form.analytic import branches
from kinematics.model.chain import Chain
from kinematics.robots import builtin_chain
from tests.kinematics.ik import symmetries
from tests.kinematics.ik.arms import GENERAL, general_arm
from tests.kinematics.ik.symmetries import labels, regular_cases, wrapped

KINDS = [kind for kind in GENERAL if kind.startswith("three parallel")]


def arms(seed: int) -> list[Chain]:
    """The UR5e and general arms with three parallel axes."""
    rng = np.random.default_rng(seed)
    return [builtin_chain("ur5e"), *(general_arm(rng, kind) for kind in KINDS)]


@pytest.mark.parametrize("which", range(3))
def test_every_branch_of_a_pose_has_its_own_name(which: int) -> None:
    for _, _, table in regular_cases(arms(2)[which], 2, 8):
        assert len(set(labels(table))) == len(table.table)


@pytest.mark.parametrize("which", range(3))
def test_the_sign_of_the_shoulder_is_the_side_that_joint_1_turned_to(which: int) -> None:
    chain = arms(2)[which]
    for _, _, table in regular_cases(chain, 2, 6):
        for name, row in zip(labels(table), table.joints, strict=True):
            # Where axes 5 and 6 miss each other the sign is counted the other way.
            behind = symmetries.first_lever(chain, row, 5) < 0.0
            assert ("shoulder+" in name) == (behind if which < 2 else not behind)


@pytest.mark.parametrize("which", range(3))
def test_the_elbow_moves_neither_the_plane_nor_the_wrist(which: int) -> None:
    chain = arms(5)[which]
    # Axes 3 and 4 may run against axis 2.
    z = joint_frames(chain, np.zeros(6))[1:4, :3, 2]
    senses = np.sign(z @ z[0])
    pairs = 0
    for _, _, table in regular_cases(chain, 5, 6):
        by_name = dict(zip(labels(table), table.joints, strict=True))
        for name, row in by_name.items():
            other = by_name.get(name.replace("elbow+", "elbow-"))
            if "elbow+" not in name or other is None:
                continue
            pairs += 1
            away = wrapped(row - other)
            np.testing.assert_allclose(away[[0, 4, 5]], 0.0, atol=1e-8)
            assert wrapped(np.array([away[1:4] @ senses]))[0] == pytest.approx(0.0, abs=1e-8)
            assert abs(away[2]) > 1e-3
    assert pairs >= 6


def planar_distance(chain: Chain, q: Array) -> float:
    """Distance of axes 2 and 4 across them, which the elbow alone decides."""
    frames = joint_frames(chain, q)
    n, d = frames[1, :3, 2], frames[3, :3, 3] - frames[1, :3, 3]
    return float(np.linalg.norm(d - (d @ n) * n))


@pytest.mark.parametrize("which", range(3))
def test_both_elbows_close_the_same_triangle(which: int) -> None:
    chain = arms(6)[which]
    for _, _, table in regular_cases(chain, 6, 4):
        for row in table.joints:
            same = np.abs(wrapped(table.joints - row)[:, [0, 4]]).max(axis=1) < 1e-8
            assert same.sum() == 2
            spans = [planar_distance(chain, other) for other in table.joints[same]]
            assert np.ptp(spans) < 1e-9


def without_limits(chain: Chain) -> Chain:
    """The arm with two turns of every joint."""
    far = np.full(chain.n, 2.0 * np.pi)
    return replace(chain, limits=replace(chain.limits, lower=-far, upper=far))


@pytest.mark.parametrize("fifth", [0.0, np.pi])
def test_where_axis_6_is_parallel_too_the_seeds_own_member_is_answered(fifth: float) -> None:
    chain = without_limits(builtin_chain("ur5e"))
    rng = np.random.default_rng(7)
    for _ in range(20):
        q = rng.uniform(-np.pi, np.pi, 6)
        q[4] = fifth
        T = forward(chain, q)
        table = branches(chain, T, seed_joints=q)
        assert np.abs(forward(chain, table.joints) - T).max() < 1e-8
        assert np.abs(table.joints - q).max(axis=1).min() < 1e-6


@pytest.mark.parametrize("fifth", [0.0, np.pi])
def test_a_family_has_a_member_inside_narrow_limits(fifth: float) -> None:
    # The seed's own member is outside; the member that is inside differs from it in many joints.
    chain = without_limits(builtin_chain("ur5e"))
    rng = np.random.default_rng(8)
    for _ in range(15):
        q = rng.uniform(-2.5, 2.5, 6)
        q[4] = fifth
        lower, upper = chain.limits.lower.copy(), chain.limits.upper.copy()
        lower[5], upper[5] = q[5] - 0.1, q[5] + 0.1
        narrow = replace(chain, limits=replace(chain.limits, lower=lower, upper=upper))
        seed = q.copy()
        seed[5] = np.clip(q[5] + 2.0, lower[5], upper[5])
        T = forward(narrow, q)
        table = branches(narrow, T, seed_joints=seed)
        assert table.within_limits.any()
        inside = table.joints[table.within_limits]
        assert (np.abs(inside[:, 5] - q[5]) <= 0.1 + 1e-9).all()


def test_a_target_too_near_to_axis_1_has_no_branch() -> None:
    chain = builtin_chain("ur5e")
    q = np.array([0.3, -1.2, 1.4, -0.8, -1.1, 0.4])
    T = forward(chain, q)
    # Joint 6's origin cannot come nearer to axis 1 than the offset of the three axes.
    frames = joint_frames(chain, q)
    T[:3, 3] += frames[0, :3, 3] - frames[5, :3, 3]
    assert len(branches(chain, T).table) == 0


@pytest.mark.parametrize("height", [1.0, 1.6])
def test_a_target_beyond_the_stretched_arm_has_no_branch(height: float) -> None:
    chain = builtin_chain("ur5e")
    T = forward(chain, np.array([0.3, -1.2, 1.4, -0.8, -1.1, 0.4]))
    T[:3, 3] = [0.0, 0.0, height + 0.3]
    assert len(branches(chain, T).table) == 0
