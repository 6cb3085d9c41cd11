"""The joint tolerance against distances by FCL, which no displacement can change by more."""

from dataclasses import replace

import numpy as np
import pytest

from obstacles.collision.fcl_distance import FclWorld
from planning.exports.export import joint_tolerance, lever_arms
from tests.planning.scenes import builtin, pillar


@pytest.mark.parametrize("name", ["ur5e", "panda", "scara", "stanford", "planar_rr"])
def test_a_joint_changes_distances_by_at_most_its_lever_arm(name: str) -> None:
    robot = builtin(name)
    every = {(a, b): "obstacles alone" for a in robot.names for b in robot.names if a < b}
    robot = replace(robot, allowed=every)
    arms, n = lever_arms(robot), robot.chain.n
    lower, upper = robot.chain.sampling_bounds()
    random = np.random.default_rng(6)
    largest = np.zeros(n)
    for _ in range(12):
        world = FclWorld(robot, pillar(random.uniform(-3.0, 3.0), random.uniform(0.3, 1.5)))
        q = random.uniform(lower, upper)
        before = world.clearance(q).distance
        for k in range(n):
            moved = q + 0.01 * np.eye(n)[k]
            if before > 0.05:
                rate = abs(world.clearance(moved).distance - before) / 0.01
                assert rate <= arms[k] + 1e-5
                largest[k] = max(largest[k], rate)
    assert largest.max() > 0.2 * arms[int(np.argmax(largest))]  # no bound that says nothing


def test_a_clearance_is_shared_out_over_all_joints() -> None:
    robot = builtin("ur5e")
    tolerance = joint_tolerance(robot, 0.05)
    assert tolerance == pytest.approx(0.05 / lever_arms(robot).sum())


@pytest.mark.parametrize("clearance", [0.0, -0.1, np.inf])
def test_no_tolerance_without_a_clearance(clearance: float) -> None:
    assert joint_tolerance(builtin("ur5e"), clearance) is None
