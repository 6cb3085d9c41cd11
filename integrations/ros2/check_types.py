"""Check the bridge against the message definitions of moveit_msgs, without ROS.

    pip install rosbags
    git clone https://github.com/moveit/moveit_msgs
    python integrations/ros2/check_types.py moveit_msgs

``rosbags`` makes classes of the definitions and writes messages as ROS 2 does (CDR); what has a
wrong name or type can't be read or written.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np
from armwright_bridge.translate import ERROR_CODES, fill_trajectory, plan_request
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

JOINTS = [f"panda_joint{i}" for i in range(1, 8)]
_POINT = "trajectory_msgs/msg/JointTrajectoryPoint"


def main(folder: Path) -> None:
    """Read requests and write a response, both through CDR."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    found: dict[str, Any] = {}
    for path in sorted((folder / "msg").glob("*.msg")):
        found |= get_types_from_msg(path.read_text(), f"moveit_msgs/msg/{path.stem}")
    # Octomaps are no part of what is asked for.
    for name, text in _OTHERS.items():
        found |= get_types_from_msg(text, name)
    store.register(found)
    request = _default(store, "moveit_msgs/msg/MotionPlanRequest")
    for index, name in enumerate(JOINTS):
        one = _default(store, "moveit_msgs/msg/JointConstraint")
        one.joint_name, one.position = name, 0.1 * index
        request.goal_constraints = [*request.goal_constraints, one]
    goal = _default(store, "moveit_msgs/msg/Constraints")
    goal.joint_constraints, request.goal_constraints = request.goal_constraints, [goal]
    held = _default(store, "moveit_msgs/msg/OrientationConstraint")
    held.link_name, held.orientation.w = "panda_link8", 1.0
    held.absolute_x_axis_tolerance = held.absolute_y_axis_tolerance = 0.1
    held.absolute_z_axis_tolerance = 3.2
    request.path_constraints.orientation_constraints = [held]
    again = _through_cdr(store, request)
    body = plan_request(again, "panda", JOINTS, "panda_link8", dict.fromkeys(JOINTS, 0.0))
    print("request:", body)
    response = _default(store, "moveit_msgs/msg/MotionPlanResponse")
    rows = {
        "header": {"frame_id": "panda_link0"},
        "joint_names": JOINTS,
        "points": [
            {"positions": [0.0] * 7, "velocities": [0.0] * 7, "accelerations": [0.0] * 7,
             "time_from_start": {"sec": 1, "nanosec": 5}}
        ],
    }  # fmt: skip
    duration = store.types["builtin_interfaces/msg/Duration"]
    fill_trajectory(
        response.trajectory.joint_trajectory, rows, lambda: _default(store, _POINT), duration
    )
    for point in response.trajectory.joint_trajectory.points:
        for name in ("positions", "velocities", "accelerations"):
            setattr(point, name, np.array(getattr(point, name)))
    points = _through_cdr(store, response).trajectory.joint_trajectory.points
    print("response:", len(points), "point at", points[0].time_from_start.nanosec, "ns")
    codes = store.types["moveit_msgs/msg/MoveItErrorCodes"]
    for name, value in ERROR_CODES.items():
        assert getattr(codes, name) == value, name
    print("error codes:", len(ERROR_CODES), "as published")


#: Definitions that moveit_msgs refers to, by the names of the fields alone that are read here.
_OTHERS = {
    "octomap_msgs/msg/Octomap": "std_msgs/Header header\nint8[] data\n",
    "octomap_msgs/msg/OctomapWithPose": "geometry_msgs/Pose origin\noctomap_msgs/Octomap octomap\n",
    "object_recognition_msgs/msg/ObjectType": "string key\nstring db\n",
}


def _through_cdr(store: Any, message: Any) -> Any:
    kind = message.__msgtype__
    return store.deserialize_cdr(store.serialize_cdr(message, kind), kind)


def _default(store: Any, kind: str) -> Any:
    """A message of zeros and empty lists."""
    made = {}
    for name, (node, detail) in store.fielddefs[kind][1]:
        made[name] = _value(store, node, detail)
    return store.types[kind](**made)


def _value(store: Any, node: Any, detail: Any) -> Any:
    label = node.name if hasattr(node, "name") else str(node)
    if label == "NAME":
        return _default(store, detail)
    if label == "BASE":
        base = detail[0]
        return "" if base == "string" else False if base == "bool" else (
            0.0 if base.startswith("float") else 0)  # fmt: skip
    (inner, kind), count = detail
    of = inner.name if hasattr(inner, "name") else str(inner)
    if of == "BASE" and kind[0] != "string":
        return np.zeros(count or 0, dtype=kind[0])
    return [_value(store, inner, kind) for _ in range(count or 0)]


if __name__ == "__main__":
    main(Path(sys.argv[1]))
