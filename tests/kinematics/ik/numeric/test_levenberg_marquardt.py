"""The search for one pose: its table, what weighs how much, and where it gives up."""

import numpy as np
import pytest

from compiled.simd import LANES
from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.frame import Frame
from kinematics.ik.numeric.levenberg_marquardt import table_kernel, weigh_jacobian_kernel
from kinematics.ik.numeric.numeric import AXES, Axis, SearchOptions, solve
from kinematics.jacobian import geometric
from kinematics.model.chain import Chain
from kinematics.pose import from_axis_angle, rotation_error, rotation_z, transform
from kinematics.robots import builtin_chain
from tests.kinematics.samples import random_rotation

WEIGHT = 0.3


def frame(T: Array) -> Frame:
    """A transform as the kernels have it."""
    return tuple(float(x) for x in T[:3].flat)  # type: ignore[return-value]


def table(chain: Chain, count: int, seed: int) -> tuple[Array, Array]:
    """Frames (count, 3, 4) and configurations (count, n) of a table of restarts."""
    lower, upper = chain.sampling_bounds()
    rows = np.empty((chain.n + 12) * count)
    table_kernel(chain.model, chain.index[chain.tip_link], lower, upper, WEIGHT, seed, rows)
    lanes = rows.reshape(-1, chain.n + 12, LANES).transpose(0, 2, 1).reshape(count, -1)
    return lanes[:, :12].reshape(count, 3, 4), lanes[:, 12:]


@pytest.mark.parametrize("name", ["panda", "ur5e", "scara"])
def test_restarts_are_inside_the_limits_and_their_frames_are_their_own(name: str) -> None:
    chain = builtin_chain(name)
    frames, joints = table(chain, 64, 1)
    lower, upper = chain.sampling_bounds()
    assert (joints >= lower).all()
    assert (joints <= upper).all()
    poses = forward(chain, joints)
    np.testing.assert_allclose(frames[:, :, 3], poses[:, :3, 3], atol=1e-13)
    scaled = WEIGHT * np.sqrt(0.5) * poses[:, :3, :3]
    np.testing.assert_allclose(frames[:, :, :3], scaled, atol=1e-13)


def test_restarts_fill_the_limits_evenly_and_depend_on_the_seed() -> None:
    chain = builtin_chain("panda")
    _, joints = table(chain, 512, 1)
    lower, upper = chain.sampling_bounds()
    share = (joints - lower) / (upper - lower)
    assert np.abs(share.mean(axis=0) - 0.5).max() < 0.06
    assert (share.min(axis=0) < 0.03).all()
    assert (share.max(axis=0) > 0.97).all()
    np.testing.assert_array_equal(table(chain, 512, 1)[1], joints)
    assert (table(chain, 512, 2)[1] != joints).all()


def test_the_distance_of_scaled_frames_is_that_of_small_errors() -> None:
    # |w R / sqrt(2) - w R' / sqrt(2)|^2 = (w angle)^2 to second order.
    rng = np.random.default_rng(0)
    for _ in range(20):
        R = random_rotation(rng)
        turn = from_axis_angle(rng.normal(size=3), 1e-3)
        away = WEIGHT * np.sqrt(0.5) * np.linalg.norm(turn @ R - R)
        assert away == pytest.approx(WEIGHT * 1e-3, rel=1e-5)


@pytest.mark.parametrize("free", [(), ("rz",), ("x", "ry"), ("rx", "ry", "rz")])
def test_a_weighed_jacobian_counts_the_axes_of_the_targets_frame(free: tuple[Axis, ...]) -> None:
    chain, rng = builtin_chain("ur5e"), np.random.default_rng(1)
    mask = np.array([*(float(axis not in free) for axis in AXES), float(bool(free))])
    J = geometric(chain, rng.uniform(-2.0, 2.0, 6))
    T = transform(random_rotation(rng), rng.normal(size=3))
    R = T[:3, :3] if free else np.eye(3)
    expected = np.vstack([R.T @ J[:3], WEIGHT * (R.T @ J[3:])]) * mask[:6, None]
    weighed = J.copy()
    weigh_jacobian_kernel(frame(T), mask, WEIGHT, weighed)
    np.testing.assert_allclose(weighed, expected, atol=1e-14)


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
