"""Which configuration of a pose plans, tasks and tours end in, beside others found apart."""

import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.ik.inverse import inverse_kinematics
from kinematics.model.chain import Chain
from kinematics.pose import from_rpy, transform
from kinematics.robots import builtin_urdf
from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from obstacles.collision.checker import Checker
from obstacles.robots.robot_geometry import robot_geometry
from obstacles.scenes.scene import Obstacle, Scene
from planning.goal_choice.goal_order import (
    MAX_LONGER_IN_BRANCH,
    limit_shares,
    order_goals,
    plan_configuration,
)
from planning.options import Options
from planning.pipeline import pipeline
from planning.planner import Ready
from planning.preflight.goals import pose_goals
from planning.preflight.preflight import preflight
from planning.problem import JointGoal, PoseGoal, Problem
from planning.result import Plan
from planning.sequence.result import SequencePlan, TaskOptions
from planning.sequence.stage import Move, StageSettings, Straight
from planning.sequence.task import Task
from planning.sequence.world import World
from planning.timing.rest_to_rest import motion_times
from planning.tours.planner import plan_tour
from planning.tours.problem import TourGoal, TourOptions, TourProblem
from planning.tours.result import Tour
from planning.values.preferences import GoalCosts, PreferredClearance
from tests.planning.goal_choice_sequences import judge as judge_sequences
from tests.planning.goal_judge import judge, limit_share
from tests.planning.pinocchio_arm import PinocchioArm
from tests.planning.scenes import HOME, box, builtin, planned_motion
from tests.planning.sequence import crate


@pytest.mark.parametrize(
    ("name", "count"),
    [
        # One turn and less.
        ("kr6_sixx", 4),
        # A joint to spare.
        ("iiwa14", 4),
        ("panda", 2),
        # Joints that slide; no closed form.
        ("stanford", 4),
        ("scara", 4),
    ],
)
def test_no_plan_ends_at_a_limit_where_another_configuration_takes_little_longer(
    name: str, count: int
) -> None:
    tally = judge(builtin(name), builtin_urdf(name), count, seed=0)
    assert tally.planned == count
    assert tally.broken == []


def test_joints_without_end_have_no_limit_to_be_at() -> None:
    """A UR5e whose base, first and last wrist joint turn without end."""
    urdf = builtin_urdf("ur5e")
    for joint in ("shoulder_pan_joint", "wrist_1_joint", "wrist_3_joint"):
        urdf = urdf.replace(
            f'<joint name="{joint}" type="revolute"', f'<joint name="{joint}" type="continuous"'
        )
    description = parse_urdf(urdf)
    robot = robot_geometry(serial_chain(description), description, {})
    assert robot.chain.continuous.sum() == 3
    tally = judge(robot, urdf, 4, seed=0)
    assert tally.planned == 4
    assert tally.broken == []


def test_motions_take_the_turns_that_are_near() -> None:
    """Two of nearly every joint; half of a UR5e's motions took 1.14 times as long without them."""
    tally = judge(builtin("ur5e"), builtin_urdf("ur5e"), 8, seed=1)
    assert (tally.planned, tally.broken) == (8, [])
    assert np.median(tally.behind) < 1.02


def test_configurations_that_are_asked_for_are_kept() -> None:
    robot, at_limit = builtin("panda"), HOME.copy()
    at_limit[6] = 0.999 * robot.chain.limits.upper[6]
    problem = Problem(robot, Scene(), HOME, (JointGoal(at_limit),))
    answer = planned_motion(problem, Options(timeout=20.0))
    assert np.array_equal(answer.path.waypoints[-1], at_limit)
    assert limit_share(robot.chain, at_limit) < 0.02


ONLY_TIME = GoalCosts(1.0, 0.0, 0.0, 0.0, 0.0)


def panda() -> Chain:
    return builtin("panda").chain


def at_limit(share: float, joint: int = 1) -> Array:
    """HOME with a joint so far from its upper limit, as a share of its range."""
    limits, q = panda().limits, HOME.copy()
    q[joint] = limits.upper[joint] - share * (limits.upper[joint] - limits.lower[joint])
    return q


def test_a_configuration_at_a_limit_comes_last_where_another_is_little_slower() -> None:
    start, edge = at_limit(0.1), at_limit(0.01)
    step = edge[1] - start[1]
    for factor, first in ((1.05, "other"), (3.0, "edge")):
        other = start.copy()
        other[1] -= step * factor
        goals, best = order_goals(panda(), start, [edge, other], [0.1, 0.1], ONLY_TIME)
        assert np.array_equal(goals[0], other if first == "other" else edge)
        assert best == 1


def test_each_weight_can_decide() -> None:
    chain, start = panda(), HOME
    rng = np.random.default_rng(5)
    low, high = chain.limits.lower, chain.limits.upper
    goals = [low + (high - low) * rng.uniform(0.05, 0.95, 7) for _ in range(12)]
    clearances = list(rng.uniform(0.0, 0.06, 12))
    none = GoalCosts(0.0, 0.0, 0.0, 0.0, 0.0)
    first = {
        name: order_goals(chain, start, goals, clearances, replace(none, **{name: 1.0}))[0][0]
        for name in ("motion_time", "joint_limits", "clearance")
    }
    quickest = min(goals, key=lambda q: motion_times(chain, start, q[None])[0])
    assert np.array_equal(first["motion_time"], quickest)
    most = limit_shares(chain, np.array(goals)).max()
    assert limit_shares(chain, first["joint_limits"][None])[0] >= min(most, 0.15)
    chosen = next(k for k, q in enumerate(goals) if np.array_equal(q, first["clearance"]))
    assert clearances[chosen] >= min(max(clearances), 0.05)


#: A joint that makes each arm singular at 0, and the share of starts drawn near that.
SINGULAR = {"panda": 5, "iiwa14": 5, "ur5e": 4, "kr6_sixx": 4}
#: Steps in which the tool is led to its goal, and Newton steps in each.
STEPS, NEWTON = 30, 30


class Arm(PinocchioArm):
    """An arm that is led by its tool."""

    def led(self, q: np.ndarray, goal: np.ndarray) -> np.ndarray | None:
        """Where damped Newton steps lead the arm along the straight way; None where they fail."""
        T = self.pose(q)
        way = error(T, goal)
        for k in range(1, STEPS + 1):
            part = way * k / STEPS
            towards = np.eye(4)
            towards[:3, :3], towards[:3, 3] = pin.exp3(part[3:]) @ T[:3, :3], T[:3, 3] + part[:3]
            for _ in range(NEWTON):
                e = error(self.pose(q), towards)
                J = self.jacobian(q)
                q = q + np.clip(J.T @ np.linalg.solve(J @ J.T + 1e-6 * np.eye(6), e), -0.05, 0.05)
            if np.abs(error(self.pose(q), towards)).max() > 1e-6:
                return None
        return q


def error(T: np.ndarray, goal: np.ndarray) -> np.ndarray:
    return np.concatenate([goal[:3, 3] - T[:3, 3], pin.log3(goal[:3, :3] @ T[:3, :3].T)])


def small_move(arm: Arm, random: np.random.Generator, joint: int) -> tuple[np.ndarray, np.ndarray]:
    """A free start near a singularity, and a pose 5 mm and some tenths of a degree from there."""
    low, high = arm.chain.sampling_bounds()
    checker = Checker.of(builtin(arm.chain.name), Scene())
    while True:
        q = random.uniform(0.9 * low + 0.1 * high, 0.1 * low + 0.9 * high)
        q[joint] = np.clip(0.03 * random.normal(), low[joint], high[joint])
        if checker.valid(q):
            break
    goal, way, turn = arm.pose(q), random.normal(size=3), 0.01 * random.normal(size=3)
    goal[:3, 3] += 0.005 * way / np.linalg.norm(way)
    goal[:3, :3] = pin.exp3(turn) @ goal[:3, :3]
    return q, goal


@pytest.mark.parametrize("name", SINGULAR)
def test_a_small_move_never_turns_the_arm_over(name: str) -> None:
    arm, judged = Arm(name), 0
    checker, limits = Checker.of(builtin(name), Scene()), arm.chain.limits
    for seed in range(8):
        q, goal = small_move(arm, np.random.default_rng(seed), SINGULAR[name])
        own = arm.led(q, goal)
        if own is None or (own < limits.lower).any() or (own > limits.upper).any():
            continue
        if not checker.free(q, own) or min(checker.clearance(x)[0] for x in (q, own)) < 1e-3:
            continue
        problem = Problem(builtin(name), Scene(), q, (PoseGoal(goal),))
        answer = planned_motion(problem, Options(timeout=10.0))
        end = answer.trajectory.end
        least, taken = motion_times(arm.chain, q, np.array([own, end]))
        assert taken <= MAX_LONGER_IN_BRANCH * least + 1e-3, (seed, own - q, end - q)
        assert np.abs(end - q).max() <= MAX_LONGER_IN_BRANCH * np.abs(own - q).max() + 0.05
        judged += 1
    assert judged >= 3


START = np.array([0.3, -1.4, 1.6, -1.5, -1.4, 0.5])
GOAL = np.array([-0.4, -1.1, 1.3, -1.2, -1.5, 0.1])


def _share(chain: Chain, q: Array) -> float:
    low, high = chain.limits.lower, chain.limits.upper
    return float((np.minimum(q - low, high - q) / (high - low)).min())


def _plan(robot: str, start: Array, goal: Array, *around: Obstacle, **more: object) -> Plan:
    arm = builtin(robot)
    goals = (PoseGoal(forward(arm.chain, goal)),)
    return planned_motion(Problem(arm, Scene(around), start, goals), Options(timeout=20.0, **more))  # type: ignore[arg-type]


def test_costs_are_those_of_the_configuration_that_the_plan_ends_in() -> None:
    arm = builtin("ur5e")
    wall = box("wall", (0.1, 0.5, 0.1), (-0.75, 0.2, 0.6))
    answer = _plan("ur5e", START, GOAL, wall)
    last, chosen = answer.path.waypoints[-1], answer.configuration
    assert chosen is not None
    assert chosen.branch
    assert chosen.found > 1
    share = _share(arm.chain, last)
    assert chosen.limit_share == pytest.approx(share)
    weights = GoalCosts()
    clearance = Checker.of(arm, Scene((wall,))).clearance(last)[0]
    turned = int((np.abs(last - START) > np.pi).sum())
    assert chosen.costs == pytest.approx(
        {
            "motion_time": weights.motion_time * motion_times(arm.chain, START, last[None])[0],
            "joint_limits": weights.joint_limits * max(1.0 - share / 0.15, 0.0),
            "manipulability": chosen.costs["manipulability"],
            "turns": weights.turns * turned,
            "clearance": weights.clearance * max(1.0 - clearance / 0.05, 0.0),
        }
    )
    assert 0.0 <= chosen.costs["manipulability"] <= weights.manipulability


def test_goals_that_are_joints_leave_no_choice() -> None:
    arm = builtin("ur5e")
    both = (JointGoal(GOAL), PoseGoal(forward(arm.chain, START + 0.8)))
    answer = planned_motion(Problem(arm, Scene(), START, both[:1]), Options(timeout=20.0))
    assert answer.configuration is None
    near = JointGoal(START + 0.05)
    answer = planned_motion(Problem(arm, Scene(), START, (near, both[1])), Options(timeout=20.0))
    assert np.array_equal(answer.path.waypoints[-1], near.joints)
    assert answer.configuration is None


def test_a_redundant_arm_and_one_without_closed_form_say_it_too() -> None:
    panda = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
    chosen = _plan("panda", panda, panda + 0.2).configuration
    assert chosen is not None
    assert chosen.branch
    slid = np.array([0.2, 0.4, 0.6, 0.3, 0.5, 0.1])
    chosen = _plan("stanford", slid, slid + 0.1).configuration
    assert chosen is not None
    assert chosen.limit_share > 0.0


def test_weights_are_those_of_the_request() -> None:
    heavy = replace(GoalCosts(), motion_time=3.0)
    one = _plan("ur5e", START, GOAL).configuration
    other = _plan("ur5e", START, GOAL, goal_costs=heavy).configuration
    assert one is not None
    assert other is not None
    assert other.costs["motion_time"] == pytest.approx(3.0 * one.costs["motion_time"])


def test_a_configuration_that_took_the_place_of_one_at_a_limit_says_so() -> None:
    arm = builtin("ur5e")
    problem = Problem(arm, Scene(), START, (PoseGoal(forward(arm.chain, GOAL)),))
    ready = preflight(problem, 0)
    assert isinstance(ready, Ready)
    weights, last = GoalCosts(), ready.goals[0]
    posed = pose_goals(problem, [candidate.joints for candidate in ready.found])
    chosen = plan_configuration(problem, ready, posed, last, weights, (1.25, 1.5))
    assert chosen is not None
    assert chosen.reason.startswith("In place of one within 2 % of a joint limit")
    assert "1.500 s, and 1.250 s with that one" in chosen.reason
    assert plan_configuration(problem, ready, posed, last + 1e-6, weights) is None


def test_a_plan_that_took_the_place_of_another_tells_the_times_of_both(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As if the first plan had ended at a limit: few do, where something is in the way."""
    first = _plan("ur5e", START, GOAL)
    monkeypatch.setattr(pipeline, "ends_off_limits", lambda *given: given[2][1:2])
    monkeypatch.setattr(pipeline, "MAX_LONGER", 100.0)
    answer = _plan("ur5e", START, GOAL)
    assert not np.array_equal(answer.path.waypoints[-1], first.path.waypoints[-1])
    assert answer.configuration is not None
    times = f"{answer.trajectory.duration:.3f} s, and {first.trajectory.duration:.3f} s"
    assert times in answer.configuration.reason
    share = _share(builtin("ur5e").chain, answer.path.waypoints[-1])
    assert answer.configuration.limit_share == pytest.approx(share)


@pytest.mark.parametrize("tilt", [0.0, 0.05])
def test_a_plan_that_ends_off_its_pose_says_how_far(tilt: float) -> None:
    """The tool of a SCARA stands upright: it can't be tilted as a pose asks."""
    robot, start = builtin("scara"), np.zeros(4)
    T = forward(robot.chain, np.array([0.3, 0.6, 0.05, 0.2]))
    T = T @ transform(from_rpy([tilt, 0.0, 0.0]), [0.0, 0.0, 0.0])
    answer = planned_motion(Problem(robot, Scene(), start, (PoseGoal(T, 1e-3, 0.2),)), Options())
    notes = [note for note in answer.notes if "off, within the goal's tolerances" in note]
    if tilt == 0.0:
        assert not notes
        return
    error = pin.SE3(T).actInv(pin.SE3(forward(robot.chain, answer.path.waypoints[-1])))
    (away, angle) = re.findall(r"([\d.e-]+) (?:m|rad)\b", notes[0])
    assert float(away) == pytest.approx(np.linalg.norm(error.translation), rel=0.01, abs=1e-9)
    assert float(angle) == pytest.approx(np.linalg.norm(pin.log3(error.rotation)), rel=0.01)
    # To the joints that it ended in, nothing is off.
    joints = Problem(robot, Scene(), start, (JointGoal(answer.path.waypoints[-1]), PoseGoal(T)))
    known = planned_motion(joints, Options())
    assert not any("off" in note for note in known.notes)


NEAR = 0.02


@pytest.mark.parametrize("kind", ["task", "tour"])
@pytest.mark.parametrize(
    ("name", "count"),
    [
        # Two turns of nearly every joint.
        ("ur5e", 6),
        # One turn and less.
        ("kr6_sixx", 6),
        # A joint to spare.
        ("panda", 6),
        # Joints that slide; no closed form.
        ("stanford", 3),
    ],
)
def test_no_pose_is_taken_at_a_limit_where_another_configuration_takes_little_longer(
    name: str, count: int, kind: str
) -> None:
    tally = judge_sequences(name, kind, count, seed=0)
    # The Panda's tasks try twelve values of its parameter, and some poses have none of these.
    assert tally.solved == count or (name, kind) == ("panda", "task")
    assert tally.broken == []


def _at_limit_and_beside() -> tuple[Array, Array, Array]:
    """A start of a KR 6, a configuration at a limit that is near it, another of its pose."""
    chain = builtin("kr6_sixx").chain
    q = np.array([0.3, -1.2, 1.9, 0.0, 0.9, 0.2])
    q[5] = chain.limits.upper[5] - 0.01 * (chain.limits.upper[5] - chain.limits.lower[5])
    start = q - np.array([0.2, 0.1, 0.1, 0.0, 0.1, 0.3])
    inside = q.copy()
    inside[5] -= 2.0 * np.pi
    return start, q, inside


def _task(*stages: Move | Straight, costs: GoalCosts | None = None) -> SequencePlan:
    world = World(builtin("kr6_sixx"), Scene(()))
    task = Task(world, _at_limit_and_beside()[0], stages)
    return crate.planned_task(task, TaskOptions(20.0, goal_costs=costs or GoalCosts()))


def test_configurations_that_are_asked_for_are_kept_and_cost_nothing() -> None:
    start, q, _ = _at_limit_and_beside()
    answer = _task(Move((JointGoal(q),)))
    np.testing.assert_allclose(answer.stages[0].trajectory.end, q, atol=1e-12)
    assert answer.stages[0].configuration is None
    goals = tuple(TourGoal(str(k), (JointGoal(p),)) for k, p in enumerate((q, start)))
    tour = plan_tour(TourProblem(builtin("kr6_sixx"), Scene(()), goals, start))
    assert isinstance(tour, Tour)
    assert [visit.configuration for visit in tour.visits] == [None, None]


def test_the_rests_that_follow_from_a_choice_count_as_well() -> None:
    """Lines after poses near a limit: where one ends at it another configuration is taken."""
    robot = builtin("iiwa14")
    chain, random = robot.chain, np.random.default_rng(1)
    low, high = chain.sampling_bounds()
    in_place = 0
    for _ in range(40):
        q = 0.7 * random.uniform(low, high)
        joint = int(random.integers(chain.n))
        q[joint] = high[joint] - 0.022 * (high[joint] - low[joint])
        T, direction = forward(chain, q), random.normal(size=3)
        end = T.copy()
        end[:3, 3] += 0.08 * direction / np.linalg.norm(direction)
        if not inverse_kinematics(chain, end).solutions:
            continue  # The line leads out of reach, which half a second of search would tell.
        line = Straight("retreat", direction, "root", 0.08, 0.08)
        task = Task(World(robot, Scene(())), q - 0.2 * np.sign(q), (Move((PoseGoal(T),)), line))
        answer = crate.planned_task(task, TaskOptions(20.0))
        rests = np.array([stage.trajectory.end for stage in answer.stages])
        chosen = answer.stages[0].configuration
        assert chosen is not None
        if chosen.reason.startswith("In place of one"):
            in_place += 1
            assert limit_shares(chain, rests).min() >= NEAR
    assert in_place >= 2


def test_weights_say_what_is_chosen_and_the_answer_what_it_costs() -> None:
    robot = builtin("kr6_sixx")
    pose = PoseGoal(forward(robot.chain, np.array([0.6, -1.0, 1.5, 0.4, 0.9, 0.5])))
    usual = _task(Move((pose,)))
    far = _task(Move((pose,)), costs=GoalCosts(motion_time=0.01, joint_limits=5.0, clearance=0.0))
    one, other = usual.stages[0].configuration, far.stages[0].configuration
    assert one is not None
    assert other is not None
    assert one.branch is not None
    assert set(one.costs) == {
        "motion_time", "joint_limits", "manipulability", "clearance", "turns",
    }  # fmt: skip
    assert (one.cheaper, one.reason.split(" of ")[0]) == (0, "It costs the least")
    assert other.limit_share >= one.limit_share
    assert usual.duration <= far.duration + 1e-9
    end = usual.stages[0].trajectory.end
    assert one.limit_share == pytest.approx(limit_shares(robot.chain, end[None])[0])


def test_a_visit_says_why_it_is_not_elsewhere() -> None:
    robot = builtin("ur5e")
    random = np.random.default_rng(4)
    poses = [
        PoseGoal(forward(robot.chain, q))
        for q in random.uniform(-1.5, 1.5, (4, 6)) * np.array([1, 0.5, 1, 1, 1, 1])
        + np.array([0.0, -1.2, 1.2, -1.5, -1.5, 0.0])
    ]
    goals = tuple(TourGoal(str(k), (pose,)) for k, pose in enumerate(poses))
    planning = Options(timeout=20.0, clearance=PreferredClearance(0.0))
    problem = TourProblem(robot, Scene(()), goals, np.array([0.0, -1.2, 1.2, -1.5, -1.5, 0.0]))
    tour = plan_tour(problem, TourOptions(planning, allow_partial=True))
    assert isinstance(tour, Tour)
    for visit in tour.visits:
        chosen = visit.configuration
        assert chosen is not None
        assert chosen.found >= 1
        assert chosen.reason
        assert chosen.limit_share == pytest.approx(limit_shares(robot.chain, visit.joints[None])[0])
    assert tour.search.improvements[-1].time == pytest.approx(tour.time, abs=1e-6)


def test_stages_settings_are_those_of_the_stage() -> None:
    _, q, inside = _at_limit_and_beside()
    chain = builtin("kr6_sixx").chain
    slow = StageSettings(options=Options(limits={"velocity": 0.5 * chain.limits.velocity}))
    answer = _task(Move((PoseGoal(forward(chain, q)),), settings=slow))
    chosen = answer.stages[0].configuration
    assert chosen is not None
    assert inside[5] < q[5]
    assert chosen.costs["motion_time"] <= answer.stages[0].trajectory.duration + 1e-6
