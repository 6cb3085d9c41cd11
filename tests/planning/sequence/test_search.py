"""The whole task: joined, proved, what is held after each stage; joints that a task gives."""

import time

import fcl
import numpy as np
import pytest

import armwright as aw
from kinematics.forward import forward
from obstacles.collision.checker import Checker
from planning.options import Options
from planning.problem import JointGoal, PoseGoal
from planning.sequence.result import SequenceFailure, TaskOptions
from planning.sequence.stage import Detach, Grasp, Gripper, Move, StageSettings, Straight, Wait
from planning.sequence.step import scaled_limits
from planning.sequence.task import Task
from planning.sequence.world import World
from planning.timing.rest_to_rest import motion_times
from tests.planning.scenes import builtin
from tests.planning.sequence import crate

TIME = TaskOptions(30.0)


def test_every_stage_is_proved_and_joins_the_next_at_rest() -> None:
    plan = crate.plan()
    assert [stage.index for stage in plan.stages] == list(range(13))
    np.testing.assert_allclose(plan.stages[0].trajectory.start, crate.HOME, atol=1e-12)
    np.testing.assert_allclose(plan.stages[-1].trajectory.end, crate.HOME, atol=1e-12)
    for stage in plan.stages:
        motion = stage.trajectory
        assert stage.certificate.verified
        ends = motion.sample([0.0, motion.duration], 1)
        np.testing.assert_allclose(ends, 0.0, atol=1e-9)
    for before, after in zip(plan.stages, plan.stages[1:], strict=False):
        np.testing.assert_allclose(before.trajectory.end, after.trajectory.start, atol=1e-12)
    assert plan.duration == pytest.approx(sum(s.trajectory.duration for s in plan.stages))


def test_the_crate_is_held_from_attach_to_detach_and_ends_at_the_place_chosen() -> None:
    plan = crate.plan()
    held = [[item.name for item in stage.after.held] for stage in plan.stages]
    assert held == [[]] * 4 + [["crate"]] * 6 + [[]] * 3
    assert all("crate" in stage.after.scene.ids for stage in plan.stages[:4])
    chosen = plan.stages[8].target
    assert chosen is not None
    T = plan.stages[-1].after.scene.obstacle("crate").T_world_obstacle
    np.testing.assert_allclose(T, crate.places()[chosen], atol=1e-12)


def test_the_tool_is_at_the_grasp_chosen_and_keeps_the_crate() -> None:
    plan = crate.plan()
    chosen = plan.stages[2].target
    assert chosen is not None
    chain = crate.panda().chain
    stands = crate.scene().obstacle("crate").T_world_obstacle
    tool = forward(chain, plan.stages[2].trajectory.end)
    np.testing.assert_allclose(tool, stands @ crate.grasps()[chosen], atol=1e-6)
    # Held without slip: T_tool_object is the inverse of the grasp all along.
    for stage in plan.stages[5:9]:
        carried = forward(chain, stage.trajectory.end) @ np.linalg.inv(crate.grasps()[chosen])
        attached = stage.after.held[0].attachment
        by_link = forward(chain, stage.trajectory.end, attached.link)
        np.testing.assert_allclose(carried, by_link @ attached.held.T_world_obstacle, atol=1e-9)


def test_fcl_finds_the_held_crate_clear_of_the_wall_and_of_the_table_but_where_it_stands() -> None:
    plan = crate.plan()
    chain, grip = crate.panda().chain, crate.grasps()[plan.stages[2].target or 0]
    box = fcl.Box(0.05, 0.05, 0.1)
    others = {"wall": ((0.4, 0.03, 0.15), (0.6, 0.0, 0.175)),
              "table": ((0.6, 1.0, 0.04), (0.6, 0.0, 0.08))}  # fmt: skip
    for stage in plan.stages[5:9]:
        times = np.linspace(0.0, stage.trajectory.duration, 50)
        for name, (size, at) in others.items():
            # The table holds it up where it is taken and where it is put.
            touches = ("crate", name) in stage.allowed
            assert touches == (name == "table" and stage.index != 6)
            solid = fcl.CollisionObject(fcl.Box(*size), fcl.Transform(np.array(at)))
            for q in stage.trajectory.sample(times):
                T = forward(chain, q) @ np.linalg.inv(grip)
                held = fcl.CollisionObject(box, fcl.Transform(T[:3, :3], T[:3, 3]))
                distance = fcl.distance(held, solid, fcl.DistanceRequest(), fcl.DistanceResult())
                assert distance > 0.0 or touches


def test_straight_stages_are_straight_and_as_long_as_asked() -> None:
    plan = crate.plan()
    chain = crate.panda().chain
    for k, along in ((1, None), (5, [0, 0, 1]), (7, [0, 0, -1])):
        stage = plan.stages[k]
        assert stage.certificate.path_deviation is not None
        assert stage.certificate.path_deviation.position <= 1e-4
        first, last = (forward(chain, q) for q in (stage.trajectory.start, stage.trajectory.end))
        way = last[:3, 3] - first[:3, 3]
        assert 0.05 - 1e-4 <= np.linalg.norm(way) <= 0.15 + 1e-4
        direction = first[:3, 2] if along is None else np.array(along)
        np.testing.assert_allclose(way / np.linalg.norm(way), direction, atol=1e-3)


def test_a_place_that_is_blocked_is_told_before_any_path_is_planned() -> None:
    lid = aw.Obstacle("lid", aw.Box((0.3, 0.3, 0.02)), aw.pose([*crate.PLACE, 0.2]))
    answer = crate.task_failure(Task(crate.world(lid), crate.HOME, crate.stages()), TIME)
    assert (answer.code, answer.stage) == ("PLANNING_FAILED", 8)
    assert not answer.prefix
    assert "lid" in answer.details["pair"]
    reasons = {reason for trial in answer.trials for reason in trial.reasons}
    assert any("lid" in reason for reason in reasons)
    places = [trial for trial in answer.trials if trial.stage == 8]
    assert places
    assert all(trial.outcome in ("in_collision", "outside_limits", "out_of_reach", "failed")
               for trial in places)  # fmt: skip


@pytest.mark.parametrize("overlap", [0.0005, 0.005, 0.02])
def test_a_place_beside_a_neighbour_is_told_by_the_pair_and_how_deep(overlap: float) -> None:
    # Two upright boxes 5 cm wide whose faces overlap: as deep as one of them is in the other.
    x, y = crate.PLACE
    beside = aw.pose([x + 0.05 - overlap, y, 0.13])
    neighbour = aw.Obstacle("neighbour", aw.Box((0.05, 0.05, 0.06)), beside)
    place = aw.pose([x, y, 0.15])[None]
    task = Task(crate.world(neighbour), crate.HOME, crate.stages(poses=place))
    answer = crate.task_failure(task, TIME)
    assert (answer.code, answer.stage) == ("PLANNING_FAILED", 8)
    assert set(answer.details["pair"]) == {"crate", "neighbour"}
    assert answer.details["depth"] == pytest.approx(overlap, abs=1e-6)
    assert "crate and neighbour" in answer.message or "neighbour and crate" in answer.message
    assert f"{overlap:.4g} m" in answer.message


def test_grasps_that_do_not_serve_are_left_for_one_that_does() -> None:
    # From below, from far away, and from above: only the last can be done.
    below = aw.pose([0.0, 0.0, -0.04])
    far = aw.pose([0.0, 0.0, 2.0])
    grips = np.array([below, far, crate.grasps()[3]])
    answer = crate.planned_task(Task(crate.world(), crate.HOME, crate.stages(grips)), TIME)
    assert answer.stages[2].target == 2
    outcomes = {t.choices[0]: t.outcome for t in answer.trials if t.stage == 2}
    assert outcomes == {0: "in_collision", 1: "out_of_reach", 2: "solved"}


def test_the_scene_after_a_task_begins_the_next_one() -> None:
    plan = crate.plan()
    back = crate.scene().obstacle("crate").T_world_obstacle[None]
    after = plan.stages[-1].after
    answer = crate.planned_task(Task(after, crate.HOME, crate.stages(poses=back)), TIME)
    T = answer.stages[-1].after.scene.obstacle("crate").T_world_obstacle
    np.testing.assert_allclose(T, back[0], atol=1e-12)


def test_a_move_goes_back_to_the_end_of_an_earlier_stage() -> None:
    goal = np.array([0.3, -0.5, 0.0, -2.0, 0.0, 1.6, 0.8])
    above = PoseGoal(aw.pose([0.5, 0.2, 0.5]) @ crate.DOWN)
    there = Move((JointGoal(goal),), settings=StageSettings("there"))
    tasks = (there, Wait(0.25), Move((above,)), Move(to_end_of=0))
    answer = crate.planned_task(Task(crate.world(), crate.HOME, tasks), TIME)
    np.testing.assert_allclose(answer.stages[3].trajectory.end, goal, atol=1e-12)
    assert answer.stages[1].trajectory.duration == 0.25


def test_an_object_that_is_left_in_the_air_stands_where_it_was_let_go() -> None:
    above = (*crate.stages()[:6], Detach(), Gripper("open"))
    answer = crate.planned_task(Task(crate.world(), crate.HOME, above), TIME)
    lifted = answer.stages[-1].after.scene.obstacle("crate").T_world_obstacle
    way = answer.stages[5].plan
    assert way is not None
    assert lifted[2, 3] == pytest.approx(0.15 + way.tool_motions[0].length, abs=1e-4)


def test_what_touches_must_be_allowed() -> None:
    # The crate stands on the table: without support its attachment is refused, with the pair.
    bare = [*crate.stages()]
    bare[2] = Grasp("crate", crate.grasps(2), ("panda_hand",))
    answer = crate.task_failure(Task(crate.world(), crate.HOME, tuple(bare)), TaskOptions(5.0))
    assert "table" in answer.message
    assert "crate" in answer.message
    assert "support" in answer.hint


def test_first_stages_are_an_answer_only_where_that_is_asked_for() -> None:
    first = crate.stages(crate.grasps(2))[:5]
    stages = (*first, Straight("lift", [0, 0, 1], "root", 2.0, 2.0))
    task = Task(crate.world(), crate.HOME, stages)
    refused = crate.task_failure(task, TIME)
    assert (refused.code, refused.stage) == ("PLANNING_FAILED", 5)
    partial = crate.planned_task(task, TaskOptions(30.0, allow_partial=True))
    assert not partial.complete
    assert partial.failure is not None
    assert partial.failure.stage == 5
    assert [stage.index for stage in partial.stages] == [0, 1, 2, 3, 4]
    assert all(stage.certificate.verified for stage in partial.stages)


def test_time_that_is_up_is_told() -> None:
    answer = crate.task_failure(Task(crate.world(), crate.HOME, crate.stages()), TaskOptions(1e-4))
    assert answer.code == "TIMED_OUT"


def test_ten_thousand_grasps_keep_the_deadline() -> None:
    many = np.tile(crate.grasps(), (556, 1, 1))[:10_000].copy()
    many[:, 2, 3] += 3.0
    answer = crate.task_failure(
        Task(crate.world(), crate.HOME, crate.stages(many)), TaskOptions(1.0)
    )
    assert len(answer.trials) <= 10_000


def test_a_shorter_answer_replaces_the_first() -> None:
    task = Task(crate.world(), crate.HOME, crate.stages())
    answer = crate.planned_task(task, TaskOptions(30.0, improve=0.5))
    durations = [step.duration for step in answer.improvements]
    assert durations == sorted(durations, reverse=True)
    assert answer.duration == durations[-1] <= crate.plan().duration


def test_raised_limits_of_a_stage_raise_what_counts_as_its_least_time() -> None:
    limits = {name: 4.0 * getattr(crate.panda().chain.limits, name)
              for name in ("velocity", "acceleration", "jerk")}  # fmt: skip
    quick = StageSettings(options=Options(limits=limits))
    goals = tuple(JointGoal(crate.HOME + np.array([turn, 0, 0, 0, 0, 0, 0])) for turn in (0.9, 0.5))
    task = Task(crate.world(), crate.HOME, (Move(goals, settings=quick), Wait(0.1)))
    answer = crate.planned_task(task, TaskOptions(30.0, improve=1.0))
    assert answer.exhausted
    assert answer.stages[0].target == 1
    chain, end = crate.panda().chain, goals[1].joints[None]
    (least,) = motion_times(chain, crate.HOME, end, scaled_limits(chain, quick.options))
    (slowly,) = motion_times(chain, crate.HOME, end)
    assert least <= answer.stages[0].trajectory.duration < slowly


ARMS = ["panda", "ur5e", "iiwa14", "kr6_sixx"]


def colliding_joints(name: str, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Random joints of an arm that do not touch themselves, and some that do."""
    random, checker = np.random.default_rng(seed), Checker.of(builtin(name), aw.Scene())
    low, high = builtin(name).chain.sampling_bounds()
    drawn = random.uniform(low, high, (4000, len(low)))
    valid = checker.each_valid(drawn)
    return drawn[valid][0], drawn[~valid][0]


def refused(task: Task) -> SequenceFailure:
    began = time.monotonic()
    answer = crate.task_failure(task, TaskOptions(30.0))
    assert time.monotonic() - began < 0.5 * 30.0
    return answer


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("name", ARMS)
def test_a_start_or_a_last_move_that_touches_is_told_before_any_search(
    name: str, seed: int
) -> None:
    free, touching = colliding_joints(name, seed)
    world = World(builtin(name), aw.Scene())
    there = Move((JointGoal(free),))
    for start, goal, code, index in (
        (touching, free, "START_STATE_IN_COLLISION", 0),
        (free, touching, "GOAL_IN_COLLISION", 1),
    ):
        answer = refused(Task(world, start, (there, Move((JointGoal(goal),)))))
        assert (answer.code, answer.stage, answer.details["index"]) == (code, index, index)
        assert len(answer.details["pair"]) == 2
        assert answer.details["depth"] > 0.0
        assert f"stage {index} (move)" in answer.message


def test_what_is_carried_away_is_not_in_the_way_of_a_later_goal() -> None:
    # The last move of the task ends where the crate stood.
    plan = crate.plan()
    at_pick = plan.stages[2].trajectory.end
    stages = (*crate.stages()[:-1], Move((JointGoal(at_pick),)))
    crate.planned_task(Task(crate.world(), crate.HOME, stages), TaskOptions(30.0))


def test_the_free_motion_that_no_alternative_passes_is_blamed() -> None:
    # Of two goals the one is stretched out, so that the tool can't rise from it, and no straight
    # motion leads to the other: a ball is in between. The first stage is what cuts both off.
    turned, stretched = np.array(crate.HOME), np.array([0.0, 0.0, 0.0, -0.1, 0.0, 1.6, 0.8])
    turned[0] = 1.4
    middle = np.array(crate.HOME)
    middle[0] = 0.7
    ball = aw.Obstacle(
        "ball", aw.Sphere(0.05), aw.pose(forward(builtin("panda").chain, middle)[:3, 3])
    )
    settings = StageSettings(options=Options(planner="straight_line", timeout=5.0))
    stages = (
        Move((JointGoal(turned), JointGoal(stretched)), settings=settings),
        Straight("lift", [0, 0, 1], "root", 0.1, 0.1),
    )
    answer = refused(Task(World(builtin("panda"), aw.Scene([ball])), crate.HOME, stages))
    assert (answer.code, answer.stage) == ("PLANNING_FAILED", 0)
    assert "ball" in answer.message or "no path" in answer.message
