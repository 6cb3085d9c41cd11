"""Valid bodies of tours with every field."""

from typing import Any

from pydantic import BaseModel

from armwright_wire.plans.tour import TourRequest

_POSE = {"position": [0.4, 0.0, 0.3], "frame": "base"}
_BOX = {"type": "box", "size": [0.1, 0.1, 0.1]}
_GOALS: list[dict[str, Any]] = [
    {"id": "a", "joints": [0.1, 0.2], "dwell": 0.5, "group": "left"},
    {"pose": _POSE, "frame": "tool", "position_tolerance": 1e-3, "orientation_tolerance": 1e-2,
     "tolerance": {"free": ["rz"], "samples": 4}},
    {"state": "home"},
    {"any_of": [{"joints": [0.3, 0.4]}, {"pose": _POSE}]},
]  # fmt: skip

TOURS: list[tuple[type[BaseModel], dict[str, Any]]] = [
    (TourRequest, {
        "robot": "arm", "scene": "table", "frame": "base", "start": {"joints": [0.0, 0.1]},
        "end": {"state": "home"}, "goals": _GOALS, "precedence": [["a", "1"], ["left", "3"]],
        "attached": [{"id": "drill", "shape": _BOX, "pose": {"position": [0.0, 0.0, 0.1]},
                      "link": "hand"}],
        "allowed_collisions": [["hand", "table"]], "margin": 0.01,
        "clearance": {"preferred": 0.02, "least": 0.01}, "start_state_tolerance": 1e-5,
        "timing": {"method": "jerk_limited", "velocity_scaling": 0.5},
        "limits": {"velocity": [1.0, 1.0]}, "rounds": 3, "leg_timeout": 1.0,
        "goal_costs": {"turns": 1.0},
        "allow_partial": True, "timeout": 5.0, "seed": 7, "keep": True,
        "constraints": [{"type": "clearance", "margin": 0.01}]}),
    (TourRequest, {"robot": "arm", "start": {"state": "home"}, "end": "start",
                   "goals": _GOALS[:2]}),
]  # fmt: skip
