"""Fingers of a gripper: how they move, and where they touch."""

from dataclasses import replace
from functools import cache

import coal
import fcl
import numpy as np
import pytest

import armwright as aw
from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.forward import forward
from kinematics.pose import from_rpy, inverse, rotation_z, transform
from obstacles.robots.attachment import Attachment
from obstacles.robots.finger_geometry import with_fingers
from planning.sequence.result import SequencePlan, TaskOptions
from planning.sequence.search import plan_task
from planning.sequence.stage import Attach, Grasp, Gripper, Stage, Wait
from planning.sequence.task import Task
from planning.sequence.world import Held, World, contact_positions
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


ROBOT = aw.load_robot("ur5e")
JAW = aw.mount(ROBOT, aw.built_in_tool("parallel_jaw", "jaw"))
CLOSED = (("jaw/opening", 0.0),)
Z = np.array([0.0, 0.0, 1.0])
HOME = np.array([0.0, -1.4, 1.5, -1.67, -1.57, 0.0])


def contact(robot: aw.RobotGeometry, part: aw.Obstacle, T_tool_part: Array) -> float | str:
    """The opening at which the jaws touch a part, or why they do not."""
    T = np.ascontiguousarray(inverse(T_tool_part)).tobytes()
    found = contact_positions(robot, part, T, CLOSED)
    return found if isinstance(found, str) else found["jaw/opening"]


@pytest.mark.parametrize("radius", [0.004, 0.015, 0.04])
def test_a_cylinder_is_held_by_its_diameter(radius: float) -> None:
    part = aw.Obstacle("part", aw.Cylinder(radius, 0.1))
    assert contact(JAW, part, np.eye(4)) == pytest.approx(2.0 * radius, abs=1e-5)


def test_turned_boxes_are_held_where_coal_has_them_touch() -> None:
    random, held = np.random.default_rng(38), 0
    jaw = coal.Box(0.01, 0.022, 0.05)
    for _ in range(60):
        size = random.uniform(0.01, 0.07, 3)
        T = transform(rotation_z(random.uniform(-np.pi, np.pi)), [0.0, 0.0, 0.01])
        found = contact(JAW, aw.Obstacle("part", aw.Box(size)), T)
        if isinstance(found, str):
            continue
        held += 1
        gaps = []
        for side in (1.0, -1.0):
            # The jaws end at the tip, half of a length of 0.05 m before it is their middle.
            at = coal.Transform3s(np.eye(3), np.array([side * (0.5 * found + 0.005), 0.0, -0.025]))
            place = coal.Transform3s(T[:3, :3], T[:3, 3])
            box, asked = coal.Box(*size), coal.DistanceRequest()
            gaps.append(coal.distance(jaw, at, box, place, asked, coal.DistanceResult()))
        assert min(gaps) == pytest.approx(0.0, abs=1e-5)
        assert max(gaps) < 1e-3
    assert held > 30


@pytest.mark.parametrize(
    ("size", "at", "told"),
    [
        ((0.02, 0.02, 0.02), [0.01, 0.0, 0.0], "the grasp is not in its middle"),
        ((0.02, 0.02, 0.02), [0.0, 0.1, 0.0], "close without touching 'part'"),
        ((0.09, 0.02, 0.02), [0.0, 0.0, 0.0], "touch 'part' before they close"),
    ],
)
def test_what_is_not_held_says_why(size: tuple[float, ...], at: list[float], told: str) -> None:
    found = contact(JAW, aw.Obstacle("part", aw.Box(size)), transform(None, at))
    assert isinstance(found, str)
    assert told in found


def stages(grasps: Array, *, until: bool = True) -> tuple[Stage, ...]:
    return (
        aw.Move(), aw.Straight("approach", Z, "tool", 0.04, 0.08),
        aw.Grasp("crate", grasps, ("jaw",), ("table",)),
        aw.Gripper("close", until="contact" if until else None),
        aw.Attach("crate"), aw.Straight("lift", Z, "root", 0.05, 0.1),
    )  # fmt: skip


def world() -> aw.World:
    table = aw.Obstacle("table", aw.Box((0.8, 1.2, 0.04)), aw.pose([-0.6, 0.0, -0.02]))
    crate = aw.Obstacle("crate", aw.Box((0.03, 0.06, 0.08)), aw.pose([-0.5, 0.1, 0.04]))
    return aw.World(JAW, aw.Scene([table, crate]))


@pytest.mark.parametrize(("yaw", "width"), [(0.0, 0.03), (0.5 * np.pi, 0.06)])
def test_a_task_closes_as_far_as_its_grasp_needs(yaw: float, width: float) -> None:
    T = transform(from_rpy([np.pi, 0.0, yaw]), [0.0, 0.0, 0.02])
    plan = aw.plan_task(aw.Task(world(), HOME, stages(T[None])), TIME)
    assert isinstance(plan, aw.SequencePlan), plan
    assert plan.complete
    closed = next(stage for stage in plan.stages if stage.kind == "close")
    assert closed.after.robot.fingers.positions["jaw/opening"] == pytest.approx(width, abs=1e-5)
    assert closed.fingers is not None
    assert closed.fingers.first["jaw/opening"] == 0.085
    for stage in plan.stages:
        assert stage.certificate.verified
        deep = [item.overlap or 0.0 for item in stage.certificate.allowed_collisions]
        assert max(deep) < 1.1e-3  # touch_depth, of the crate on the table


def test_jaws_that_close_all_the_way_stand_in_the_part_and_are_refused() -> None:
    T = transform(from_rpy([np.pi, 0.0, 0.0]), [0.0, 0.0, 0.02])
    told = aw.plan_task(aw.Task(world(), HOME, stages(T[None], until=False)), TIME)
    assert isinstance(told, aw.SequenceFailure)
    assert "touch_depth" in told.message


def test_an_off_centre_grasp_is_left_for_one_that_holds() -> None:
    turned = from_rpy([np.pi, 0.0, 0.0])
    grasps = np.array([transform(turned, [0.01, 0.0, 0.02]), transform(turned, [0.0, 0.0, 0.02])])
    plan = aw.plan_task(aw.Task(world(), HOME, stages(grasps)), TIME)
    assert isinstance(plan, aw.SequencePlan)
    assert [stage.target for stage in plan.stages if stage.kind == "grasp"] == [1]


def test_contact_without_a_grasp_is_refused() -> None:
    with pytest.raises(InvalidOption, match="no grasp says with what"):
        aw.Task(world(), HOME, (aw.Gripper("close", until="contact"),))
