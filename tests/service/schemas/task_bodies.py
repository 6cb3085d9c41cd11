"""Requests for tasks that set every field."""

from typing import Any

from pydantic import BaseModel

from armwright_wire.plans.task import TaskRequest

MARGINS = {"links": {"hand": 0.02}, "objects": {"o0": 0.03}, "own": 0.01}


def task_stages(pose: dict[str, Any], constraints: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Stages of every kind, as requests have them.

    Args:
        pose: Any pose.
        constraints: Any constraints.
    """
    common: dict[str, Any] = {
        "margin": 0.01,
        "allowed_collisions": [["hand", "crate"]],
        "constraints": constraints,
        "timing": {"velocity_scaling": 0.5},
        "limits": {"velocity": [1.0]},
        "tool": "gripper_a",
        "tcp": "tip",
    }
    way = {
        "distance": [0.05, 0.1],
        "direction": [0.0, 0.0, 1.0],
        "frame": "tool",
        "relative_to": "table",
        "max_deviation": 1e-3,
        "max_orientation_deviation": 1e-2,
    }
    turns = {"pose": pose, "angles": [0.0, 1.0], "angle_samples": 2}
    stages: list[dict[str, Any]] = [
        {"kind": "move"},
        {"kind": "approach", **way},
        {"kind": "grasp", "object": "crate", "grasps": [pose], "touch_links": ["hand"],
         "support": "table", "touch_depth": 0.002},
        {"kind": "close", "joints": {"claw": 0.01}, "duration": 0.2},
        {"kind": "attach", "object": "crate", "link": "hand", "touch_links": ["table"],
         "touch_depth": 0.002, "mass": 0.4, "center_of_mass": [0.0, 0.0, 0.01],
         "inertia": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]},
        {"kind": "lift", **way},
        {"kind": "move", "goal": {"pose": pose}, "tolerance": {"free": ["rz"]}, "planner": "auto",
         "blend": 0.1},
        {"kind": "place", "object": "crate", "poses": [pose | {"frame": "base"}],
         "support": ["table", "shelf"], "touch_depth": 0.002},
        {"kind": "open", "state": "wide", "duration": 0.2},
        {"kind": "detach", "object": "crate", "touch_links": ["hand"],
         "touch_depth": 0.002},
        {"kind": "retreat", **way},
        {"kind": "grasp", "object": "crate", "region": turns | {
            "axis": [0.0, 0.0, 1.0], "offsets": [0.0, 0.1], "offset_samples": 2}},
        {"kind": "place", "relative_to": "table", "region": turns | {
            "size": [0.1, 0.1], "samples": [2, 2]}},
        {"kind": "close", "state": "shut", "until": "contact"},
        {"kind": "open", "joints": {"claw": 0.02}},
        *({"kind": "grasp", "object": "crate", "grasps": {kind: {
            "count": 8, "angles": 4, "friction": 0.3, "depth": 0.01, "radius": 0.01, "seed": 2}}}
          for kind in ("antipodal", "top", "side", "suction")),
        {"kind": "wait", "duration": 1.0},
        {"kind": "move", "end_of": "#1"},
        {"kind": "lift", "direction": "normal", "distance": [0.05, 0.1]},
        {"kind": "insert", **way, "distance": 0.02, "into": "chuck", "touch_depth": 0.002},
        {"kind": "line", "poses": [pose | {"frame": "base"}], "blend": 0.01, "tool_speed": 0.1,
         "max_deviation": 1e-3, "max_orientation_deviation": 1e-2},
        {"kind": "line", "pose": pose},
        {"kind": "arc", "pose": pose, "via": [0.4, 0.0, 0.3], "tool_speed": 0.1,
         "max_deviation": 1e-3, "max_orientation_deviation": 1e-2},
        {"kind": "arc", "pose": pose, "center": [0.4, 0.0, 0.3], "normal": [0.0, 0.0, 1.0]},
        {"kind": "seam", "waypoints": [{"pose": pose}, {"point": [0.4, 0.1, 0.3],
                                                        "normal": [0.0, 0.0, 1.0]}],
         "tolerance": {"free": ["rz"]}, "through": "spline", "tool_speed": 0.1, "speed_band": 0.1,
         "blend": 0.01,
         "max_deviation": 1e-3, "max_orientation_deviation": 1e-2, "orientation": "slerp",
         **{name: {"direction": [0.0, 0.0, 1.0], "distance": 0.05}
            for name in ("approach", "retreat", "branch_changes")}},
        {"kind": "signal", "output": "clamp", "value": False, "duration": 0.1},
        {"kind": "set", "output": "spindle", "value": 0.5},
        {"kind": "wait_for", "input": "ready", "value": False},
        *({"kind": "place", name: {"pose": pose, "step": [0.1, 0.1, 0.1], "count": [2, 2, 1],
                                   "first": 1, "fill": "any"}} for name in ("grid", "stack")),
        {"kind": "move", "goal": {"joints": [0.1]},
         "via": [{"goal": {"any_of": [{"joints": [0.1]}]}, "blend": 0.1}]},
        {"kind": "place", "object": "crate", "support": "table",
         "resting": {"samples": [2, 2], "angle_samples": 3}},
    ]  # fmt: skip
    single = [common | {"name": f"#{k}"} | stage for k, stage in enumerate(stages)]
    return [
        *single,
        {"kind": "for_each", "for_each": {"object": ["a", "b"]}, "order": "free",
         "stages": [{"kind": "wait", "duration": 1.0}]},
        {"kind": "fallback", "fallback": [[{"kind": "wait", "duration": 1.0}]]},
        {"kind": "regrasp", "supports": ["table"], "grasps": {"top": {}}, "most": 2,
         "distance": [0.02, 0.1]},
        {"kind": "regrasp", "poses": [pose], "support": "table"},
        {"kind": "regrasp", "region": {"pose": pose}, "support": ["table"]},
    ]  # fmt: skip


def tasks(
    pose: dict[str, Any], constraints: list[dict[str, Any]]
) -> list[tuple[type[BaseModel], Any]]:
    """The schema of tasks, with a task that has every field and stages of every kind."""
    body = {
        "robot": "panda",
        "tool": "gripper_a",
        "tcp": "tip",
        "margins": MARGINS,
        "scene": "table",
        "frame": "base",
        "start": {"joints": [0.1]},
        "stages": task_stages(pose, constraints),
        "objects": [{"id": "crate", "pose": pose}],
        "attached": [{"id": "held", "link": "hand", "pose": pose}],
        "fingers": {"claw": 0.02},
        "allowed_collisions": [["hand", "crate"]],
        "margin": 0.01,
        "timing": {"velocity_scaling": 0.5},
        "limits": {"velocity": [1.0]},
        "improve": 0.5,
        "witness": True,
        "goal_costs": {"joint_limits": 1.0},
        "stops": "none",
        "allow_partial": True,
        "timeout": 2.0,
        "seed": 1,
        "keep": True,
    }
    return [(TaskRequest, body)]
