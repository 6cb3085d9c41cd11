"""Sides, singularities and reach of arms, by their Jacobians, branches and other solutions."""

import numpy as np
import pytest

from kinematics.forward import forward, joint_frames
from kinematics.ik.closed_form.analytic import branches, parameter
from kinematics.ik.closed_form.arm_parts import ArmSides, arm_sides, out_of_reach
from kinematics.ik.inverse import IkOptions, inverse_kinematics
from kinematics.ik.numeric.numeric import Axis, SearchOptions, solve
from kinematics.jacobian import geometric
from kinematics.model.dh import DhRow, DhTable, chain_from_dh
from kinematics.pose import transform
from kinematics.robots import builtin_chain

ARMS = ["elbow_wrist", "puma560", "kr6_sixx", "ur5e"]
_ROWS = (DhRow("revolute", d=0.4, alpha=np.pi / 2), DhRow("revolute", a=0.5),
         DhRow("revolute", a=0.35))  # fmt: skip
ARTICULATED = chain_from_dh("articulated", DhTable("standard", _ROWS))


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
    for name in ARMS:
        arm = builtin_chain(name)
        for joint in range(6):
            rows = np.tile(q, (720, 1))
            rows[:, joint] = np.linspace(-np.pi, np.pi, 720)
            told = arm_sides(arm, rows)
            assert told is not None
            for row, side in zip(rows, told, strict=True):
                lowest = np.linalg.svd(geometric(arm, row), compute_uv=False)[-1]
                assert (lowest < 1e-7) == bool(side.singular)


@pytest.mark.parametrize("name", ["panda", "iiwa14"])
def test_branches_of_seven_joints_have_sides_of_their_own(name: str) -> None:
    """At one parameter: as many sides as branches, and each name always the same sides."""
    chain = builtin_chain(name)
    meaning: dict[str, set[ArmSides]] = {}
    eight = 0
    for q in np.random.default_rng(6).uniform(-2.0, 2.0, (60, 7)):
        table = branches(chain, forward(chain, q), parameters=[parameter(chain, q)])
        sides = arm_sides(chain, table.joints)
        assert sides is not None
        assert len(set(sides)) == len(sides)
        eight += len(sides) == 8
        for i, side in enumerate(sides):
            meaning.setdefault(table.label(i).rpartition(" ")[0], set()).add(side)
    assert eight > 10
    assert len(meaning) == 8
    assert all(len(found) == 1 for found in meaning.values())


@pytest.mark.parametrize("name", ["panda", "iiwa14"])
def test_parts_of_seven_joints_are_singular_where_their_axes_fall_together(name: str) -> None:
    chain = builtin_chain(name)
    q = np.array([0.3, 0.4, -0.6, -0.9, 0.5, 1.1, 0.2])
    rows = np.tile(q, (3, 1))
    rows[1, 1] = 0.0
    frames = joint_frames(chain, q)
    # Shoulder, axis 4 and the point where axes 5 and 6 meet in line.
    S, W = frames[1, :3, 3], frames[5, :3, 3]
    z, O4 = frames[3, :3, 2], frames[3, :3, 3]
    a, b = S - O4, W - O4
    a, b = a - (a @ z) * z, b - (b @ z) * z
    rows[2, 3] += np.pi - np.arctan2(np.cross(a, b) @ z, a @ b)
    sides = arm_sides(chain, rows)
    assert sides is not None
    assert [side.singular for side in sides] == [(), ("shoulder",), ("elbow",)]
    ends = joint_frames(chain, rows[2])[[1, 5], :3, 3]
    longest = np.linalg.norm(a) + np.linalg.norm(b)
    assert np.linalg.norm(ends[1] - ends[0]) == pytest.approx(longest, abs=1e-9)


@pytest.mark.parametrize("name", ["planar_rr", "scara"])
def test_both_elbows_of_a_planar_arm(name: str) -> None:
    chain = builtin_chain(name)
    a, b = np.linalg.norm(chain.offsets[1][:3, 3]), 1.0 if name == "planar_rr" else 0.275
    for q in np.random.default_rng(7).uniform(-3.0, 3.0, (30, chain.n)):
        other = q.copy()
        swing = np.arctan2(b * np.sin(q[1]), a + b * np.cos(q[1]))
        other[0], other[1] = q[0] + 2.0 * swing, -q[1]
        if name == "scara":  # its last axis points down
            other[3] = q[3] + (other[0] + other[1]) - (q[0] + q[1])
        size = 3 if name == "planar_rr" else 4  # two joints reach the position only
        here, there = forward(chain, q), forward(chain, other)
        np.testing.assert_allclose(there[:size, 3], here[:size, 3], atol=1e-12)
        sides = arm_sides(chain, [q, other])
        assert sides is not None
        assert {side.elbow for side in sides} == {"left", "right"}
        # The elbow goes to the right where joint 2 turns to the left.
        assert sides[0].elbow == ("right" if np.sin(q[1]) > 0.0 else "left")
        assert sides[0].shoulder is sides[0].wrist is None
    straight = arm_sides(chain, np.zeros((1, chain.n)))
    assert straight is not None
    assert straight[0] == ArmSides(None, None, None, ("elbow",))


def test_the_four_solutions_of_the_stanford_arm_have_four_sides() -> None:
    chain = builtin_chain("stanford")
    q = np.array([0.4, 0.9, 0.5, 0.3, 0.8, -0.7])
    flipped = q + np.array([0, 0, 0, np.pi, -2.0 * q[4], np.pi])
    np.testing.assert_allclose(forward(chain, flipped), forward(chain, q), atol=1e-12)
    options = SearchOptions(0, 400)
    found = solve(chain, forward(chain, q), options, solutions=8, seed_joints=q)
    turned = np.array([solution.joints for solution in found.solutions])
    sides = arm_sides(chain, np.vstack([q, flipped, turned]))
    assert sides is not None
    assert sides[0].shoulder == sides[1].shoulder
    assert {sides[0].wrist, sides[1].wrist} == {"flip", "no flip"}
    assert {side.shoulder for side in sides} == {"left", "right"}
    assert all(side.elbow is None for side in sides)
    upright = arm_sides(chain, [q * [1, 1, 1, 1, 0, 1]])
    assert upright is not None
    assert upright[0].singular == ("wrist",)


def test_three_joints_have_a_shoulder_and_an_elbow() -> None:
    chain = ARTICULATED
    q = np.array([0.3, 0.7, -1.1])
    swing = np.arctan2(0.35 * np.sin(q[2]), 0.5 + 0.35 * np.cos(q[2]))
    other = np.array([q[0], q[1] + 2.0 * swing, -q[2]])
    back = np.array([q[0] + np.pi, np.pi - q[1], -q[2]])
    for row in (other, back):
        np.testing.assert_allclose(
            forward(chain, row)[:3, 3], forward(chain, q)[:3, 3], atol=1e-12
        )  # fmt: skip
    sides = arm_sides(chain, [q, other, back])
    assert sides is not None
    assert [(side.shoulder, side.elbow) for side in sides] == [
        ("right", "up"), ("right", "down"), ("left", "up"),
    ]  # fmt: skip


def test_arms_of_other_shapes_have_no_sides() -> None:
    row = DhRow("revolute", a=0.3, alpha=0.7, d=0.1)
    for rows in ((row,) * 4, (row,) * 6, (DhRow("prismatic"),) * 2):
        chain = chain_from_dh("other", DhTable("standard", rows))
        assert arm_sides(chain, np.zeros((1, chain.n))) is None
        assert out_of_reach(chain, np.eye(4)) is None
    panda = builtin_chain("panda")
    assert arm_sides(panda, np.zeros((1, 7)), "panda_link0") is None


@pytest.mark.parametrize("name", [*ARMS, "panda", "iiwa14"])
def test_out_of_reach_is_where_there_is_no_branch(name: str) -> None:
    """Of seven joints no branch of any parameter."""
    chain = builtin_chain(name)
    parameters = np.linspace(-3.1, 3.1, 60) if chain.n == 7 else None
    rng = np.random.default_rng(9 if chain.n == 7 else 5)
    near = far = 0
    for q in rng.uniform(-3.0, 3.0, (60, chain.n)):
        T = forward(chain, q)
        assert out_of_reach(chain, T) == pytest.approx(0.0, abs=1e-9)
        T[:3, 3] *= rng.uniform(0.05, 2.5)
        gap = out_of_reach(chain, T)
        assert gap is not None
        assert (len(branches(chain, T, parameters=parameters).joints) == 0) == (gap > 1e-9)
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


def test_the_gap_of_a_planar_arm() -> None:
    chain = builtin_chain("planar_rr")  # two links of 1 m about -y
    target = transform(None, [1.8, 0.0, 2.4])
    assert out_of_reach(chain, target) == pytest.approx(1.0, abs=1e-12)
    target[:3, 3] = [1.0, 0.5, 0.0]
    assert out_of_reach(chain, target) == pytest.approx(0.5, abs=1e-12)
    # Where only x and z count, the distance along y does not.
    assert out_of_reach(chain, target, axes=("x", "z")) == pytest.approx(0.0, abs=1e-12)
    assert out_of_reach(chain, target, axes=("x", "y")) is None
    rows = (DhRow("revolute", a=0.7), DhRow("revolute", a=0.3))
    uneven = chain_from_dh("uneven", DhTable("standard", rows))
    target[:3, 3] = [0.1, 0.0, 0.0]
    assert out_of_reach(uneven, target) == pytest.approx(0.3, abs=1e-12)


def test_the_gap_of_a_scara_is_that_across_its_axes() -> None:
    chain = builtin_chain("scara")
    T = forward(chain, np.zeros(4))
    T[:3, 3] += [0.2, 0.0, -5.0]
    assert out_of_reach(chain, T) == pytest.approx(0.2, abs=1e-12)


def test_the_shoulder_offset_of_the_stanford_arm_bounds_its_reach() -> None:
    chain = builtin_chain("stanford")
    T = forward(chain, [0.3, 0.5, 0.6, 0.1, 0.4, 0.2])
    assert out_of_reach(chain, T) == pytest.approx(0.0, abs=1e-12)
    W = joint_frames(chain, np.zeros(6))[4, :3, 3]
    T = forward(chain, np.zeros(6))
    T[:3, 3] += np.array([0.0, 0.1, 0.6]) - W  # 0.1 m from axis 1, nearer than the offset 0.154
    assert out_of_reach(chain, T) == pytest.approx(0.054, abs=1e-9)


def test_the_position_of_three_joints() -> None:
    chain = ARTICULATED
    target = transform(None, [0.6, 0.8, 0.4])
    position: tuple[Axis, ...] = ("x", "y", "z")
    assert out_of_reach(chain, target, axes=position) == pytest.approx(0.15, abs=1e-12)
    assert out_of_reach(chain, target, axes=("x", "y")) is None
    result = inverse_kinematics(chain, target, IkOptions(axes=position))
    assert result.solutions == ()
    assert result.out_of_reach == pytest.approx(0.15, abs=1e-12)
    assert result.nearest.position_error == pytest.approx(0.15, abs=1e-6)
    assert result.starts <= 20
