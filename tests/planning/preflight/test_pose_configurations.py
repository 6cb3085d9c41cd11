"""Configurations of a pose: every branch, by the turns nearest the start, beside all there are."""

import itertools

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.ik.numeric import numeric
from kinematics.model.chain import Chain
from kinematics.pose import from_rpy, transform
from planning.preflight.pose_configurations import pose_configurations, turned_copies
from planning.timing.rest_to_rest import motion_times
from planning.values.preferences import GoalCosts
from tests.planning.goal_judge import least_time, limit_share
from tests.planning.scenes import builtin

ONLY_TIME = GoalCosts(1.0, 0.0, 0.0, 0.0, 0.0)
TURN = 2.0 * np.pi


def configurations(chain: Chain, T: Array, start: Array, costs: GoalCosts = ONLY_TIME) -> Array:
    return pose_configurations(chain, T, start, numeric.SearchOptions(), costs).joints


def every_turn(chain: Chain, q: Array) -> list[Array]:
    """All copies of a configuration by whole turns inside the limits."""
    low, high = chain.limits.lower, chain.limits.upper
    values = [
        [q[j] + TURN * k for k in range(-3, 4) if low[j] <= q[j] + TURN * k <= high[j]]
        for j in range(chain.n)
    ]
    return [np.array(copy) for copy in itertools.product(*values)]


@pytest.mark.parametrize("seed", range(6))
def test_the_soonest_of_all_turns_of_all_branches_is_the_first(seed: int) -> None:
    chain, random = builtin("ur5e").chain, np.random.default_rng(seed)
    low, high = chain.sampling_bounds()
    start, goal = random.uniform(low, high, (2, chain.n))
    T = forward(chain, goal)
    # Branches from random starts, not from the closed form.
    search = numeric.SearchOptions(seed=5, starts=2000)
    found = numeric.solve(chain, T, search, seed_joints=goal, solutions=40).solutions
    copies = [copy for solution in found for copy in every_turn(chain, solution.joints)]
    soonest = min(least_time(chain, start, q) for q in copies)
    joints = configurations(chain, T, start)
    times = motion_times(chain, start, joints)
    assert times[0] == pytest.approx(soonest, rel=1e-4)
    assert (np.diff(times) >= 0.0).all()
    inside = min(
        (least_time(chain, start, q) for q in copies if limit_share(chain, q) >= 0.02),
        default=np.inf,
    )
    shares = np.array([limit_share(chain, q) for q in joints])
    assert times[shares >= 0.02].min(initial=np.inf) == pytest.approx(inside, rel=1e-4)


@pytest.mark.parametrize("name", ["ur5e", "panda", "iiwa14", "stanford", "scara"])
def test_all_are_of_the_pose_and_inside_the_limits(name: str) -> None:
    chain, random = builtin(name).chain, np.random.default_rng(2)
    low, high = chain.sampling_bounds()
    for _ in range(5):
        start, goal = random.uniform(low, high, (2, chain.n))
        T = forward(chain, goal)
        joints = configurations(chain, T, start, GoalCosts())
        assert len(joints)
        for q in (*joints, *turned_copies(chain, joints, start)[0]):
            assert ((q >= chain.limits.lower) & (q <= chain.limits.upper)).all()
            np.testing.assert_allclose(forward(chain, q), T, atol=1e-5)


@pytest.mark.parametrize("angle", [1e-17, 1e-15, 1e-13, 3e-12, 1e-9])
def test_a_pose_with_the_orientation_of_the_start_but_for_rounding(angle: float) -> None:
    chain = builtin("ur5e").chain
    start = np.array([0.3, -1.2, 1.4, -1.0, -1.5, 0.4])
    T = forward(chain, start)
    T = transform(from_rpy([angle, 0.0, -angle]) @ T[:3, :3], T[:3, 3] + [0.0, 0.05, -0.05])
    joints = configurations(chain, T, start)
    assert np.abs(joints[0] - start).max() < 0.3
    np.testing.assert_allclose(forward(chain, joints[0]), T, atol=1e-5)


def test_a_joint_at_its_limit_is_turned_away_from_it_where_it_can_be() -> None:
    chain = builtin("ur5e").chain
    goal = np.array([0.3, -1.2, 1.3, -0.9, 1.1, 0.99 * TURN])
    start = goal - np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.4])
    joints = configurations(chain, forward(chain, goal), start)
    nearest = np.abs(joints - goal).max(axis=1).argmin()
    np.testing.assert_allclose(joints[nearest], goal, atol=1e-6)
    turned = goal - np.array([0.0, 0.0, 0.0, 0.0, 0.0, TURN])
    assert np.abs(joints - turned).max(axis=1).min() < 1e-6


def test_copies_go_round_the_other_side() -> None:
    chain = builtin("ur5e").chain
    start = np.array([0.2, -1.0, 1.0, -1.0, 1.0, -4.0])
    q = np.array([0.1, -1.0, 1.5, -1.0, 1.0, -3.0])
    copies, origins = turned_copies(chain, q[None], start)
    # The elbow turns once; joints 0, 4 and 5 have no room on the other side.
    steps = {(int(np.abs(c - q).argmax()), round(float((c - q).sum()) / TURN)) for c in copies}
    assert steps == {(1, 1), (3, 1)}
    assert list(origins) == [0, 0]
