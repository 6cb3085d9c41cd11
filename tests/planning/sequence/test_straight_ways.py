"""Straight ways that a plain joint motion has not: round something, out of singular poses."""

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import armwright as aw
from benchmarks.judges.fcl import FclJudge
from kinematics.arrays import Array
from kinematics.robots import builtin_urdf
from planning.problem import PoseGoal
from planning.sequence import search
from planning.sequence.node import child_node
from planning.sequence.result import SequenceFailure, TaskOptions
from planning.sequence.search import plan_task
from planning.sequence.stage import Move, Straight
from planning.sequence.step import Line, LineStopped, lead_straight
from planning.sequence.task import Task
from planning.sequence.world import Cells, World
from planning.values.deadline import Deadline
from tests.planning.sequence import crate

PANDA_TIP = "panda_hand_tcp"
UP = np.array([0.0, 0.0, 1.0])


def tool_poses(joints: Array) -> Array:
    """Poses of the Panda's tool by pinocchio, shape (k, 4, 4)."""
    model = pin.buildModelFromXML(builtin_urdf("panda"))
    data, tip = model.createData(), model.getFrameId(PANDA_TIP)
    poses = []
    for q in joints:
        pin.framesForwardKinematics(model, data, np.append(q, np.zeros(model.nq - len(q))))
        poses.append(data.oMf[tip].homogeneous.copy())
    return np.array(poses)


def elbow_in_the_way(seed: int) -> tuple[World, Straight, Array, Line | LineStopped] | None:
    """A straight way up with a ball where the forearm would be; None where it is no use."""
    random = np.random.default_rng([61, seed])
    q = crate.HOME + random.uniform(-0.4, 0.4, 7)
    stage = Straight("retreat", UP, "root", 0.15, 0.15)
    free = World(crate.panda(), aw.Scene())
    way = lead_straight(Cells().cell(free), free, stage, q, Deadline.after(10.0))
    if isinstance(way, LineStopped):
        return None
    before, after = (
        aw.fk(crate.panda(), joints, link="panda_link5")[:3, 3] for joints in (q, way.end)
    )
    ahead = (after - before) / np.linalg.norm(after - before)
    ball = aw.Obstacle("ball", aw.Sphere(0.03), aw.pose(after + 0.09 * ahead))
    world = World(crate.panda(), aw.Scene([ball]))
    cell = Cells().cell(world)
    if not cell.checker.valid(q):
        return None
    stopped = lead_straight(cell, world, stage, q, Deadline.after(10.0))
    if not isinstance(stopped, LineStopped):
        return None
    return world, stage, q, lead_straight(cell, world, stage, q, Deadline.after(10.0), around=True)


def test_the_elbow_goes_round_a_ball_while_the_tool_goes_straight() -> None:
    cases = [case for seed in range(24) if (case := elbow_in_the_way(seed)) is not None]
    found = [case for case in cases if isinstance(case[3], Line)]
    assert len(cases) >= 8
    assert len(found) >= 5
    for world, stage, q, way in found:
        assert isinstance(way, Line)
        path = way.path.segments[0].path
        assert path is not None
        joints = path.sample(np.linspace(0.0, path.length, 200))
        np.testing.assert_array_equal(joints[0], q)
        judge = FclJudge(world.robot, world.scene)
        assert not any(judge.collides(one) for one in joints)
        poses = tool_poses(joints)
        np.testing.assert_allclose(poses[:, :3, :3], poses[:1, :3, :3].repeat(200, 0), atol=2e-3)
        off = poses[:, :3, 3] - poses[0, :3, 3]
        assert np.abs(off[:, :2]).max() < 1e-3
        assert off[-1, 2] == pytest.approx(stage.least, abs=1e-6)


@pytest.mark.parametrize("along", [[1, 0, 0], [0, 1, 0], [1, 1, 0]])
def test_a_way_out_of_a_straight_wrist_begins_in_another_of_its_configurations(
    along: list[float],
) -> None:
    robot = aw.load_robot("kr6_sixx")
    world, stage = World(robot, aw.Scene()), Straight("retreat", along, "tool", 0.05, 0.05)
    # Axes 4 and 6 are one: any share of the turn is the same pose.
    turns = np.linspace(-1.2, 1.2, 7)[:, None] * np.array([0.0, 0.0, 0.0, 1.0, 0.0, -1.0])
    stops = [
        led
        for q in np.array([0.2, -1.2, 1.7, 0.4, 0.0, -0.3]) + turns
        if isinstance(
            led := lead_straight(Cells().cell(world), world, stage, q, Deadline.after(10.0)),
            LineStopped,
        )
    ]
    assert stops
    for led in stops:
        way = led.found_round([led.start], Deadline.after(10.0), any_start=True)
        assert way is not None
        ends = aw.fk(robot, np.array([led.start, way.segments[0].start, way.segments[0].end]))
        np.testing.assert_allclose(ends[1], ends[0], atol=1e-6)
        moved = ends[0, :3, :3].T @ (ends[2, :3, 3] - ends[0, :3, 3])
        expected = 0.05 * np.array(along) / np.linalg.norm(along)
        np.testing.assert_allclose(moved, expected, atol=1e-5)


def test_a_way_beyond_the_arms_reach_is_told_so() -> None:
    robot = aw.load_robot("ur5e")
    q = np.array([0.3, -1.0, 0.5, -0.6, -1.2, 0.2])
    T = aw.fk(robot, q)
    away = T[:3, 3] / np.linalg.norm(T[:3, 3])
    stages = Move((PoseGoal(T),)), Straight("retreat", away, "root", 0.2, 0.2)
    answer = plan_task(Task(World(robot, aw.Scene()), q, stages), TaskOptions(30.0))
    assert isinstance(answer, SequenceFailure)
    assert (answer.code, answer.stage) == ("PLANNING_FAILED", 1)
    assert "out_of_reach: the shortest way asked for, 0.2 m, ends there, by" in answer.message
    assert "nearer to the robot" in answer.hint


def test_a_place_without_a_way_off_is_tried_once_not_with_each_grasp_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lid = aw.Obstacle("lid", aw.Box((0.3, 0.3, 0.02)), aw.pose([*crate.PLACE, 0.5]))
    tried: list[object] = []

    def counted(*given: Any, **more: Any) -> Any:
        node, segment, (target, q) = given[2], given[3], given[4]
        if segment.target == 8:
            tried.append((node.onward_world.key, target.number, q.tobytes()))
        return child_node(*given, **more)

    monkeypatch.setattr(search, "child_node", counted)
    stages = crate.stages(crate.grasps(2), crate.places(2))
    answer = crate.task_failure(Task(crate.world(lid), crate.HOME, stages), TaskOptions(60.0))
    assert answer.code == "PLANNING_FAILED"
    assert answer.stage in (7, 12)
    assert tried
    assert len(tried) <= 2 * len(set(tried))
