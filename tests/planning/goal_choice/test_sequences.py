"""Which configurations tasks and tours take, beside all others that are found apart.

Two of three poses are of configurations with a joint at its limit. Until tasks and tours weighed
their configurations one in ten of these answers broke the rule.
"""

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.ik.inverse import inverse_kinematics
from obstacles.scenes.scene import Scene
from planning.goal_choice.goal_order import limit_shares
from planning.options import Options
from planning.problem import JointGoal, PoseGoal
from planning.sequence.result import SequencePlan, TaskOptions
from planning.sequence.stage import Move, StageSettings, Straight
from planning.sequence.task import Task
from planning.sequence.world import World
from planning.tours.planner import plan_tour
from planning.tours.problem import TourGoal, TourOptions, TourProblem
from planning.tours.result import Tour
from planning.values.preferences import GoalCosts, PreferredClearance
from tests.planning.goal_choice_sequences import judge
from tests.planning.scenes import builtin
from tests.planning.sequence import crate

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
    tally = judge(name, kind, count, seed=0)
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
