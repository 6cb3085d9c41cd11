"""The world between stages, and contradictions among stages."""

from typing import Any

import numpy as np
import pytest

import armwright as aw
from kinematics.errors import (
    ArmwrightError,
    InvalidLinkName,
    InvalidObjectName,
    InvalidOption,
    InvalidRobotState,
)
from kinematics.forward import forward
from planning.options import Options
from planning.problem import JointGoal
from planning.sequence.stage import (
    Attach,
    Detach,
    Grasp,
    Move,
    Place,
    Stage,
    StageSettings,
    Straight,
    Wait,
)
from planning.sequence.task import Task
from planning.sequence.world import Cells, Contact, World
from planning.timing.options import TimingOptions
from tests.planning.sequence import crate

_Q = np.array([-0.4, 0.2, 0.1, -2.1, 0.1, 2.3, 0.5])
_GRIP = crate.grasps(4)[1]
TOUCHING = {("crate", "panda_hand"): aw.AllowedContact("touch_links", 0.001)}


def _grasped() -> World:
    return crate.world().after_grasp(Contact("crate", _GRIP, ("table",)), TOUCHING)


def _held() -> World:
    return _grasped().after_attach("crate", None, (("wall",), 0.002), None, _Q)


def test_a_grasp_lets_its_links_touch_until_a_free_motion() -> None:
    world = _grasped()
    assert world.touching == TOUCHING
    assert world.after_motion(free=False).touching == world.touching
    left = world.after_motion(free=True)
    assert (left.touching, left.grasped) == ({}, None)
    assert world.key != crate.world().key


def test_an_attached_object_leaves_the_scene_and_takes_its_contacts_along() -> None:
    world = _held()
    assert "crate" not in world.scene.ids
    item = world.holds("crate")
    assert item.attachment.link == "panda_hand_tcp"
    assert set(item.attachment.touches) == {"panda_hand", "wall"}
    # Of the grasp's depth and its own the larger one holds.
    assert item.attachment.touch_depth == 0.002
    assert world.supported == {("crate", "table"): aw.AllowedContact("support", 0.001)}
    assert (world.touching, world.grasped) == ({}, None)
    # At the grasp it is held as that says, exactly, not as the configuration rounds it.
    np.testing.assert_allclose(world.T_tool_object("crate") @ _GRIP, np.eye(4), atol=1e-15)
    moved = world.after_motion(free=False)
    assert moved.supported == {}
    assert moved.holds("crate") is item


def test_without_a_grasp_an_object_is_held_where_it_stands() -> None:
    world = crate.world().after_attach("crate", "panda_link7", ((), 0.001), None, _Q)
    held = world.holds("crate").attachment.held.T_world_obstacle
    stands = forward(crate.panda().chain, _Q, "panda_link7") @ held
    expected = crate.scene().obstacle("crate").T_world_obstacle
    np.testing.assert_allclose(stands, expected, atol=1e-12)
    assert world.supported == {}


def test_a_detached_object_stands_at_its_place_or_where_the_tool_is() -> None:
    carried = _held().after_motion(free=True)
    placed = carried.after_place(Contact("crate", crate.places()[3], ("table",), 0.004))
    assert placed.supported == {("crate", "table"): aw.AllowedContact("support", 0.004)}
    down = placed.after_detach("crate", (("panda_link7",), 0.003), _Q)
    stands = down.scene.obstacle("crate").T_world_obstacle
    np.testing.assert_allclose(stands, crate.places()[3], atol=1e-15)
    assert down.touching == {
        ("crate", "panda_hand"): aw.AllowedContact("touch_links", 0.002),
        ("crate", "panda_link7"): aw.AllowedContact("touch_links", 0.003),
    }
    assert (down.held, down.supported, down.placed) == ((), {}, None)
    dropped = (
        carried.after_detach("crate", ((), 0.001), _Q).scene.obstacle("crate").T_world_obstacle
    )
    tool = forward(crate.panda().chain, _Q)
    np.testing.assert_allclose(dropped, tool @ np.linalg.inv(_GRIP), atol=1e-12)


def test_a_load_is_carried_by_the_robot_of_the_cell() -> None:
    load = aw.Load(0.5, (0.0, 0.0, 0.02))
    world = _grasped().after_attach("crate", None, ((), 0.001), load, _Q)
    masses = [
        sum(link.inertia.mass for link in cell.robot.chain.links if link.inertia is not None)
        for cell in (Cells().cell(world), Cells().cell(_held()))
    ]
    np.testing.assert_allclose(masses[0] - masses[1], 0.5, atol=1e-12)


GRIPS, POSES = crate.grasps(2), crate.places(2)
GO_HOME = Move((JointGoal(crate.HOME),))
SLOW = TimingOptions(velocity_scaling=0.5)
APPROACH = Straight("approach", [0, 0, 1], "tool", 0.05, 0.1)


def _via(blend: float | None, **options: Any) -> Move:
    settings = StageSettings(options=Options(**options))
    return Move((JointGoal(crate.HOME + 0.1),), settings=settings, blend=blend)


@pytest.mark.parametrize(
    ("stages", "index", "message", "hint"),
    [
        ((Detach("crate"),), 0, "needs 'crate' to be held", "grasp and attach"),
        ((Detach(),), 0, "names no object, and nothing is held", "grasp and attach"),
        ((GO_HOME, Place("crate", POSES)), 1, "needs 'crate' to be held", "grasp and attach"),
        ((Attach("crate"), Attach("crate")), 1, "which is held by then", "detach"),
        ((Attach("crate"), Grasp("crate", GRIPS)), 1, "which is held by then", "detach"),
        ((Attach("crate"), Place(None, POSES, support="crate")), 1, "on itself", "another object"),
        ((Move(),), 0, "has no goal", "Give it a goal"),
        ((Move(), APPROACH), 1, "leads to nothing", "right after it"),
        ((APPROACH, Grasp("crate", GRIPS)), 0, "begins away", '"kind": "move"'),
        ((GO_HOME, Move(to_end_of=1)), 1, "refers to stage 1", "earlier"),
        (
            (Wait(1.0, StageSettings("a")), Wait(1.0, StageSettings("a"))),
            1,
            "has the name of stage 0",
            "own",
        ),
        ((Attach("crate", "panda_link0"),), 0, "does not move with the tip", "panda_hand_tcp"),
        ((), None, "there are no stages", "Give one"),
        ((_via(0.1),), 0, "no free motion follows", "stage move right after"),
        ((_via(0.1), Wait(1.0), GO_HOME), 0, "no free motion follows", "Leave blend out"),
        ((_via(-0.1), GO_HOME), 0, "a blend of -0.1", "positive"),
        ((_via(np.nan), GO_HOME), 0, "a blend of nan", "positive"),
        ((Move(blend=0.1), APPROACH, Grasp("crate", GRIPS)), 0, "an approach begins", "own"),
        ((GO_HOME, _via(0.1, timing=SLOW), GO_HOME), 1, "other timing or limits", "the same"),
        ((_via(0.1, limits={"velocity": np.ones(7)}), GO_HOME), 0, "other timing", "the same"),
        (
            (_via(0.1, timing=TimingOptions("spline")), GO_HOME),
            0,
            "follow its path",
            "timing.method",
        ),
        ((_via(0.1), _via(None, planner="optimize")), 0, "follow its path", "planner"),
    ],
)
def test_contradictions_name_the_stage_and_the_cure(
    stages: tuple[Stage, ...], index: int | None, message: str, hint: str
) -> None:
    with pytest.raises(InvalidOption) as error:
        Task(crate.world(), crate.HOME, stages)
    assert message in error.value.message
    assert hint in (error.value.hint or "")
    assert error.value.details.get("index") == index


@pytest.mark.parametrize(
    ("stage", "error"),
    [
        (Grasp("box", GRIPS), InvalidObjectName),
        (Grasp("crate", GRIPS, support="floor"), InvalidObjectName),
        (Grasp("crate", GRIPS, ("claw",)), InvalidLinkName),
        (Attach("crate", "claw"), InvalidLinkName),
        (Attach("crate", touches=("claw",)), InvalidObjectName),
        (Wait(1.0, StageSettings(allowed=(("crate", "floor"),))), InvalidObjectName),
    ],
)
def test_unknown_names_are_told_with_those_there_are(
    stage: Stage, error: type[ArmwrightError]
) -> None:
    with pytest.raises(error) as told:
        Task(crate.world(), crate.HOME, (stage,))
    assert "stage 0" in told.value.message
    assert "crate" in (told.value.hint or "") or "panda_hand" in (told.value.hint or "")


def test_names_of_held_objects_are_put_in() -> None:
    task = Task(crate.world(), crate.HOME, crate.stages())
    place, detach = task.stages[8], task.stages[10]
    assert isinstance(place, Place)
    assert isinstance(detach, Detach)
    assert place.object == detach.object == "crate"


@pytest.mark.parametrize("count", [0, 10_001])
def test_a_list_has_one_to_ten_thousand_entries(count: int) -> None:
    with pytest.raises(InvalidOption, match=f"there are {count} grasps"):
        Grasp("crate", np.tile(np.eye(4), (count, 1, 1)))


def test_a_straight_motion_has_a_direction_and_a_length() -> None:
    with pytest.raises(InvalidOption, match="no length"):
        Straight("lift", [0, 0, 0], "root", 0.1, 0.2)
    for least, most in ((0.0, 0.1), (0.2, 0.1)):
        with pytest.raises(InvalidOption, match="distance"):
            Straight("lift", [0, 0, 1], "root", least, most)


def test_the_start_must_fit() -> None:
    with pytest.raises(InvalidRobotState):
        Task(crate.world(), crate.HOME[:3], (GO_HOME,))
