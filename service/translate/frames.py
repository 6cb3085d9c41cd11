"""Requests whose poses are in other frames, put into the robot's root frame.

Named states of robots in requests, looked up.
"""

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from pydantic import BaseModel

from armwright_wire.goals import goal as constraints
from armwright_wire.goals.goal import Goal, SingleGoal, Start
from armwright_wire.goals.tool_motion import RoundedCorner, TimedToolMotion, TimedToolMotions
from armwright_wire.plans.plan import PlanRequest
from armwright_wire.pose import FramedPose, Pose
from armwright_wire.robots.kinematics import IkRequest
from kinematics.arrays import Array
from kinematics.errors import InvalidGoal, InvalidOption
from kinematics.model.chain import Chain
from kinematics.root_frame import check_default_frame, frame_pose
from kinematics.tree.srdf import state
from service.translate import poses

_Part = TypeVar("_Part", Start, SingleGoal)


def with_states(body: PlanRequest, states: Mapping[str, Array]) -> PlanRequest:
    """A request for a plan with the joints of the states that it names.

    Args:
        body: The request.
        states: States of the robot, by name.

    Raises:
        InvalidRobotState: The robot has no such state.
        InvalidOption: It begins on another motion, which only planning itself looks up.
    """
    _refuse_plan(body.start)
    changes: dict[str, Any] = {}
    if body.start.state is not None:
        changes["start"] = with_state(body.start, states, "start")
    goal = body.goal
    if goal.state is not None:
        changes["goal"] = with_state(goal, states, "goal")
    elif any(item.state is not None for item in goal.any_of or ()):
        items = [
            with_state(item, states, f"goal.any_of[{i}]")
            for i, item in enumerate(goal.any_of or ())
        ]
        changes["goal"] = goal.model_copy(update={"any_of": items})
    return body.model_copy(update=changes) if changes else body


def with_state(part: _Part, states: Mapping[str, Array], where: str) -> _Part:
    """A start or goal with the joints of the state that it names, if it names one.

    Args:
        part: The start or goal.
        states: States of the robot, by name.
        where: Place in the request, for messages.

    Raises:
        InvalidRobotState: The robot has no such state.
    """
    if part.state is None:
        return part
    joints = state(states, part.state, f"{where}.state").tolist()
    return part.model_copy(update={"joints": joints, "state": None})


def configuration(body: Start, chain: Chain, states: Mapping[str, Array], where: str) -> Array:
    """Configuration of a start or an end, shape (n,) [rad or m].

    Raises:
        InvalidRobotState: The robot has no such state, or the vector has the wrong length.
        InvalidOption: It is an instant of a plan.
    """
    _refuse_plan(body)
    if body.state is not None:
        return np.array(state(states, body.state, f"{where}.state"))
    return np.asarray(chain.state(body.joints or (), f"{where}.joints"))


def _refuse_plan(start: Start) -> None:
    """Refuse a start on the motion of a kept plan where nothing has looked that up."""
    if start.plan is not None:
        raise InvalidOption(
            f"an instant of plan {start.plan!r} is the start of a single new plan only",
            hint="Give joints, velocities and accelerations in its place.",
        )


#: Marks a request that names a frame somewhere: others are left alone, to the last bit.
_MARK = b'"frame"'
#: Fields that are moved with a frame: a point, or a direction, which turns only.
_POINTS = ("point", "via", "center", "target")
_DIRECTIONS = ("normal", "direction")
_MOVED = (*_POINTS, *_DIRECTIONS, "pose")

_Body = TypeVar("_Body", bound=BaseModel)


class Frames:
    """Poses of the frames that a request names, in the root frame.

    Args:
        chain: The robot.
        joints: Configuration of the frame "tool", shape (n,) [rad or m]; None where nothing names
            one.
        default: The frame of the request, for all that names none.

    Raises:
        InvalidLinkName: There is no frame of the name of the default, or it moves.
    """

    def __init__(self, chain: Chain, joints: Array | None, default: str | None) -> None:
        check_default_frame(chain, default)
        self._chain = chain
        self._joints = joints
        self._default = default

    def transform(self, frame: str | None, where: str) -> Array | None:
        """T_root_frame, shape (4, 4); None for the root frame itself.

        Raises:
            InvalidLinkName: There is no such frame, it moves, or nothing says where the tool is.
        """
        name = frame or self._default
        return None if name is None else frame_pose(self._chain, name, self._joints, where)

    def pose(self, pose: Pose, frame: str | None, where: str) -> Pose:
        """A pose in the root frame; one that names a frame itself is in that.

        Raises:
            InvalidLinkName: As for ``transform``.
            InvalidPose: The orientation is no rotation.
        """
        named = getattr(pose, "frame", None) or frame
        T = self.transform(named, f"{where}.frame")
        return pose if T is None else _moved_pose(T, pose)


def names_frame(content: bytes) -> bool:
    """Whether a request may name a frame."""
    return _MARK in content


def plan_in_root_frame(body: PlanRequest, chain: Chain) -> PlanRequest:
    """A request for a plan with all that it names in the root frame.

    Args:
        body: The request, its states looked up.
        chain: The robot.

    Raises:
        InvalidLinkName: A frame is unknown, or moves.
        InvalidGoal: A constraint names two frames.
    """
    assert body.start.joints is not None
    start = chain.state(body.start.joints, "start.joints")
    frames = Frames(chain, start, body.frame)
    changes: dict[str, Any] = {
        "goal": _goal(body.goal, frames, "goal"),
        "constraints": constraints_in_root_frame(body.constraints, frames),
    }
    if body.planner_options is not None:
        changes["planner_options"] = cartesian_in_root_frame(body.planner_options, frames)
    return body.model_copy(update=changes)


def _goal(goal: Goal, frames: Frames, where: str) -> Goal:
    if goal.any_of is None:
        return single_goal_in_root_frame(goal, frames, where)
    items = [
        single_goal_in_root_frame(g, frames, f"{where}.any_of[{i}]")
        for i, g in enumerate(goal.any_of)
    ]
    return goal.model_copy(update={"any_of": items})


_Goal = TypeVar("_Goal", bound=SingleGoal)


def single_goal_in_root_frame(goal: _Goal, frames: Frames, where: str) -> _Goal:
    """A goal with its pose in the root frame.

    Args:
        goal: A configuration or a pose.
        frames: The frames that the request names.
        where: Place in the request, for messages.

    Raises:
        InvalidLinkName: A frame is unknown, or moves.
    """
    if goal.pose is None:
        return goal
    return goal.model_copy(update={"pose": frames.pose(goal.pose, goal.frame, where)})


def cartesian_in_root_frame(options: Mapping[str, Any], frames: Frames) -> dict[str, Any]:
    """Options of the planner cartesian with their motions in the root frame.

    Args:
        options: The options as JSON has them.
        frames: The frames that the request names.

    Raises:
        InvalidLinkName: A frame is unknown, or moves.
    """
    changed = dict(options)
    for name in ("motions", "waypoints"):
        items = changed.get(name)
        if isinstance(items, list):
            changed[name] = [
                _motion(item, frames, f"planner_options.{name}[{i}]")
                for i, item in enumerate(items)
            ]
    return changed


def _motion(item: Any, frames: Frames, where: str) -> Any:
    if not isinstance(item, dict):
        return item
    values = dict(item)
    named = values.pop("frame", None)
    pose = values.get("pose")
    if isinstance(pose, dict):
        framed = FramedPose.model_validate(pose)
        named = framed.frame or named
        values["pose"] = frames.pose(framed, named, where).model_dump(exclude_none=True)
    T = frames.transform(named, f"{where}.frame")
    if T is None:
        return values
    given = {name: values[name] for name in _MOVED[:-1] if values.get(name) is not None}
    return values | {name: _moved_value(T, name, value) for name, value in given.items()}


def _moved(part: _Body, T: Array, *names: str) -> _Body:
    """A part of a request with its poses and points moved and its directions turned by a transform.

    Args:
        part: The part.
        T: The transform, shape (4, 4).
        names: Fields that are moved; all that can be if left out.
    """
    given = {name: getattr(part, name, None) for name in names or _MOVED}
    changes = {name: _moved_value(T, name, x) for name, x in given.items() if x is not None}
    return part.model_copy(update=changes)


def _moved_value(T: Array, name: str, value: Any) -> Any:
    if isinstance(value, Pose):
        return _moved_pose(T, value)
    turned = T[:3, :3] @ np.asarray(value, dtype=np.float64)
    return (turned if name in _DIRECTIONS else turned + T[:3, 3]).tolist()


def ik_in_root_frame(body: IkRequest, frames: Frames) -> IkRequest:
    """A request for inverse kinematics with poses and constraints in the root frame.

    Raises:
        InvalidLinkName: A frame is unknown, or moves.
        InvalidGoal: A constraint names two frames.
    """
    changes: dict[str, Any] = {
        "constraints": constraints_in_root_frame(body.constraints, frames),
    }
    if body.pose is not None:
        changes["pose"] = frames.pose(body.pose, None, "pose")
    if body.poses is not None:
        changes["poses"] = [frames.pose(p, None, f"poses[{i}]") for i, p in enumerate(body.poses)]
    return body.model_copy(update=changes)


def tool_motions_in_root_frame(
    body: TimedToolMotions | None, frames: Frames
) -> TimedToolMotions | None:
    """Motions that a trajectory is held to, in the root frame.

    Raises:
        InvalidLinkName: A frame is unknown, or moves.
    """
    if body is None:
        return None
    motions = [
        _tool_motion(motion, frames, f"tool_motions.motions[{i}]")
        for i, motion in enumerate(body.motions)
    ]
    return body.model_copy(update={"motions": motions})


def _tool_motion(motion: TimedToolMotion, frames: Frames, where: str) -> TimedToolMotion:
    if motion.start is not None:
        T = frames.transform(poses.frame_of(motion.start), f"{where}.start.frame")
        if T is not None:
            motion = _moved(motion, T, "start")
    T = frames.transform(poses.frame_of(motion.pose), f"{where}.pose.frame")
    if motion.rounds is not None:
        corner = _rounded_corner(motion.rounds, T, frames, f"{where}.rounds")
        motion = motion.model_copy(update={"rounds": corner})
    return motion if T is None else _moved(motion, T)


def _rounded_corner(
    corner: RoundedCorner, T: Array | None, frames: Frames, where: str
) -> RoundedCorner:
    """A corner with its arcs moved by a transform, and its pose from its own frame."""
    T_pose = frames.transform(poses.frame_of(corner.pose), f"{where}.pose.frame")
    if T_pose is not None:
        corner = _moved(corner, T_pose, "pose")
    arcs = {name: getattr(corner, name) for name in ("before", "after")}
    changes = {name: arc and _moved(arc, T) for name, arc in arcs.items() if T is not None}
    return corner.model_copy(update=changes)


# ------------------------------------------------------------------------------ constraints


def constraints_in_root_frame(
    bodies: Sequence[constraints.Constraint] | None, frames: Frames
) -> list[constraints.Constraint] | None:
    """Constraints whose regions and directions are in the root frame.

    One that is seen from another link (``reference_link``) stays as it is.

    Raises:
        InvalidLinkName: A frame is unknown, or moves.
        InvalidGoal: A constraint names a frame and a reference link.
    """
    if bodies is None:
        return None
    return [_constraint(body, frames, f"constraints[{i}]") for i, body in enumerate(bodies)]


def _constraint(body: Any, frames: Frames, where: str) -> Any:
    if not isinstance(body, constraints.OfLink):
        return body
    if body.reference_link is not None:
        if body.frame is not None:
            raise InvalidGoal(
                f"{where} names both a frame and a reference_link",
                hint="frame stands still, reference_link moves: give the one that is meant.",
            )
        return body
    T = frames.transform(body.frame, f"{where}.frame")
    if T is None:
        return body
    match body:
        case constraints.PositionConstraint():
            return body.model_copy(update={"region": _moved(body.region, T)})
        case constraints.OrientationConstraint(direction=None):
            pose = Pose(position=[0.0, 0.0, 0.0], quaternion_xyzw=body.quaternion_xyzw)
            turned = _moved_pose(T, pose).quaternion_xyzw
            return body.model_copy(update={"quaternion_xyzw": turned})
        case constraints.OrientationConstraint():
            return _moved(body, T, "direction")
        case constraints.LookAtConstraint():
            return _moved(body, T, "target")
        case _:
            return _moved(body, T, "pose")


def _moved_pose(T: Array, pose: Pose) -> Pose:
    answer = poses.pose_answer(T @ poses.transform(pose))
    return Pose(position=answer.position, quaternion_xyzw=answer.quaternion_xyzw)


def first_configuration(chain: Chain, joints: Any) -> Array | None:
    """The configuration of a request that has one; None where it has many or none.

    Args:
        chain: The robot.
        joints: Joints as the request gives them.
    """
    if joints is None or (isinstance(joints, list) and joints and isinstance(joints[0], list)):
        return None
    if not isinstance(joints, list) and np.ndim(joints) != 1:
        return None
    return chain.state(joints)
