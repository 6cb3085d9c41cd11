"""Seams that no single branch follows: refused, or followed with rests, by pinocchio and FCL."""

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.judges.fcl import FclJudge
from kinematics.pose import transform
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.options import CartesianOptions, Options
from planning.pipeline.pipeline import plan
from planning.problem import PoseGoal, Problem
from planning.result import Failure, Plan
from planning.tool_motions.tool_tolerance import (
    SeamOptions,
    SeamWaypoint,
    StraightOffset,
    ToolTolerance,
)
from tests.planning.pinocchio_arm import PinocchioArm
from tests.planning.scenes import box, builtin

SPEED, REACH, HEIGHT = 0.2, 0.5, 0.35
ANGLES = np.radians(np.linspace(130.0, 240.0, 111))
START = np.array([2.2, -1.2, 1.5, 0.1, 1.2, 0.1])
#: Largest angle of the first joint either way [rad].
TURN = 3.4
BACK = StraightOffset(np.array([0.0, 0.0, -1.0]), 0.06)


def arm() -> RobotGeometry:
    """A KR 6 that turns a little more than once, and can't reach over its back."""
    robot = builtin("kr6_sixx")
    lower, upper = robot.chain.limits.lower.copy(), robot.chain.limits.upper.copy()
    lower[:2], upper[0] = (-TURN, -1.7), TURN
    limits = replace(robot.chain.limits, lower=lower, upper=upper)
    return replace(robot, chain=replace(robot.chain, limits=limits))


def behind() -> tuple[SeamWaypoint, ...]:
    """An arc behind an arm whose first joint has to turn back, beyond 195 degrees."""
    down = np.diag([1.0, -1.0, -1.0])
    places = [[REACH * math.cos(a), REACH * math.sin(a), HEIGHT] for a in ANGLES]
    return tuple(SeamWaypoint(transform(down, place)) for place in places)


def ask(changes: StraightOffset | None, scene: Scene | None = None) -> Plan | Failure:
    points = behind()
    seam = SeamOptions(
        points, ToolTolerance.of({}, ("rz",)), tool_speed=SPEED, branch_changes=changes
    )
    problem = Problem(arm(), scene or Scene(), START, (PoseGoal(points[-1].T_base_tip),))
    how = CartesianOptions(seam=seam)
    return plan(problem, Options(planner="cartesian", cartesian=how, timeout=20.0))


def test_without_leave_the_seam_is_refused_where_the_branch_ends() -> None:
    answer = ask(None)
    assert isinstance(answer, Failure)
    assert answer.code == "PLANNING_FAILED"
    assert answer.details["reason"] in {"branch", "limit"}
    last = float(np.degrees(ANGLES[answer.details["reached_waypoint"]]))
    assert 185.0 <= last <= 195.0
    assert "branch_changes" in answer.hint


def test_with_a_change_the_whole_seam_is_followed_from_rest_to_rest() -> None:
    answer = ask(BACK)
    assert isinstance(answer, Plan), answer
    assert answer.certificate.verified
    parts = [report.part for report in answer.tool_motions]
    cut = parts.index("retreat")
    assert parts[cut + 1] == "approach"
    assert parts.count("retreat") == parts.count("approach") == 1
    # Every way from waypoint to waypoint is carried out, once.
    seam = [report for report in answer.tool_motions if report.part == "seam"]
    assert [report.asked for report in seam] == list(range(len(ANGLES) - 1))
    changed = seam[cut].asked
    assert f"waypoints[{changed}]" in answer.notes[0]
    assert 180.0 <= np.degrees(ANGLES[changed]) <= 195.0
    # The tool is free while the first joint turns back, and at rest before and after.
    away, back = answer.tool_motions[cut], answer.tool_motions[cut + 1]
    motion = answer.trajectory
    assert back.begins > away.ends
    first, second = motion.sample([away.begins, back.ends])
    assert abs(second[0] - first[0]) > 4.0
    rests = [away.begins, away.ends, back.begins, back.ends, motion.duration]
    np.testing.assert_allclose(motion.sample(rests, 1), 0.0, atol=1e-6)


def test_tool_and_clearance_hold_by_independent_kinematics() -> None:
    scene = Scene((box("post", (0.1, 0.1, 1.0), (-0.6, 0.6, 0.5)),))
    answer = ask(BACK, scene)
    assert isinstance(answer, Plan), answer
    oracle = PinocchioArm("kr6_sixx")
    fcl, motion = FclJudge(builtin("kr6_sixx"), scene), answer.trajectory
    for time in np.linspace(0.0, motion.duration, 400):
        assert not fcl.collides(motion.sample([time])[0])
    for report in answer.tool_motions:
        if report.part != "seam":
            continue
        for time in np.linspace(report.begins, report.ends, 5):
            q = motion.sample([min(time, motion.duration)])[0]
            T = oracle.pose(q)
            a, b = report.motion.T_start[:3, 3], report.motion.T_end[:3, 3]
            s = np.clip((T[:3, 3] - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
            assert np.linalg.norm(T[:3, 3] - a - s * (b - a)) <= 1.1e-4
            assert T[2, 2] <= -math.cos(1.1e-3)


@pytest.mark.parametrize("distance", [3.0])
def test_a_retreat_out_of_reach_leaves_the_reason_of_one_branch(distance: float) -> None:
    answer = ask(StraightOffset(np.array([0.0, 0.0, -1.0]), distance))
    assert isinstance(answer, Failure)
    assert answer.details["reason"] in {"branch", "limit"}
    assert "waypoint" in answer.details
