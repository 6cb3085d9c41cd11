"""Groups of own pairs hold every pair once and change no answer; grids prove what is true."""

import itertools

import numpy as np
import pytest

from kinematics.forward import joint_frames
from kinematics.robots import builtin_names
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld
from obstacles.collision.model.collision_model import CollisionModel
from obstacles.collision.model.model_arrays import ModelArrays
from obstacles.collision.model.pair_grid import grid_bound
from obstacles.collision.model.pair_groups import (
    FIRST_PAIR,
    GROUP_SIZE,
    LAST_PAIR,
    PARTED,
    whole_groups,
)
from obstacles.scenes.scene import Scene
from tests.obstacles.arms import builtin, cut_arm

ARM = cut_arm()


def arrays() -> ModelArrays:
    return CollisionModel(ARM, Scene()).arrays


def size(groups: np.ndarray, group: int) -> int:
    """How many groups one and those that part it are."""
    return int(groups[group, GROUP_SIZE]) if groups[group, PARTED] < 0 else 1


def pairs_of(groups: np.ndarray, group: int) -> tuple[int, int]:
    """The first pair of a group and of those that part it, and the number after the last."""
    inside = groups[group : group + size(groups, group)]
    whole = inside[inside[:, PARTED] >= 0]
    return int(whole[:, FIRST_PAIR].min()), int(whole[:, LAST_PAIR].max())


def states(count: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-np.pi, np.pi, (count, ARM.chain.n))


def test_leaves_hold_every_pair_once_and_parents_what_is_in_them() -> None:
    groups = arrays().groups
    assert max(size(groups, group) for group in range(len(groups))) > 40
    leaves = groups[groups[:, PARTED] >= 0]
    numbers = np.concatenate([np.arange(a, b) for a, b in leaves[:, : LAST_PAIR + 1]])
    assert numbers.tolist() == list(range(len(ARM.self_pairs)))
    ours = {frozenset(pair) for pair in arrays().self_pairs.tolist()}
    assert ours == {frozenset(pair) for pair in ARM.self_pairs.tolist()}
    tops, end = whole_groups(groups).tolist(), 0
    for top in tops:
        first, last = pairs_of(groups, top)
        assert first == end
        end = last
    assert end == len(ARM.self_pairs)
    assert tops[0] == 0
    for group in np.flatnonzero(groups[:, PARTED] < 0).tolist():
        part, end = group + 1, pairs_of(groups, group)[0]
        while part < group + size(groups, group):
            first, last = pairs_of(groups, part)
            assert first == end
            part, end = part + size(groups, part), last
        assert part == group + size(groups, group)
        assert end == pairs_of(groups, group)[1]


def test_no_verdict_on_a_state_differs_from_fcl() -> None:
    checker, world = Checker.of(ARM, Scene()), FclWorld(ARM, Scene())
    drawn = states(400, 2)
    truth = []
    for q in drawn:
        world.set_configuration(q)
        truth.append(not world.collisions(q))
    assert 60 < sum(truth) < 340
    assert [checker.valid(q) for q in drawn] == truth
    assert checker.each_valid(drawn).tolist() == truth


@pytest.mark.parametrize("name", builtin_names())
def test_what_the_grid_proves_is_true(name: str) -> None:
    robot = builtin(name)
    arrays = Checker.of(robot, Scene()).model.arrays
    world = FclWorld(robot, Scene())
    rows = {frozenset(map(int, pair)): k for k, pair in enumerate(world.pairs)}
    random = np.random.default_rng(41)
    lower, upper = robot.chain.sampling_bounds()
    useful = compared = 0
    for _ in range(60):
        q = random.uniform(lower, upper)
        world.set_configuration(q)
        for s, (i, j) in enumerate(arrays.self_pairs):
            if arrays.grid_axes[s, 0, 2] == 0.0:
                continue
            proved = grid_bound(
                arrays.grid_axes, arrays.grid_starts, arrays.grid_values, s,
                int(arrays.joints[i]), q[None],
            )  # fmt: skip
            true = world.distance(rows[frozenset((int(i), int(j)))])
            assert proved <= max(true, 0.0) + 1e-9
            compared += 1
            useful += proved > 0.0 or true <= 0.02
    assert useful >= 0.6 * compared


@pytest.mark.parametrize("name", builtin_names())
def test_pairs_that_get_a_grid_are_those_that_balls_do_not_part(name: str) -> None:
    """Against a look at each pair by itself, from frames of the whole chain."""
    robot = builtin(name)
    arrays, chain = Checker.of(robot, Scene()).model.arrays, robot.chain
    lower, upper = chain.limits.lower, chain.limits.upper
    for s, (i, j) in enumerate(arrays.self_pairs):
        first, last = int(arrays.joints[i]) + 1, int(arrays.joints[j])
        moving = np.arange(first, min(last, chain.n - 1) + 1)
        span = upper[moving] - lower[moving]
        if last >= chain.n or len(moving) > 2 or not np.isfinite(span).all():
            assert arrays.grid_axes[s, 0, 2] == 0.0
            continue
        (a, a_radius), (b, b_radius) = (robot.pieces[k].bounding_sphere() for k in (i, j))
        apart = []
        for shares in itertools.product((0.05, 0.35, 0.65, 0.95), repeat=len(moving)):
            q = np.zeros(chain.n)
            q[moving] = lower[moving] + np.array(shares) * span
            frames = np.concatenate([np.eye(4)[None], joint_frames(chain, q)])
            A, B = frames[first], frames[last + 1]
            apart.append(np.linalg.norm(A[:3] @ [*a, 1.0] - B[:3] @ [*b, 1.0]))
        assert (arrays.grid_axes[s, 0, 2] > 0.0) == (min(apart) < a_radius + b_radius)
