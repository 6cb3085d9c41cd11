"""A task in which the fingers move: where they stand in each stage, what they keep clear of."""

from dataclasses import replace
from functools import cache

import fcl
import numpy as np
import pytest

import armwright as aw
from kinematics.errors import InvalidOption
from kinematics.forward import forward
from obstacles.robots.attachment import Attachment
from obstacles.robots.finger_geometry import with_fingers
from planning.sequence.result import SequencePlan, TaskOptions
from planning.sequence.search import plan_task
from planning.sequence.stage import Attach, Grasp, Gripper, Stage, Wait
from planning.sequence.task import Task
from planning.sequence.world import Held, World
from tests.planning.sequence import crate, fingers

TIME = TaskOptions(30.0)
_POST = (0.08, 0.03, 0.05)
_TOUCHES = ("panda_hand", "claw_left_plate", "claw_right_plate")
#: The plates close to 5 mm less than the crate is wide on either side [m].
_DEPTH = 0.02


def _posts() -> list[aw.Obstacle]:
    """Posts on both sides of the crate along y, with room for no plate between."""
    x, y = crate.PICK
    return [
        aw.Obstacle(name, aw.Box(_POST), aw.pose([x, y + side * 0.06, 0.13]))
        for name, side in (("left post", 1.0), ("right post", -1.0))
    ]


def _stages(grips: int = 18) -> tuple[Stage, ...]:
    stages = list(crate.stages(crate.grasps(grips)))
    stages[2] = replace(_grasp(stages[2]), touches=_TOUCHES, touch_depth=_DEPTH)
    return (Gripper("open"), *stages)


def _grasp(stage: Stage) -> Grasp:
    assert isinstance(stage, Grasp)
    return stage


@cache
def _plan() -> SequencePlan:
    task = Task(World(fingers.robot(), crate.scene(*_posts())), crate.HOME, _stages())
    return crate.planned_task(task, TIME)


def test_fingers_stand_where_the_stages_say_and_their_motion_is_told() -> None:
    stands = [stage.after.robot.fingers.positions[fingers.LEADER] for stage in _plan().stages]
    assert stands == [0.055] * 4 + [0.025] * 6 + [0.055] * 4
    moved = {stage.index: stage.fingers for stage in _plan().stages if stage.fingers is not None}
    assert set(moved) == {0, 4, 10}
    for index, (first, last) in {0: (0.0, 0.055), 4: (0.055, 0.025), 10: (0.025, 0.055)}.items():
        motion = moved[index].trajectory
        assert motion.joint_names == (fingers.LEADER, fingers.MIMIC_JOINT)
        np.testing.assert_allclose(motion.start, first)
        np.testing.assert_allclose(motion.end, last, atol=1e-15)
        assert motion.duration == _plan().stages[index].trajectory.duration
    # 1.875 * 0.055 / 0.2: longer than half a second.
    assert _plan().stages[0].trajectory.duration == pytest.approx(0.515625)
    assert all(stage.certificate.verified for stage in _plan().stages)


def test_fcl_finds_the_plates_clear_of_the_posts_all_along() -> None:
    chain, posts = fingers.robot().chain, _posts()
    solids = [
        fcl.CollisionObject(fcl.Box(*_POST), fcl.Transform(p.T_world_obstacle[:3, 3]))
        for p in posts
    ]
    plate = fcl.Box(0.02, 0.01, 0.04)
    at = 0.0
    for stage in _plan().stages:
        times = np.linspace(0.0, stage.trajectory.duration, 40)
        motion = None if stage.fingers is None else stage.fingers.trajectory
        for time, q in zip(times, stage.trajectory.sample(times), strict=True):
            at = at if motion is None else float(motion.sample([time])[0, 0])
            T_hand = forward(chain, q, "panda_hand")
            for side in (1.0, -1.0):
                T = T_hand @ aw.pose([0.0, side * at, 0.1134])
                solid = fcl.CollisionObject(plate, fcl.Transform(T[:3, :3], T[:3, 3]))
                assert min(fcl.distance(solid, post) for post in solids) > 0.0


def test_a_grasp_is_taken_where_the_open_plates_have_room() -> None:
    taken = _plan().stages[3]
    assert taken.kind == "grasp"
    across = forward(fingers.robot().chain, taken.trajectory.end)[:3, 1]
    assert abs(across[0]) > abs(across[1])
    # Only plates along y: the open gripper meets the posts, whatever else is tried.
    turned = crate.grasps(4)
    along = [T for T in turned if abs(T[1, 1]) > 0.9]
    stages = list(_stages())
    stages[3] = replace(_grasp(stages[3]), frames=np.array(along))
    blocked = crate.task_failure(
        Task(World(fingers.robot(), crate.scene(*_posts())), crate.HOME, tuple(stages)), TIME
    )
    assert "post" in blocked.message
    assert "claw" in blocked.message


def test_a_gripper_that_meets_something_while_it_opens_fails_with_the_stage_and_the_pair() -> None:
    T = forward(fingers.robot().chain, crate.HOME, "panda_hand") @ aw.pose([0.0, 0.05, 0.125])
    bar = aw.Obstacle("bar", aw.Box((0.01, 0.01, 0.01)), T)
    task = Task(World(fingers.robot(), aw.Scene([bar])), crate.HOME, (Gripper("open"),))
    answer = crate.task_failure(task, TIME)
    assert answer.stage == 0
    assert "'claw_left_plate' and 'bar' touch while the gripper moves" in answer.message
    beside = Task(task.world, crate.HOME, (Gripper("open", {fingers.LEADER: 0.03}), Wait(0.1)))
    assert isinstance(plan_task(beside, TIME), SequencePlan)


def _refusal(stages: tuple[Stage, ...], *held: Held) -> InvalidOption:
    with pytest.raises(InvalidOption) as raised:
        Task(World(fingers.robot(), crate.scene(), held), crate.HOME, stages)
    return raised.value


@pytest.mark.parametrize(
    ("stage", "told"),
    [
        (Gripper("open", {"claw": 0.01}), "no joint of a gripper"),
        (Gripper("open", {fingers.LEADER: 0.1}), "outside its limits"),
        (Gripper("open", duration=0.1), "can't get there in 0.1 s"),
    ],
)
def test_what_the_gripper_can_not_do_is_refused_with_the_stage(stage: Gripper, told: str) -> None:
    error = _refusal((Wait(0.1), stage))
    assert told in error.message
    assert error.message.startswith("stage 1 (open)")
    assert error.details["index"] == 1


def test_a_finger_that_moves_holds_nothing() -> None:
    stages = (Attach("crate", "claw_left_plate"), Gripper("open"))
    assert "'claw_left_plate' is a finger that moves" in _refusal(stages).message
    thing = aw.Obstacle("thing", aw.Sphere(0.01), np.eye(4))
    held = Held(Attachment(thing, "claw_left_plate", ()))
    assert "is a finger that moves" in _refusal((Gripper("open"),), held).message


def test_a_gripper_without_joints_takes_its_time_only() -> None:
    answer = crate.planned_task(Task(crate.world(), crate.HOME, (Gripper("close"),)), TIME)
    assert answer.stages[0].fingers is None
    assert answer.stages[0].trajectory.duration == 0.5
    opened = with_fingers(fingers.robot(), {fingers.LEADER: 0.055})
    again = crate.planned_task(
        Task(World(opened, crate.scene()), crate.HOME, (Gripper("open"),)), TIME
    )
    assert again.stages[0].fingers is None
