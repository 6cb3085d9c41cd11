"""Verdicts on any number of states are FCL's, state by state."""

import numpy as np
import pytest

from benchmarks.judges.fcl import FclJudge
from benchmarks.verdict import builtin, clutter
from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from obstacles.collision.checker import Checker
from obstacles.robots.robot_geometry import RobotGeometry, robot_geometry
from tests.mimic_joints import urdf


def robot_named(name: str) -> RobotGeometry:
    """A built-in robot, or an arm with links on joints that mimic others."""
    if name != "mimic joint":
        return builtin(name)
    description = parse_urdf(urdf())
    return robot_geometry(serial_chain(description, tip_link="flange"), description)


@pytest.mark.parametrize("name", ["panda", "ur5e", "mimic joint"])
def test_no_state_of_any_number_differs_from_fcl(name: str) -> None:
    robot, random = robot_named(name), np.random.default_rng(71)
    reach = float(np.linalg.norm(robot.chain.offsets[:, :3, 3], axis=1).sum()) + 0.1
    scene = clutter(random, reach)
    checker, judge = Checker.of(robot, scene), FclJudge(robot, scene)
    lower, upper = robot.chain.sampling_bounds()
    outcomes = set()
    for count in (*range(20), 64, 65, 71):
        states = random.uniform(lower, upper, (count, robot.chain.n))
        truth = [not judge.collides(q) for q in states]
        assert checker.each_valid(states).tolist() == truth
        outcomes |= set(truth)
    assert outcomes == {True, False}
