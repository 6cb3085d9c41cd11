"""Verdicts on eight states at once are FCL's, and those on each state by itself."""

import numpy as np
import pytest

from benchmarks.judges.fcl import FclJudge
from benchmarks.verdict import builtin, clutter
from compiled.kernel import kernel
from compiled.simd import LANES
from kinematics.arrays import Array
from kinematics.robots import builtin_names
from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from obstacles.collision.checker import Checker
from obstacles.collision.lanes.check import blocked_between, blocked_lanes, write_states
from obstacles.collision.model.collision_model import ModelArrays
from obstacles.collision.model.kernel_work import workspace
from obstacles.robots.robot_geometry import RobotGeometry, robot_geometry
from tests.mimic_joints import urdf

#: All eight states.
EVERY = 255


@kernel
def blocked_on(model: ModelArrays, states: Array, asked: int, vital: int, together: int) -> int:
    """``blocked_lanes`` of states (8, n)."""
    work, shares = workspace(model), np.ones(LANES)
    for number in range(LANES):
        write_states(work, states[number], states[number], shares, number, LANES)
    return blocked_lanes(model, work, 0.0, asked, vital, together)


@kernel
def between(model: ModelArrays, a: Array, b: Array, parts: int, looks: int) -> bool:
    """``blocked_between``."""
    return blocked_between(model, workspace(model), a, b, 0.0, parts, looks)


def mimic() -> RobotGeometry:
    """An arm with links on joints that mimic others."""
    description = parse_urdf(urdf())
    return robot_geometry(serial_chain(description, tip_link="flange"), description)


def bits(lanes: list[bool]) -> int:
    """Truth values as bits, the first one lowest."""
    return sum(1 << k for k, value in enumerate(lanes) if value)


@pytest.mark.parametrize("name", [*builtin_names(), "mimic joint"])
def test_no_lane_differs_from_fcl(name: str) -> None:
    robot = mimic() if name == "mimic joint" else builtin(name)
    random = np.random.default_rng(61)
    reach = float(np.linalg.norm(robot.chain.offsets[:, :3, 3], axis=1).sum()) + 0.1
    scene = clutter(random, reach)
    checker, judge = Checker.of(robot, scene), FclJudge(robot, scene)
    lower, upper = robot.chain.sampling_bounds()
    for states in random.uniform(lower, upper, (10, LANES, robot.chain.n)):
        truth = bits([judge.collides(q) for q in states])
        arrays = checker.model.arrays
        assert blocked_on(arrays, states, EVERY, 0, 0) == truth
        assert truth == bits([not checker.valid(q) for q in states])
        # Some of them alone, and those of which one will do.
        asked = int(random.integers(1, EVERY + 1))
        assert blocked_on(arrays, states, asked, 0, 0) == truth & asked
        found = blocked_on(arrays, states, EVERY, asked, 0)
        assert found & ~truth == 0
        assert (found & asked != 0) == (truth & asked != 0)
        found = blocked_on(arrays, states, EVERY, 0, asked)
        assert found == (truth | asked if truth & asked else truth)


def test_margins_are_kept_in_every_lane() -> None:
    robot, random = builtin("panda"), np.random.default_rng(62)
    scene = clutter(random, 0.9)
    lower, upper = robot.chain.sampling_bounds()
    near, bare = Checker.of(robot, scene, 0.05), Checker.of(robot, scene)
    told = 0
    for states in random.uniform(lower, upper, (20, LANES, robot.chain.n)):
        found = blocked_on(near.model.arrays, states, EVERY, 0, 0)
        assert found == bits([not near.valid(q) for q in states])
        told += found != blocked_on(bare.model.arrays, states, EVERY, 0, 0)
    assert told > 0


@pytest.mark.parametrize("parts", [1, 2])
@pytest.mark.parametrize("looks", [2, 4, 16])
def test_a_motion_is_blocked_where_a_state_is_that_is_looked_at(parts: int, looks: int) -> None:
    robot = builtin("ur5e")
    random = np.random.default_rng(63)
    checker = Checker.of(robot, clutter(random, 1.2))
    lower, upper = robot.chain.sampling_bounds()
    shares = [k / looks for k in range(1, looks + (parts == 1))]
    outcomes = set()
    for _ in range(60):
        a, b = random.uniform(lower, upper, (2, robot.chain.n))
        b = a + 0.2 * (b - a)
        blocked = any(not checker.valid(a + share * (b - a)) for share in shares)
        assert between(checker.model.arrays, a, b, parts, looks) == blocked
        outcomes.add(blocked)
    assert outcomes == {True, False}
