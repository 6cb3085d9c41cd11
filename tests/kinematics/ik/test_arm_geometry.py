"""Sides and singularities of arms by their Jacobians, and reach by the edge of the workspace."""

import numpy as np
import pytest

from kinematics.forward import forward, joint_frames
from kinematics.ik.analytic import branches
from kinematics.ik.arm_geometry import arm_sides, out_of_reach
from kinematics.jacobian import geometric
from kinematics.robots import builtin_chain

ARMS = ["elbow_wrist", "puma560", "kr6_sixx", "ur5e"]


@pytest.mark.parametrize("name", ARMS)
def test_the_eight_branches_have_eight_different_sides(name: str) -> None:
    chain = builtin_chain(name)
    rng = np.random.default_rng(3)
    seen = 0
    for q in rng.uniform(-1.2, 1.2, (40, 6)):
        table = branches(chain, forward(chain, q))
        sides = arm_sides(chain, table.joints)
        assert sides is not None
        assert all(side.singular == () for side in sides)
        if name != "ur5e":
            assert len(set(sides)) == len(sides)
        seen += len(sides) == 8
    assert seen > 5


def test_the_sign_of_the_determinant_is_that_of_the_sides() -> None:
    """Of a UR, whose determinant has a factor for shoulder and wrist each, and the elbow's bend."""
    chain = builtin_chain("ur5e")
    q = np.random.default_rng(4).uniform(-2.0, 2.0, (400, 6))
    sides = arm_sides(chain, q)
    assert sides is not None
    signs: dict[tuple[str | None, ...], set[float]] = {}
    for row, side in zip(q, sides, strict=True):
        frames = joint_frames(chain, row)
        z, origins = frames[:, :3, 2], frames[:, :3, 3]
        bend = np.linalg.det([origins[2] - origins[1], origins[3] - origins[2], z[1]])
        key = (side.shoulder, str(np.sign(bend)), side.wrist)
        signs.setdefault(key, set()).add(float(np.sign(np.linalg.det(geometric(chain, row)))))
    assert len(signs) == 8
    assert all(len(found) == 1 for found in signs.values())


def test_straight_wrists_stretched_elbows_and_wrists_above_axis_1_are_singular() -> None:
    chain = builtin_chain("elbow_wrist")
    q = np.array([0.3, 0.4, -0.6, 0.2, 0.5, 0.1])
    straight = q * [1, 1, 1, 1, 0, 1]
    sides = arm_sides(chain, np.array([q, straight]))
    assert sides is not None
    assert [side.singular for side in sides] == [(), ("wrist",)]
    assert sides[1].wrist is None
    for name in ("puma560", "kr6_sixx", "ur5e", "elbow_wrist"):
        arm = builtin_chain(name)
        for joint in range(6):
            rows = np.tile(q, (720, 1))
            rows[:, joint] = np.linspace(-np.pi, np.pi, 720)
            told = arm_sides(arm, rows)
            assert told is not None
            for row, side in zip(rows, told, strict=True):
                lowest = np.linalg.svd(geometric(arm, row), compute_uv=False)[-1]
                assert (lowest < 1e-7) == bool(side.singular)


def test_other_arms_have_no_sides() -> None:
    for name in ("panda", "iiwa14", "stanford", "scara", "planar_rr"):
        chain = builtin_chain(name)
        assert arm_sides(chain, np.zeros((1, chain.n))) is None
        assert out_of_reach(chain, np.eye(4)) is None


@pytest.mark.parametrize("name", ["elbow_wrist", "puma560", "kr6_sixx"])
def test_out_of_reach_is_where_there_is_no_branch(name: str) -> None:
    chain = builtin_chain(name)
    rng = np.random.default_rng(5)
    near = far = 0
    for q in rng.uniform(-3.0, 3.0, (60, 6)):
        T = forward(chain, q)
        assert out_of_reach(chain, T) == pytest.approx(0.0, abs=1e-9)
        T[:3, 3] *= rng.uniform(0.05, 2.5)
        gap = out_of_reach(chain, T)
        assert gap is not None
        assert (len(branches(chain, T).joints) == 0) == (gap > 1e-9)
        near, far = near + (gap == 0.0), far + (gap > 0.0)
    assert min(near, far) > 5


def test_the_gap_of_a_stretched_arm_is_the_way_beyond_it() -> None:
    """The notes' arm, stretched to the side, and then moved on along its line."""
    chain = builtin_chain("elbow_wrist")
    frames = joint_frames(chain, np.zeros(6))
    T = forward(chain, np.zeros(6))
    W = frames[4, :3, 3]
    a = np.linalg.norm(frames[2, :3, 3] - frames[1, :3, 3])
    b = np.linalg.norm(W - frames[2, :3, 3])
    T[:3, 3] += frames[1, :3, 3] + [a + b + 0.123, 0.0, 0.0] - W
    assert out_of_reach(chain, T) == pytest.approx(0.123, abs=1e-9)
