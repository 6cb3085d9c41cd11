"""Every kind of stage of a task, with every field."""

from typing import Any

from pydantic import BaseModel

from armwright_wire.plans.task import TaskRequest


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
    }
    way = {
        "distance": [0.05, 0.1],
        "direction": [0.0, 0.0, 1.0],
        "frame": "tool",
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
        {"kind": "close", "state": "shut"},
        {"kind": "open", "joints": {"claw": 0.02}},
        {"kind": "wait", "duration": 1.0},
        {"kind": "move", "end_of": "#1"},
    ]  # fmt: skip
    return [common | {"name": f"#{k}"} | stage for k, stage in enumerate(stages)]


def tasks(
    pose: dict[str, Any], constraints: list[dict[str, Any]]
) -> list[tuple[type[BaseModel], Any]]:
    """The schema of tasks, with a task that has every field and stages of every kind."""
    body = {
        "robot": "panda",
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
        "goal_costs": {"joint_limits": 1.0},
        "allow_partial": True,
        "timeout": 2.0,
        "seed": 1,
        "keep": True,
    }
    return [(TaskRequest, body)]
