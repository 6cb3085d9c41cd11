"""Contradictions among stages, told by stage and cure."""

from typing import Any

import numpy as np
import pytest

from kinematics.errors import (
    ArmwrightError,
    InvalidLinkName,
    InvalidObjectName,
    InvalidOption,
    InvalidRobotState,
)
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
from planning.sequence.task import Task, segments
from planning.timing.options import TimingOptions
from tests.planning.sequence import crate

GRIPS, POSES = crate.grasps(2), crate.places(2)
HOME = Move((JointGoal(crate.HOME),))
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
        ((HOME, Place("crate", POSES)), 1, "needs 'crate' to be held", "grasp and attach"),
        ((Attach("crate"), Attach("crate")), 1, "which is held by then", "detach"),
        ((Attach("crate"), Grasp("crate", GRIPS)), 1, "which is held by then", "detach"),
        ((Attach("crate"), Place(None, POSES, support="crate")), 1, "on itself", "another object"),
        ((Move(),), 0, "has no goal", "Give it a goal"),
        ((Move(), APPROACH), 1, "leads to nothing", "right after it"),
        ((APPROACH, Grasp("crate", GRIPS)), 0, "begins away", '"kind": "move"'),
        ((HOME, Move(to_end_of=1)), 1, "refers to stage 1", "earlier"),
        (
            (Wait(1.0, StageSettings("a")), Wait(1.0, StageSettings("a"))),
            1,
            "has the name of stage 0",
            "own",
        ),
        ((Attach("crate", "panda_link0"),), 0, "does not move with the tip", "panda_hand_tcp"),
        ((), None, "there are no stages", "Give one"),
        ((_via(0.1),), 0, "no free motion follows", "stage move right after"),
        ((_via(0.1), Wait(1.0), HOME), 0, "no free motion follows", "Leave blend out"),
        ((_via(-0.1), HOME), 0, "a blend of -0.1", "positive"),
        ((_via(np.nan), HOME), 0, "a blend of nan", "positive"),
        ((Move(blend=0.1), APPROACH, Grasp("crate", GRIPS)), 0, "an approach begins", "own"),
        ((HOME, _via(0.1, timing=SLOW), HOME), 1, "other timing or limits", "the same"),
        ((_via(0.1, limits={"velocity": np.ones(7)}), HOME), 0, "other timing", "the same"),
        ((_via(0.1, timing=TimingOptions("spline")), HOME), 0, "follow its path", "timing.method"),
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


def test_segments_go_from_target_to_target() -> None:
    parts = segments(crate.stages())
    assert [(part.first, part.free, part.approach, part.target) for part in parts] == [
        (0, 0, 1, 2), (3, 6, 7, 8), (9, 12, None, 12)
    ]  # fmt: skip
    assert list(parts[1].forward) == [3, 4, 5]
    ending = segments((HOME, Wait(1.0)))
    assert ending[-1].target is None
    assert list(ending[-1].forward) == [1]


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
        Task(crate.world(), crate.HOME[:3], (HOME,))
