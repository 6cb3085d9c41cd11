"""From a problem to a certified trajectory, on real arms in real scenes."""

import time
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from kinematics.caches import preparation_limit
from kinematics.caches.preparation_limit import PreparationTimedOut
from kinematics.errors import InvalidOption, MissingLimit
from kinematics.forward import forward
from kinematics.ik.numeric.numeric import solve
from kinematics.pose import from_rpy, rotation_error, transform
from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from obstacles.collision.checker import Checker
from obstacles.robots.robot_geometry import robot_geometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Mesh
from planning.options import Options
from planning.pipeline import pipeline
from planning.pipeline.pipeline import plan
from planning.problem import JointGoal, PoseGoal, Problem
from planning.result import Failure, Plan
from planning.timing.options import TimingOptions
from tests.planning.dense import least_clearance, worst_ratio
from tests.planning.scenes import (
    HOME,
    box,
    builtin,
    pillar,
    planned_motion,
    planning_failure,
    shelf,
)
from tests.times import quickest


def solved(problem: Problem, options: Options | None = None) -> Plan:
    answer = planned_motion(problem, options or Options(timeout=20.0))
    check(problem, answer)
    return answer


def check(problem: Problem, answer: Plan) -> None:
    trajectory, certificate = answer.trajectory, answer.certificate
    assert certificate.verified
    assert np.abs(trajectory.start - problem.start).max() < 2e-6
    assert np.abs(trajectory.end - answer.path.waypoints[-1]).max() < 1e-9
    assert np.abs(trajectory.sample([0.0, trajectory.duration], 1)).max() < 1e-9
    assert worst_ratio(trajectory, problem.robot) <= 1.0 + 1e-9
    dense = least_clearance(trajectory, problem.robot, problem.scene)
    assert dense >= certificate.min_clearance - 1e-7
    assert dense > 0.0
    assert least_clearance(trajectory, problem.robot, problem.scene, problem.margin) > 0.0
    assert trajectory.continuity().velocity < 1e-9
    for quantity in ("position", "velocity", "acceleration"):
        assert certificate.limits[quantity].worst_ratio <= 1.0 + 1e-9


def test_free_space_goes_straight() -> None:
    answer = solved(Problem(builtin("panda"), Scene(), HOME, (JointGoal(HOME + 0.3),)))
    assert answer.planner == "straight_line"
    assert [stage.name for stage in answer.stages][:2] == ["preflight", "straight_line"]
    assert len(answer.path.waypoints) == 2
    assert answer.path.length == pytest.approx(0.3 * np.sqrt(7))


def test_standing_still_is_a_motion() -> None:
    answer = solved(Problem(builtin("panda"), Scene(), HOME, (JointGoal(HOME),)))
    assert answer.trajectory.duration < 0.01
    assert answer.path.length == 0.0


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_into_a_shelf_to_a_pose(seed: int) -> None:
    robot = builtin("panda")
    target = transform(from_rpy([np.pi, -np.pi / 2, 0.0]), [0.6, 0.1, 0.3])
    problem = Problem(robot, shelf(), HOME, (PoseGoal(target),))
    answer = solved(problem, Options(timeout=30.0, seed=seed))
    reached = forward(robot.chain, answer.trajectory.end)
    assert np.linalg.norm(reached[:3, 3] - target[:3, 3]) < 1e-4
    assert np.linalg.norm(rotation_error(reached[:3, :3], target[:3, :3])) < 1e-3


def test_from_one_board_to_another() -> None:
    robot, scene = builtin("panda"), shelf()
    checker = Checker.of(robot, scene, 2e-3)
    ends = []
    for height, side in ((0.3, 0.1), (0.7, -0.1)):
        target = transform(from_rpy([np.pi, -np.pi / 2, 0.0]), [0.6, side, height])
        found = solve(robot.chain, target, solutions=12, seed_joints=HOME).solutions
        ends.append(next(s.joints for s in found if checker.valid(s.joints)))
    answer = solved(Problem(robot, scene, ends[0], (JointGoal(ends[1]),)), Options(timeout=30.0))
    assert answer.planner != "straight_line"


@pytest.mark.parametrize("name", ["panda", "ur5e", "iiwa14", "kr6_sixx"])
def test_around_a_post_with_a_margin(name: str) -> None:
    robot = builtin(name)
    random = np.random.default_rng(5)
    lower, upper = robot.chain.sampling_bounds()
    checker = Checker.of(robot, pillar(), 0.03)
    found = 0
    while found < 2:
        share = random.uniform(0.25, 0.75, (2, robot.chain.n))
        start, goal = lower + share * (upper - lower)
        if not (checker.valid(start) and checker.valid(goal)) or checker.free(start, goal):
            continue
        found += 1
        solved(
            Problem(robot, pillar(), start, (JointGoal(goal),), margin=0.02), Options(timeout=30)
        )


def test_slide_and_few_joints() -> None:
    stanford = builtin("stanford")
    lower, upper = stanford.chain.sampling_bounds()
    random = np.random.default_rng(2)
    checker = Checker.of(stanford, Scene())
    ends: list[np.ndarray] = []
    while len(ends) < 2:
        q = random.uniform(lower, upper)
        ends += [q] if checker.valid(q) else []
    solved(Problem(stanford, Scene(), ends[0], (JointGoal(ends[1]),)))
    arm = builtin("planar_rr")
    scene = Scene((box("block", (0.3, 0.3, 0.3), (1.2, 0.0, 0.9)),))
    solved(Problem(arm, scene, np.array([-0.3, 0.2]), (JointGoal(np.array([2.0, 0.3])),)))


@pytest.mark.parametrize("planner", ["potential_field", "rrt_connect"])
def test_one_planner_alone(planner: str) -> None:
    robot = builtin("panda")
    scene = Scene((box("post", (0.05, 0.05, 0.1), (0.5, 0.25, 0.45)),))
    start, goal = HOME.copy(), HOME.copy()
    goal[0] = 0.9
    answer = solved(
        Problem(robot, scene, start, (JointGoal(goal),)), Options(planner=planner, timeout=20.0)
    )
    assert answer.planner == planner
    assert planner in [stage.name for stage in answer.stages]


def failed(problem: Problem, options: Options | None = None) -> Failure:
    answer = planning_failure(problem, options or Options(timeout=5.0))
    assert answer.hint
    assert answer.stages
    return answer


def test_limits_of_start_and_goal() -> None:
    robot = builtin("panda")
    outside = HOME.copy()
    outside[3] = 0.5
    answer = failed(Problem(robot, Scene(), outside, (JointGoal(HOME),)))
    assert answer.code == "START_STATE_INVALID"
    assert answer.details["joint"] == "panda_joint4"
    assert answer.details["value"] == 0.5
    assert answer.details["excess"] == pytest.approx(0.5698)
    assert "0.57 above its upper limit -0.0698" in answer.message
    outside[3] = -3.5
    answer = failed(Problem(robot, Scene(), outside, (JointGoal(HOME),)))
    assert "joint 'panda_joint4' is at -3.5, 0.428 below its lower limit -3.07" in answer.message
    assert failed(Problem(robot, Scene(), HOME, (JointGoal(outside),))).code == "GOAL_STATE_INVALID"
    barely = HOME.copy()
    barely[3] = robot.chain.limits.upper[3] + 1e-7
    goal = HOME.copy()
    snapped = planned_motion(Problem(robot, Scene(), barely, (JointGoal(goal),)), Options())
    assert "moved onto it" in snapped.notes[0]


def test_unreachable_pose_says_how_far() -> None:
    answer = failed(
        Problem(builtin("panda"), Scene(), HOME, (PoseGoal(transform(None, [2, 0, 0.5])),))
    )
    assert answer.code == "NO_IK_SOLUTION"
    assert answer.details["position_error"] > 0.9
    assert "beyond the longest" in answer.hint


def test_no_way_times_out_in_time() -> None:
    robot = builtin("planar_rr")
    # A wall from the first joint outwards: the arm can't get from one side to the other.
    walls = Scene(
        (
            box("up", (0.1, 0.5, 3.0), (0.0, 0.0, 1.8)),
            box("down", (0.1, 0.5, 3.0), (0.0, 0.0, -1.8)),
        )
    )
    goal = JointGoal(np.array([np.pi - 0.3, 0.0]))

    def attempt() -> float:
        began = time.monotonic()
        answer = failed(Problem(robot, walls, np.array([0.3, 0.0]), (goal,)), Options(timeout=1.0))
        took = time.monotonic() - began
        assert answer.code == "TIMED_OUT"
        assert answer.stage == "rrt_connect"
        return took

    assert quickest(attempt, 1.5) < 1.5


def test_caller_faults_are_named() -> None:
    with pytest.raises(InvalidOption):
        Options(timeout=0.0)
    with pytest.raises(InvalidOption):
        TimingOptions(velocity_scaling=1.5)


def test_missing_limit_names_the_joints() -> None:
    urdf = """<robot name="r"><link name="a"/><link name="b"/>
      <joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
      <limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"""
    description = parse_urdf(urdf)
    robot = robot_geometry(serial_chain(description), description)
    with pytest.raises(MissingLimit, match="no acceleration limit is known"):
        plan(Problem(robot, Scene(), np.zeros(1), (JointGoal(np.ones(1) * 0.5),)), Options())


def test_a_mesh_that_takes_too_long_to_prepare_is_told_at_the_deadline(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    body = trimesh.creation.torus(0.1, 0.0321, major_sections=12, minor_sections=8)
    ring = Mesh(np.asarray(body.vertices), np.asarray(body.faces, dtype=np.int64))
    scene = Scene((Obstacle("ring", ring, transform(np.eye(3), [2.0, 0.0, 0.5])),))
    goal = HOME.copy()
    goal[0] += 0.3
    problem = Problem(builtin("panda"), scene, HOME, (JointGoal(goal),))
    # Nobody knows how fast the machine is: time is up at the fifth look.
    looks = iter([0.0] * 4)
    clock = SimpleNamespace(monotonic=lambda: next(looks, np.inf))
    with monkeypatch.context() as late:
        late.setattr(preparation_limit, "time", clock)
        answer = plan(problem, Options(timeout=20.0))
    assert isinstance(answer, Failure)
    assert (answer.code, answer.stage) == ("TIMED_OUT", "preparation")
    assert "meshes were being prepared" in answer.message
    assert "more time" in answer.hint
    solved(problem)


def test_what_is_proved_is_answered_where_there_is_no_time_for_the_report(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    goal = HOME.copy()
    goal[0] += 0.3
    problem = Problem(builtin("panda"), Scene(), HOME, (JointGoal(goal),))
    assert solved(problem).clearance is not None

    def late(*_: object) -> None:
        raise PreparationTimedOut("time was up")

    monkeypatch.setattr(pipeline, "clearance_report", late)
    answer = solved(problem)
    assert answer.clearance is None
    assert not answer.deterministic
    assert any("no time" in note for note in answer.notes)
