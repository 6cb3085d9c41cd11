"""Numeric inverse kinematics, verified by pinocchio and by limits."""

import numpy as np
import pinocchio as pin
import pytest

from kinematics.chain import Array, Chain, Limits
from kinematics.errors import InvalidLinkName, InvalidPose, InvalidRobotState
from kinematics.forward import forward
from kinematics.ik.numeric import reach, rotation_vector, solve
from kinematics.pose import from_axis_angle, rotation_error, transform
from kinematics.robots import builtin_chain, builtin_names, builtin_urdf
from tests.kinematics.samples import random_chain

SIX = ("panda", "ur5e", "iiwa14", "kr6_sixx", "puma560", "stanford", "elbow_wrist")


def inside(chain: Chain, q: Array) -> bool:
    return bool((q >= chain.limits.lower).all() and (q <= chain.limits.upper).all())


def pinocchio_pose(name: str, q: Array, link: str) -> Array:
    model = pin.buildModelFromXML(builtin_urdf(name))
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return np.array(data.oMf[model.getFrameId(link)].homogeneous)


@pytest.mark.parametrize("name", SIX)
def test_every_reachable_pose_is_reached_inside_the_limits(name: str) -> None:
    chain = builtin_chain(name)
    random = np.random.default_rng(1)
    lower, upper = chain.sampling_bounds()
    for k in range(150):
        q = random.uniform(lower, upper)
        if k % 5 == 0:
            # Edge poses: joints at their limits, at zero, and at right angles.
            edges = np.array(
                [lower, upper, np.zeros(chain.n), np.round(q / (np.pi / 4)) * np.pi / 4]
            )
            q = np.clip(edges[random.integers(0, 4, chain.n), np.arange(chain.n)], lower, upper)
        target = forward(chain, q)
        result = solve(chain, target, seed=k)
        assert result.solutions, (name, k, result.nearest, result.advice)
        solution = result.solutions[0]
        assert inside(chain, solution.joints)
        reached = pinocchio_pose(name, solution.joints, chain.tip_link)
        assert np.linalg.norm(reached[:3, 3] - target[:3, 3]) <= 1.01e-6
        assert np.linalg.norm(rotation_error(reached[:3, :3], target[:3, :3])) <= 1.01e-6


def test_several_solutions_are_distinct_and_nearest_first() -> None:
    chain = builtin_chain("ur5e")
    start = np.array([0.1, -1.2, 1.5, -1.0, -1.4, 0.3])
    target = forward(chain, start + 0.3)
    result = solve(chain, target, seed_joints=start, solutions=8, starts=300)
    assert len(result.solutions) >= 4
    distances = [np.linalg.norm(s.joints - start) for s in result.solutions]
    assert distances == sorted(distances)
    for i, a in enumerate(result.solutions):
        assert np.abs(forward(chain, a.joints) - target).max() < 3e-6
        for b in result.solutions[:i]:
            assert np.abs(a.joints - b.joints).max() > 1e-3


def test_same_seed_same_answer() -> None:
    chain = builtin_chain("panda")
    target = forward(chain, 0.3 * np.ones(7) * np.array([1, 1, 1, -4, 1, 4, 1]))
    answers = [solve(chain, target, seed=5, solutions=4).solutions for _ in range(2)]
    for a, b in zip(*answers, strict=True):
        assert np.array_equal(a.joints, b.joints)


def test_out_of_reach_says_how_far() -> None:
    chain = builtin_chain("panda")
    target = transform(None, [3.0, 0.0, 0.3])
    result = solve(chain, target, starts=20)
    assert not result.solutions
    _, radius = reach(chain)
    assert result.nearest.position_error >= 3.0 - radius - 0.1
    assert "beyond the longest the arm can reach" in result.advice


def test_position_can_be_reached_but_not_the_orientation() -> None:
    chain = builtin_chain("scara")
    q = np.clip(np.array([0.3, 0.5, 0.0, 0.2]), chain.limits.lower, chain.limits.upper)
    target = forward(chain, q)
    target[:3, :3] = target[:3, :3] @ from_axis_angle([1.0, 0.0, 0.0], 0.5)
    result = solve(chain, target, starts=20)
    assert not result.solutions
    assert "not in this orientation" in result.advice
    assert solve(chain, target, position_only=True).solutions


@pytest.mark.parametrize("name", builtin_names())
def test_no_configuration_leaves_the_reach(name: str) -> None:
    chain = builtin_chain(name)
    center, radius = reach(chain)
    random = np.random.default_rng(2)
    lower, upper = chain.sampling_bounds()
    tips = forward(chain, random.uniform(lower, upper, (500, chain.n)))[:, :3, 3]
    assert np.linalg.norm(tips - center, axis=1).max() <= radius + 1e-12


def test_random_chains_with_slides_of_many_lengths() -> None:
    random = np.random.default_rng(3)
    solved = 0
    for n in (1, 2, 3, 5, 6, 7, 9, 12, 20):
        chain = random_chain(random, n)
        lower, upper = chain.sampling_bounds()
        for _ in range(5):
            target = forward(chain, random.uniform(lower, upper))
            result = solve(chain, target, seed=n)
            solved += bool(result.solutions)
            if result.solutions:
                assert np.abs(forward(chain, result.solutions[0].joints) - target).max() < 5e-6
    assert solved >= 43


def test_link_before_the_tip_leaves_later_joints_alone() -> None:
    chain = builtin_chain("panda")
    q = np.array([0.4, -0.3, 0.2, -1.9, 0.1, 1.5, 0.6])
    link = chain.links[[item.joint for item in chain.links].index(3)].name
    target = forward(chain, q, link)
    result = solve(chain, target, link=link, seed_joints=q)
    assert result.solutions
    assert np.array_equal(result.solutions[0].joints[4:], q[4:])


def test_rotation_vector_near_none_and_half_a_turn() -> None:
    random = np.random.default_rng(4)
    out = np.empty(3)
    for angle in (0.0, 1e-12, 1e-8, 1e-3, 1.0, 3.0, np.pi - 1e-6, np.pi - 1e-9, np.pi):
        for _ in range(50):
            axis = random.normal(size=3)
            axis /= np.linalg.norm(axis)
            R = transform(from_axis_angle(random.normal(size=3), random.uniform(0.0, 3.0)))
            target = transform(from_axis_angle(axis, angle) @ R[:3, :3])
            rotation_vector(R, target, out)
            reached = (
                from_axis_angle(out, float(np.linalg.norm(out))) if angle > 1e-9 else np.eye(3)
            )
            assert np.abs(reached @ R[:3, :3] - target[:3, :3]).max() < 2e-8
            assert np.linalg.norm(out) == pytest.approx(angle, abs=2e-8)


def test_bad_input_is_named() -> None:
    chain = builtin_chain("panda")
    with pytest.raises(InvalidPose):
        solve(chain, np.full((4, 4), np.nan))
    with pytest.raises(InvalidRobotState, match="7 joints"):
        solve(chain, np.eye(4), seed_joints=[0.0])
    with pytest.raises(InvalidLinkName, match="nowhere"):
        solve(chain, np.eye(4), link="nowhere")


def test_continuous_joints_have_no_limits_to_hit() -> None:
    chain = builtin_chain("cart_pendulum")
    assert isinstance(chain.limits, Limits)
    target = forward(chain, np.array([0.2, 2.0]))
    assert solve(chain, target).solutions
