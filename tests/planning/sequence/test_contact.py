"""Fingers that close until they touch: closed forms, coal, and a width for each grasp of a task."""

import coal
import numpy as np
import pytest

import armwright as aw
from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.pose import from_rpy, inverse, rotation_z, transform
from planning.sequence.stage import Stage
from planning.sequence.world import contact_positions
from tests.planning.sequence.test_gripper import TIME

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
