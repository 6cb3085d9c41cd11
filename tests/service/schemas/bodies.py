"""Small valid parts of requests, for what is wrong with one of them."""

from typing import Any

IDENTITY = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
POSE = {"position": [0.4, 0.0, 0.3]}
BRIEF: dict[str, Any] = {
    "robot": "panda",
    "start": {"joints": [0.0, 0.1]},
    "goal": {"joints": [0.5, 0.6]},
}
BUNDLE: dict[str, Any] = {
    "armwright_bundle": 1, "operation": "POST /v1/plan", "version": "0.1.0", "status": "succeeded",
    "seed": 1, "digest": "0" * 64, "robot": "arm", "robot_document": "{}", "scene": "table",
    "scene_document": "{}", "request": "{}", "answer": "{}",
}  # fmt: skip
CORNERS = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]]
ORIENTATIONS: list[dict[str, Any]] = [
    {"quaternion_xyzw": [0.0, 0.0, 0.0, 1.0]},
    {"rotation_matrix": IDENTITY},
    {"euler_zyz": [0.1, 0.2, 0.3]},
    {"rpy": [0.1, 0.2, 0.3]},
    {"axis_angle": [0.0, 0.0, 1.0, 0.5]},
]
ATTACHED: list[dict[str, Any]] = [
    {
        "id": "part", "shape": {"type": "box", "size": [0.1, 0.2, 0.3]}, "pose": POSE,
        "link": "hand", "mass": 0.5, "center_of_mass": [0.0, 0.0, 0.1], "inertia": IDENTITY,
    },
    {"id": "o1", "grasp_joints": [0.1, 0.2], "link": "hand"},
]  # fmt: skip
REGIONS: list[dict[str, Any]] = [
    {"type": "box", "pose": POSE, "size": [0.1, 0.0, 0.1]},
    {"type": "sphere", "center": [0.4, 0.0, 0.3], "radius": 0.05},
    {"type": "plane", "point": [0.4, 0.0, 0.3], "normal": [0.0, 0.0, 1.0], "tolerance": 0.002},
    {"type": "line", "point": [0.4, 0.0, 0.3], "direction": [0.0, 1.0, 0.0], "tolerance": 0.002,
     "length": 0.5},
]  # fmt: skip
CONSTRAINTS: list[dict[str, Any]] = [
    {"type": "joint", "joint": "j1", "position": 0.1, "tolerance_above": 0.2, "weight": 2.0},
    *({"type": "position", "region": region} for region in REGIONS),
    {"type": "orientation", "link": "hand", "axis": [0.0, 0.0, 1.0], "direction": [0.0, 0.0, -1.0],
     "cone_angle": 0.2},
    {"type": "orientation", "quaternion_xyzw": [0.0, 0.0, 0.0, 1.0], "axis_tolerances": 0.1},
    {"type": "look_at", "axis": [0.0, 0.0, 1.0], "target": [0.6, 0.0, 0.1], "angle": 0.05},
    {"type": "clearance", "margin": 0.02},
    {"type": "relative_pose", "pose": POSE, "position_tolerance": 0.01, "reference_link": "base"},
    {"type": "tool_speed", "limit": 0.25},
    {"type": "torque", "limits": [10.0, 20.0]},
]  # fmt: skip
MOTIONS: list[dict[str, Any]] = [
    {"type": "lin", "pose": POSE, "blend": 0.0, "rotation": "longer"},
    {"type": "circ", "pose": POSE, "via": [0.4, 0.1, 0.3]},
    {"type": "circ", "pose": POSE, "center": [0.4, 0.1, 0.3], "normal": [0.0, 0.0, 1.0]},
]
SEGMENTS = {
    "joint_names": ["j1", "j2"], "duration": 1.0,
    "segments": [{"t0": 0.0, "t1": 1.0, "coefficients": [[0.0, 1.0], [0.5]]}],
}  # fmt: skip
SAMPLES: dict[str, Any] = {
    "samples": {"time": [0.0, 1.0], "position": [[0.0, 0.0], [1.0, 1.0]],
                "velocity": [[0.0, 0.0], [0.0, 0.0]], "acceleration": [[0.0, 0.0], [0.0, 0.0]]},
    "interpolation": "quintic",
}  # fmt: skip
DH_ROW: dict[str, Any] = {
    "type": "revolute", "a": 0.5, "alpha": 0.0, "d": 0.0, "theta": 0.0, "lower": -3.0, "upper": 3.0,
    "velocity": 2.0, "mass": 1.0,
    "geometry": [{"shape": {"type": "box", "size": [0.1, 0.2, 0.3]}, "pose": POSE}],
}  # fmt: skip
