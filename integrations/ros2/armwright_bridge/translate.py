"""Messages of MoveIt as requests of Armwright, and answers as messages; no ROS is imported here.

Messages are read by their fields as ``moveit_msgs`` (ROS 2) names them, whatever class they are of.
What is asked for and can't be honoured is refused by name: nothing is left out silently.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

#: MoveItErrorCodes by the service's codes, which have MoveIt's names.
ERROR_CODES = {
    "SUCCESS": 1, "FAILURE": 99999, "PLANNING_FAILED": -1, "INVALID_MOTION_PLAN": -2,
    "TIMED_OUT": -6, "START_STATE_IN_COLLISION": -10, "START_STATE_VIOLATES_PATH_CONSTRAINTS": -11,
    "GOAL_IN_COLLISION": -12, "GOAL_VIOLATES_PATH_CONSTRAINTS": -13,
    "GOAL_CONSTRAINTS_VIOLATED": -14, "INVALID_GROUP_NAME": -15, "INVALID_GOAL_CONSTRAINTS": -16,
    "INVALID_ROBOT_STATE": -17, "INVALID_LINK_NAME": -18, "INVALID_OBJECT_NAME": -19,
    "FRAME_TRANSFORM_FAILURE": -21, "START_STATE_INVALID": -26, "GOAL_STATE_INVALID": -27,
    "UNRECOGNIZED_GOAL_TYPE": -28, "NO_IK_SOLUTION": -31,
}  # fmt: skip
#: Types of shape_msgs/SolidPrimitive.
_BOX, _SPHERE = 1, 2
#: Tolerances of an orientation are those of the rotation vector's components.
_ROTATION_VECTOR = 1


class Refused(Exception):
    """A request that can't be honoured.

    Args:
        code: Name of the error code of MoveIt.
        message: The reason.
    """

    def __init__(self, code: str, message: str) -> None:
        super().__init__(message)
        self.code = code


def plan_request(
    request: Any,
    robot: str,
    joints: Sequence[str],
    tip: str,
    measured: Mapping[str, float],
    group: str = "",
) -> dict[str, Any]:
    """Body of ``POST /v1/plan`` of a moveit_msgs/MotionPlanRequest, without its scene.

    Args:
        request: The message.
        robot: Name of the robot in the service.
        joints: Names of its joints, in order.
        tip: Its last link.
        measured: Positions by joint, for those that the start state leaves out [rad or m].
        group: Group of MoveIt that the robot is; any if empty.

    Raises:
        Refused: It asks for what can't be honoured.
    """
    if group and request.group_name and request.group_name != group:
        raise Refused("INVALID_GROUP_NAME", f"the group is {request.group_name!r}, not {group!r}")
    if request.trajectory_constraints.constraints:
        raise Refused("INVALID_MOTION_PLAN", "trajectory_constraints are not supported")
    if request.reference_trajectories:
        raise Refused("INVALID_MOTION_PLAN", "reference_trajectories are not supported")
    if not request.goal_constraints:
        raise Refused("INVALID_GOAL_CONSTRAINTS", "there are no goal_constraints")
    goals = [_goal(one, joints, tip) for one in request.goal_constraints]
    body: dict[str, Any] = {
        "robot": robot,
        "start": {"joints": _start(request.start_state, joints, measured)},
        "goal": goals[0] if len(goals) == 1 else {"any_of": goals},
    }
    if request.planner_id:
        body["planner"] = request.planner_id
    if request.allowed_planning_time > 0.0:
        body["timeout"] = request.allowed_planning_time
    # 0 stands for 1 in MoveIt.
    scalings = (request.max_velocity_scaling_factor, request.max_acceleration_scaling_factor)
    names = ("velocity_scaling", "acceleration_scaling")
    timing = {name: value for name, value in zip(names, scalings, strict=True) if value > 0.0}
    constraints = _path_constraints(request.path_constraints)
    if request.max_cartesian_speed > 0.0:
        if request.cartesian_speed_limited_link not in ("", tip):
            link = request.cartesian_speed_limited_link
            raise Refused("INVALID_LINK_NAME", f"speed is limited at {tip!r} alone, not {link!r}")
        constraints.append({"type": "tool_speed", "limit": request.max_cartesian_speed})
    if timing:
        body["timing"] = timing
    if constraints:
        body["constraints"] = constraints
    return body


def _start(state: Any, joints: Sequence[str], measured: Mapping[str, float]) -> list[float]:
    if state.attached_collision_objects:
        raise Refused(
            "INVALID_ROBOT_STATE", "start_state.attached_collision_objects are not supported"
        )
    given = dict(zip(state.joint_state.name, state.joint_state.position, strict=False))
    known = {**measured, **given}
    missing = [name for name in joints if name not in known]
    if missing:
        raise Refused("INVALID_ROBOT_STATE", f"nothing is known of where {missing} are")
    return [float(known[name]) for name in joints]


def _goal(constraints: Any, joints: Sequence[str], tip: str) -> dict[str, Any]:
    if constraints.visibility_constraints:
        raise Refused("UNRECOGNIZED_GOAL_TYPE", "visibility_constraints are no goal here")
    positions, rotations = constraints.position_constraints, constraints.orientation_constraints
    if constraints.joint_constraints:
        if positions or rotations:
            raise Refused("UNRECOGNIZED_GOAL_TYPE", "a goal has joints or a pose, not both")
        named = {one.joint_name: float(one.position) for one in constraints.joint_constraints}
        missing = [name for name in joints if name not in named]
        if missing:
            raise Refused("INVALID_GOAL_CONSTRAINTS", f"the goal says nothing of {missing}")
        return {"joints": [named[name] for name in joints]}
    if len(positions) != 1 or len(rotations) != 1:
        message = "a pose as the goal is one position and one orientation constraint"
        raise Refused("UNRECOGNIZED_GOAL_TYPE", message)
    (position,), (rotation,) = positions, rotations
    for one in (position, rotation):
        if one.link_name not in ("", tip):
            raise Refused("INVALID_LINK_NAME", f"goals are of {tip!r}, not of {one.link_name!r}")
    if position.header.frame_id != rotation.header.frame_id:
        raise Refused("FRAME_TRANSFORM_FAILURE", "position and orientation are in two frames")
    center, reach = _region(position.constraint_region)
    quaternion = _quaternion(rotation.orientation)
    # The region holds a point of the tip, whose origin is before it by the turned offset.
    offset = _turned(quaternion, _xyz(position.target_point_offset))
    angles = (rotation.absolute_x_axis_tolerance, rotation.absolute_y_axis_tolerance,
              rotation.absolute_z_axis_tolerance)  # fmt: skip
    goal: dict[str, Any] = {
        "pose": {
            "position": [c - o for c, o in zip(center, offset, strict=True)],
            "quaternion_xyzw": quaternion,
        },
        "position_tolerance": reach,
        "orientation_tolerance": min(angles),
    }
    if position.header.frame_id:
        goal["frame"] = position.header.frame_id
    return goal


def _region(region: Any) -> tuple[list[float], float]:
    """Centre of a region, and how far every point within it may be off that [m]."""
    if region.meshes or len(region.primitives) != 1 or len(region.primitive_poses) != 1:
        raise Refused("INVALID_GOAL_CONSTRAINTS", "constraint_region is one box or sphere")
    (solid,), (pose,) = region.primitives, region.primitive_poses
    if solid.type == _SPHERE:
        reach = float(solid.dimensions[0])
    elif solid.type == _BOX:
        reach = 0.5 * float(min(solid.dimensions))
    else:
        raise Refused("INVALID_GOAL_CONSTRAINTS", "constraint_region is one box or sphere")
    return _xyz(pose.position), reach


def _path_constraints(constraints: Any) -> list[dict[str, Any]]:
    if constraints.visibility_constraints:
        raise Refused("INVALID_MOTION_PLAN", "visibility constraints of a path are not supported")
    rows: list[dict[str, Any]] = [
        {
            "type": "joint",
            "joint": one.joint_name,
            "position": float(one.position),
            "tolerance_above": float(one.tolerance_above),
            "tolerance_below": float(one.tolerance_below),
        }
        for one in constraints.joint_constraints
    ]
    rows += [_held_orientation(one) for one in constraints.orientation_constraints]
    rows += [_held_position(one) for one in constraints.position_constraints]
    return rows


def _held_orientation(one: Any) -> dict[str, Any]:
    """A constraint that holds wherever MoveIt's does, and is stricter for Euler angles.

    With R = Rx Ry Rz the diff to the target: an axis z that is tilted by at most t has x and y
    angles of at most t, and a rotation by at most t has no larger one about any axis.
    """
    angles = [float(getattr(one, f"absolute_{axis}_axis_tolerance")) for axis in "xyz"]
    quaternion = _quaternion(one.orientation)
    row: dict[str, Any] = {"type": "orientation", "link": one.link_name} | _frame(one)
    if one.parameterization == _ROTATION_VECTOR:
        return row | {"quaternion_xyzw": quaternion, "axis_tolerances": angles}
    free = [angle >= math.pi for angle in angles]
    if free == [False, False, True]:
        up = _turned(quaternion, [0.0, 0.0, 1.0])
        return row | {"axis": [0.0, 0.0, 1.0], "direction": up, "cone_angle": min(angles[:2])}
    if any(free):
        message = "Euler angles with x or y free: give parameterization ROTATION_VECTOR"
        raise Refused("INVALID_MOTION_PLAN", message)
    each = min(angles) / math.sqrt(3.0)
    return row | {"quaternion_xyzw": quaternion, "axis_tolerances": [each] * 3}


def _held_position(one: Any) -> dict[str, Any]:
    region = one.constraint_region
    center, _ = _region(region)
    (solid,), (pose,) = region.primitives, region.primitive_poses
    held: dict[str, Any]
    if solid.type == _SPHERE:
        held = {"type": "sphere", "center": center, "radius": float(solid.dimensions[0])}
    else:
        place = {"position": center, "quaternion_xyzw": _quaternion(pose.orientation)}
        held = {"type": "box", "pose": place, "size": [float(x) for x in solid.dimensions]}
    point = _xyz(one.target_point_offset)
    row = {"type": "position", "link": one.link_name, "point": point, "region": held}
    return row | _frame(one)


def _frame(one: Any) -> dict[str, str]:
    return {"frame": one.header.frame_id} if one.header.frame_id else {}


def _xyz(vector: Any) -> list[float]:
    return [float(vector.x), float(vector.y), float(vector.z)]


def _quaternion(value: Any) -> list[float]:
    """A unit quaternion [x, y, z, w]; zeros are no rotation, as in MoveIt."""
    parts = [float(value.x), float(value.y), float(value.z), float(value.w)]
    size = math.sqrt(sum(part * part for part in parts))
    return [part / size for part in parts] if size > 0.0 else [0.0, 0.0, 0.0, 1.0]


def _turned(quaternion: Sequence[float], vector: Sequence[float]) -> list[float]:
    """A vector turned by a unit quaternion: v + 2 w (u x v) + 2 u x (u x v)."""
    (x, y, z, w), (a, b, c) = quaternion, vector
    once = (y * c - z * b, z * a - x * c, x * b - y * a)
    twice = (y * once[2] - z * once[1], z * once[0] - x * once[2], x * once[1] - y * once[0])
    return [v + 2.0 * (w * p + q) for v, p, q in zip(vector, once, twice, strict=True)]


def fill_trajectory(message: Any, rows: Mapping[str, Any], point: Any, duration: Any) -> None:
    """Fill a trajectory_msgs/JointTrajectory from the client's ``joint_trajectory``.

    Args:
        message: The message to fill.
        rows: The trajectory as the client writes it, a dictionary of the message.
        point: Class of trajectory_msgs/JointTrajectoryPoint.
        duration: Class of builtin_interfaces/Duration.
    """
    message.header.frame_id = rows["header"]["frame_id"]
    message.joint_names = list(rows["joint_names"])
    points = []
    for row in rows["points"]:
        one, time = point(), row["time_from_start"]
        one.positions, one.velocities = list(row["positions"]), list(row["velocities"])
        one.accelerations = list(row["accelerations"])
        one.time_from_start = duration(sec=int(time["sec"]), nanosec=int(time["nanosec"]))
        points.append(one)
    message.points = points
