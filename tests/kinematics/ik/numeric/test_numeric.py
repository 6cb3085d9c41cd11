"""Numeric inverse kinematics, verified by pinocchio and by limits, and where it gives up."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from compiled.kernel import kernel
from kinematics.arrays import Array
from kinematics.errors import InvalidOption, InvalidPose
from kinematics.forward import forward
from kinematics.frame import frame_kernel
from kinematics.ik.numeric.dls_step import error_kernel
from kinematics.ik.numeric.numeric import (
    AXES,
    POSITION,
    Axis,
    SearchOptions,
    reach,
    solve,
    solve_many,
)
from kinematics.model.chain import Chain
from kinematics.pose import from_axis_angle, inverse, rotation_error, rotation_z, transform
from kinematics.robots import builtin_chain, builtin_names
from tests.kinematics.samples import random_chain, random_rotation
from tests.planning.pinocchio_arm import PinocchioArm

SIX = ("panda", "ur5e", "iiwa14", "kr6_sixx", "puma560", "stanford", "elbow_wrist")


def inside(chain: Chain, q: Array) -> bool:
    return bool((q >= chain.limits.lower).all() and (q <= chain.limits.upper).all())


@pytest.mark.parametrize("name", SIX)
def test_every_reachable_pose_is_reached_inside_the_limits(name: str) -> None:
    chain, arm = builtin_chain(name), PinocchioArm(name)
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
        result = solve(chain, target, SearchOptions(seed=k))
        assert result.solutions, (name, k, result.nearest, result.advice)
        solution = result.solutions[0]
        assert inside(chain, solution.joints)
        reached = arm.pose(solution.joints)
        assert np.linalg.norm(reached[:3, 3] - target[:3, 3]) <= 1.01e-6
        assert np.linalg.norm(rotation_error(reached[:3, :3], target[:3, :3])) <= 1.01e-6


def test_several_solutions_are_distinct_and_nearest_first() -> None:
    chain = builtin_chain("ur5e")
    start = np.array([0.1, -1.2, 1.5, -1.0, -1.4, 0.3])
    target = forward(chain, start + 0.3)
    result = solve(chain, target, SearchOptions(starts=300), seed_joints=start, solutions=8)
    assert len(result.solutions) >= 4
    distances = [np.linalg.norm(s.joints - start) for s in result.solutions]
    assert distances == sorted(distances)
    for i, a in enumerate(result.solutions):
        assert np.abs(forward(chain, a.joints) - target).max() < 3e-6
        for b in result.solutions[:i]:
            assert np.abs(a.joints - b.joints).max() > 1e-3


def test_position_can_be_reached_but_not_the_orientation() -> None:
    chain = builtin_chain("scara")
    q = np.clip(np.array([0.3, 0.5, 0.0, 0.2]), chain.limits.lower, chain.limits.upper)
    target = forward(chain, q)
    target[:3, :3] = target[:3, :3] @ from_axis_angle([1.0, 0.0, 0.0], 0.5)
    result = solve(chain, target, SearchOptions(starts=20))
    assert not result.solutions
    assert "not in this orientation" in result.advice
    assert solve(chain, target, SearchOptions(axes=POSITION)).solutions


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
            result = solve(chain, target, SearchOptions(seed=n))
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


@pytest.mark.parametrize("name", ["panda", "ur5e", "scara"])
def test_batches_reach_every_pose_inside_the_limits(name: str) -> None:
    chain = builtin_chain(name)
    random = np.random.default_rng(8)
    lower, upper = chain.sampling_bounds()
    targets = forward(chain, random.uniform(lower, upper, (500, chain.n)))
    seeds = random.uniform(lower, upper, (500, chain.n))
    batch = solve_many(chain, targets, seed_joints=seeds)
    assert batch.solved.all()
    assert (batch.joints >= lower).all()
    assert (batch.joints <= upper).all()
    assert np.abs(forward(chain, batch.joints) - targets).max() < 3e-6
    alone = solve_many(chain, targets, seed_joints=seeds, threads=1)
    np.testing.assert_array_equal(batch.joints, alone.joints)


@pytest.mark.parametrize("name", ["panda", "ur5e"])
def test_poses_of_a_batch_are_answered_as_alone(name: str) -> None:
    chain = builtin_chain(name)
    random = np.random.default_rng(18)
    lower, upper = chain.sampling_bounds()
    q = random.uniform(lower, upper, (40, chain.n))
    q[::3] = np.where(random.random(q[::3].shape) < 0.5, lower, q[::3])
    targets = forward(chain, q)
    targets[[5, 39], :3, 3] = 9.0
    batch = solve_many(chain, targets, SearchOptions(seed=3, starts=40))
    assert not batch.solved[[5, 39]].any()
    for k, target in enumerate(targets):
        one = solve(chain, target, SearchOptions(seed=3, starts=40))
        assert bool(one.solutions) == batch.solved[k]
        np.testing.assert_array_equal(batch.joints[k], one.nearest.joints)
        assert (batch.steps[k], batch.position_error[k]) == one.nearest[3:0:-2]


def test_position_and_yaw_of_four_axes() -> None:
    chain = builtin_chain("scara")
    random = np.random.default_rng(9)
    lower, upper = chain.sampling_bounds()
    for k in range(50):
        target = forward(chain, random.uniform(lower, upper))
        # A tilt that the arm can't make, and need not.
        tilt = transform(from_axis_angle([1.0, 0.5, 0.0], random.uniform(0.0, 0.5)))
        result = solve(chain, target @ tilt, SearchOptions(seed=k, axes=("x", "y", "z")))
        assert result.solutions
        reached = forward(chain, result.solutions[0].joints)
        assert np.linalg.norm(reached[:3, 3] - target[:3, 3]) < 1.01e-6
        result = solve(chain, target, SearchOptions(seed=k, axes=("x", "y", "z", "rz")))
        assert np.abs(forward(chain, result.solutions[0].joints) - target).max() < 3e-6


@pytest.mark.parametrize("free", ["rz", "z", "rx"])
def test_one_free_axis_of_the_tool_is_left_free(free: str) -> None:
    chain = builtin_chain("kr6_sixx")
    random = np.random.default_rng(10)
    lower, upper = chain.sampling_bounds()
    axes: list[Axis] = [axis for axis in AXES if axis != free]
    moved = 0
    for k in range(40):
        target = forward(chain, random.uniform(lower, upper))
        result = solve(chain, target, SearchOptions(seed=k, axes=axes))
        assert result.solutions
        rest = inverse(target) @ forward(chain, result.solutions[0].joints)
        error = np.array([*rest[:3, 3], *rotation_error(np.eye(3), rest[:3, :3])])
        counted = [AXES.index(axis) for axis in axes]
        assert np.abs(error[counted]).max() < 1.1e-6
        moved += abs(error[AXES.index(free)]) > 1e-3
    assert moved > 20


def test_axes_that_do_not_exist_are_named() -> None:
    with pytest.raises(InvalidOption, match="roll"):
        SearchOptions(axes=["roll"])  # type: ignore[list-item]
    with pytest.raises(InvalidOption, match="positive"):
        SearchOptions(position_tolerance=0.0)
    with pytest.raises(InvalidOption, match="seed_joints"):
        solve_many(builtin_chain("panda"), np.eye(4)[None], seed_joints=np.zeros((2, 7)))
    with pytest.raises(InvalidPose):
        solve_many(builtin_chain("panda"), np.eye(4))


def test_an_arm_of_four_joints_is_told_of_axes() -> None:
    chain = builtin_chain("scara")
    T = forward(chain, 0.5 * (chain.limits.lower + chain.limits.upper))
    tilted = transform(from_axis_angle([1.0, 0.0, 0.0], 0.4) @ T[:3, :3], T[:3, 3])
    failed = solve(chain, tilted)
    assert not failed.solutions
    assert "4 joints" in failed.advice
    assert '"axes"' in failed.advice
    axes: tuple[Axis, ...] = ("x", "y", "z", "rz")
    assert str(list(axes)) in failed.advice
    assert solve(chain, T, SearchOptions(axes=axes)).solutions


# ----------------------------------------------------------------------------------- by the door


def pose_of(chain: Chain, seed: int) -> tuple[Array, Array]:
    """A configuration well inside the limits and its pose."""
    lower, upper = chain.sampling_bounds()
    q = np.random.default_rng(seed).uniform(0.7 * lower, 0.7 * upper)
    return q, forward(chain, q)


def test_a_start_at_the_goal_costs_no_step() -> None:
    chain = builtin_chain("panda")
    q, T = pose_of(chain, 2)
    result = solve(chain, T, seed_joints=q)
    assert result.solutions[0].iterations == 0
    assert result.starts == 1
    np.testing.assert_array_equal(result.solutions[0].joints, q)


def test_a_start_near_the_goal_takes_a_few_steps_and_no_restart() -> None:
    chain = builtin_chain("panda")
    q, T = pose_of(chain, 3)
    result = solve(chain, T, seed_joints=q + 0.01)
    assert result.starts == 1
    assert 1 <= result.solutions[0].iterations <= 10
    assert np.abs(result.solutions[0].joints - q).max() < 0.1


@pytest.mark.parametrize("starts", [1, 2, 7])
def test_no_more_starts_are_spent_than_allowed(starts: int) -> None:
    chain = builtin_chain("ur5e")
    result = solve(chain, transform(None, [9.0, 0.0, 0.0]), SearchOptions(starts=starts))
    assert result.solutions == ()
    assert result.starts == starts


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-9])
def test_a_solution_is_as_good_as_asked_for_and_tells_its_errors(tolerance: float) -> None:
    chain = builtin_chain("iiwa14")
    options = SearchOptions(position_tolerance=tolerance, orientation_tolerance=10 * tolerance)
    for seed in range(4):
        _, T = pose_of(chain, seed)
        solution = solve(chain, T, options).solutions[0]
        reached = forward(chain, solution.joints)
        away = float(np.linalg.norm(reached[:3, 3] - T[:3, 3]))
        turn = float(np.linalg.norm(rotation_error(reached[:3, :3], T[:3, :3])))
        assert away <= tolerance
        assert turn <= 10 * tolerance
        assert solution.position_error == pytest.approx(away, abs=1e-13)
        assert solution.orientation_error == pytest.approx(turn, abs=1e-13)


@pytest.mark.parametrize("turned", [0.5, 2.0, 3.1])
def test_a_turn_that_does_not_count_does_not_matter(turned: float) -> None:
    chain = builtin_chain("ur5e")
    q, T = pose_of(chain, 5)
    options = SearchOptions(axes=("x", "y", "z", "rx", "ry"))
    result = solve(chain, T @ transform(rotation_z(turned)), options, seed_joints=q)
    np.testing.assert_array_equal(result.solutions[0].joints, q)


ANGLES = [0.0, 1e-12, 1e-8, 1e-4, 0.1, 1.0, 0.5 * np.pi, 2.0, 3.0, np.pi - 1e-3, np.pi - 1e-6]


@kernel
def pose_error_kernel(B: Array, T: Array, out: Array) -> None:
    """The error from B to T, both (4, 4)."""
    out[0], out[1], out[2], out[3], out[4], out[5] = error_kernel(frame_kernel(B), frame_kernel(T))


def error(B: Array, T: Array) -> Array:
    """The error from one pose to another, shape (6,)."""
    out = np.full(6, np.nan)
    pose_error_kernel(B, T, out)
    return out


def pose(rng: np.random.Generator) -> Array:
    """Any pose."""
    return transform(random_rotation(rng), rng.normal(size=3))


@pytest.mark.parametrize("angle", ANGLES)
def test_the_error_is_the_difference_and_scipys_rotation_vector(angle: float) -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        B, axis = pose(rng), rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        shift = rng.normal(size=3)
        turn = Rotation.from_rotvec(angle * axis).as_matrix()
        T = transform(turn @ B[:3, :3], B[:3, 3] + shift)
        found = error(B, T)
        np.testing.assert_allclose(found[:3], shift, atol=1e-14)
        # Near half a turn the axis is known by the square root of the digits.
        tolerance = 1e-13 if angle < 3.0 else 1e-14 / (np.pi - angle) + 1e-12
        np.testing.assert_allclose(found[3:], angle * axis, rtol=0.0, atol=max(tolerance, 1e-15))


@pytest.mark.parametrize("axis", [*np.eye(3), np.ones(3), [1.0, -2.0, 0.5], [0.0, 1.0, -1.0]])
def test_half_a_turn_is_about_its_axis_either_way(axis: Array) -> None:
    unit = np.asarray(axis) / np.linalg.norm(axis)
    B = pose(np.random.default_rng(1))
    T = transform(Rotation.from_rotvec(np.pi * unit).as_matrix() @ B[:3, :3], B[:3, 3])
    found = error(B, T)[3:]
    assert np.linalg.norm(found) == pytest.approx(np.pi, abs=1e-7)
    assert abs(found @ unit) == pytest.approx(np.pi, abs=1e-7)
