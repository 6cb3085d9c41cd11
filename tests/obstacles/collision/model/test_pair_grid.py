"""Grids of a robot's own pairs prove no more than is true, and enough to be of use."""

import itertools

import numpy as np
import pytest

from kinematics.forward import joint_frames
from kinematics.robots import builtin_names
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld
from obstacles.collision.model.pair_grid import grid_bound
from obstacles.scenes.scene import Scene
from tests.obstacles.collision.test_edge_check import builtin


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
