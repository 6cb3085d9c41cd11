"""Stages in which a gripper opens or closes: where its fingers go, as the model and the stages say.

Where the fingers are follows from the order of the stages alone, not from what the search chooses.
"""

from collections.abc import Sequence
from dataclasses import replace

from kinematics.errors import InvalidOption
from kinematics.tree.fingers import Fingers, Positions
from obstacles.robots.finger_geometry import moved_links, with_fingers
from obstacles.robots.robot_geometry import RobotGeometry
from planning.sequence.stage import GRIPPER_DURATION, Attach, Gripper, Stage, describe_stage
from planning.values.finger_motion import FingerMotion, least_duration

#: Names of the states that a stage means which names none, by its kind.
_STATES = {"open": ("open", "opened"), "close": ("close", "closed")}


def with_finger_motions(
    robot: RobotGeometry, stages: Sequence[Stage], holders: Sequence[str] = ()
) -> tuple[Stage, ...]:
    """The stages, those of the gripper with where its fingers go.

    Args:
        robot: The robot with its fingers where they are at first.
        stages: In order.
        holders: Links that hold something at the start.

    Raises:
        InvalidOption: A joint or a position is none of the gripper, there is too little time, or a
            link of a finger that moves holds something; the message names the stage.
    """
    done: list[Stage] = []
    for k, stage in enumerate(stages):
        if isinstance(stage, Gripper):
            try:
                new = _with_motion(robot, stage)
            except InvalidOption as error:
                where = {"index": k, "kind": stage.kind, "name": stage.settings.name or None}
                message = f"{describe_stage(stages, k)}: {error.message}"
                raise InvalidOption(message, hint=error.hint, **error.details, **where) from None
            robot = new.robot or robot
            done.append(new)
        else:
            done.append(stage)
    _check_holders(robot, done, holders)
    return tuple(done)


def _with_motion(robot: RobotGeometry, stage: Gripper) -> Gripper:
    asked = _wanted_positions(robot.fingers, stage)
    first, last = robot.fingers.positions, robot.fingers.with_positions(asked)
    least = least_duration(robot.fingers, first, last)
    duration = stage.duration
    if duration is None:
        duration = max(GRIPPER_DURATION, least)
    elif duration < least:
        raise InvalidOption(
            f"the fingers can't get there in {duration:g} s",
            hint=f"Give {least:.4g} s or more, or leave duration out.",
        )
    if first == last:
        return replace(stage, duration=duration)
    motion = FingerMotion(robot.fingers, first, last, duration)
    return replace(stage, duration=duration, motion=motion, robot=with_fingers(robot, last))


def _wanted_positions(fingers: Fingers, stage: Gripper) -> Positions:
    """Positions that a stage asks for; none where the model knows nothing of its gripper."""
    if stage.fingers is not None:
        return stage.fingers
    for name in _STATES[stage.kind]:
        for known, values in fingers.states.items():
            if name in (known, known.rpartition("/")[2]):
                return values
    return {}


def _check_holders(robot: RobotGeometry, stages: Sequence[Stage], holders: Sequence[str]) -> None:
    """No link of a finger that moves may hold anything: what it holds would move with it."""
    motions = [stage.motion for stage in stages if isinstance(stage, Gripper) and stage.motion]
    moved = moved_links(robot, frozenset[str]().union(*(motion.leaders for motion in motions)))
    for k, stage in enumerate(stages):
        if isinstance(stage, Attach) and stage.link in moved:
            raise InvalidOption(
                f"{describe_stage(stages, k)}: {stage.link!r} is a finger that moves",
                hint="Attach to the link that carries the fingers, or leave link out.",
                index=k,
                kind="attach",
                name=stage.settings.name or None,
            )
    for link in holders:
        if link in moved:
            raise InvalidOption(
                f"attached: {link!r} is a finger that moves, and holds something",
                hint="Attach to the link that carries the fingers.",
            )
