"""Seams to the end of an arm's reach, where samples of the tolerance miss what is left of it."""

import math

import numpy as np
import pytest

from benchmarks.planning import seams
from benchmarks.planning.seams import SHAPES, SPEED, STARTS, judge, load, seam
from kinematics.pose import transform
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Cylinder
from planning.options import CartesianOptions, Options
from planning.pipeline.pipeline import plan
from planning.problem import PoseGoal, Problem
from planning.result import Failure, Plan
from planning.tool_motions.tool_tolerance import SeamOptions, SeamWaypoint, ToolTolerance
from tests.planning.scenes import planned_motion

#: A seam over a ball, of 1 m: of its last 5 mm a tilt of nearly all 15 degrees is all that is left.
_NUMBER = 38


def test_the_end_of_reach_is_found_from_the_layers_beside_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(seams, "INSTANTS", 151)
    random = np.random.default_rng(7)
    for k in range(_NUMBER + 1):
        waypoints = seam(SHAPES[k % len(SHAPES)], random, 1.0)
    arm, tilt = load("panda"), math.radians(15.0)
    post = Obstacle("post", Cylinder(0.03, 0.8), transform(None, [0.0, 0.6, 0.4]))
    scene = Scene((post,))
    asked = SeamOptions(waypoints, ToolTolerance.of({}, ("rz",), tilt), tool_speed=SPEED)
    goal = PoseGoal(waypoints[-1].T_base_tip)
    problem = Problem(arm.robot, scene, np.array(STARTS["panda"]), (goal,))
    how = CartesianOptions(seam=asked)
    answer = planned_motion(problem, Options(planner="cartesian", cartesian=how, timeout=30.0))
    verdict = judge(arm, scene, waypoints, answer)
    assert verdict.away <= 1e-4
    assert verdict.tilt <= tilt + 1e-3
    assert not verdict.collides


def test_bends_that_joints_can_not_follow_are_told_with_what_helps() -> None:
    arm = load("ur5e")
    down = np.diag([1.0, -1.0, -1.0])
    angles = np.radians([0.0, 3.0, 6.0, 18.0, 21.0, 24.0])
    circle = [[0.45 + 0.1 * math.cos(a), 0.1 * math.sin(a), 0.3] for a in angles]

    def ask(blend: float | None, max_deviation: float) -> Plan | Failure:
        waypoints = tuple(SeamWaypoint(transform(down, p), blend=blend) for p in circle)
        asked = SeamOptions(waypoints, ToolTolerance.of({}, ("rz",)), tool_speed=0.05)
        goal = PoseGoal(waypoints[-1].T_base_tip)
        problem = Problem(arm.robot, Scene(), np.array(STARTS["ur5e"]), (goal,))
        how = CartesianOptions(seam=asked, max_deviation=max_deviation)
        return plan(problem, Options(planner="cartesian", cartesian=how, timeout=30.0))

    refused = ask(None, 1e-7)
    assert isinstance(refused, Failure)
    assert refused.code == "PLANNING_FAILED"
    # Chords of 3 and 12 degrees meet at an angle of half their sum.
    assert refused.details["waypoint"] in (2, 3)
    assert refused.details["bend"] == pytest.approx(math.radians(7.5))
    assert "waypoints[" in refused.message
    assert "by 7.5 degrees" in refused.message
    assert isinstance(ask(0.001, 1e-6), Plan)
    assert isinstance(ask(None, 1e-4), Plan)
