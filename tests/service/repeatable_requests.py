"""Requests of all kinds whose answers are the same whatever else the machine does.

Searches in them end by their budgets, all far inside their timeouts.
"""

import math
from collections.abc import Mapping
from typing import Any, TypeAlias

from tests.service.robots import ASIDE, FLOOR, HOME, POST, scene

#: Path and body.
Request: TypeAlias = "tuple[str, dict[str, Any]]"
#: Of all patient requests [s]: many times what they take on a machine that is busy.
_TIMEOUT = 280.0

_PLACE = scene(POST, FLOOR)
_TURN = [1.0, 0.0, 0.0, 0.0]
_ABOVE = {"position": [0.5, -0.2, 0.5], "quaternion_xyzw": _TURN}
_ACROSS = {"position": [0.4, -0.3, 0.3], "quaternion_xyzw": _TURN}
_UPRIGHT = {
    "type": "orientation", "axis": [0, 0, 1], "direction": [0, 0, -1], "cone_angle": 0.3,
}  # fmt: skip
_PLAN: dict[str, Any] = {
    "robot": "panda", "scene": _PLACE, "start": {"joints": HOME}, "goal": {"joints": ASIDE},
    "timeout": _TIMEOUT, "seed": 5,
}  # fmt: skip
#: Back past the post to a pose.
_POSE_PLAN = _PLAN | {"start": {"joints": ASIDE}, "goal": {"pose": _ABOVE}}
_STRAIGHT = {
    "pose": {"position": [0.307, 0.2, 0.59]},
    "position_tolerance": 1e-3,
    "orientation_tolerance": math.pi,
}
_BOXES = {
    "table": ([0.6, 1.0, 0.04], [0.6, 0.0, 0.08]),
    "wall": ([0.4, 0.03, 0.15], [0.6, 0.0, 0.175]),
    "crate": ([0.05, 0.05, 0.1], [0.5, -0.25, 0.15]),
}
_CRATE = scene(
    *(
        {"id": name, "shape": {"type": "box", "size": size}, "pose": {"position": position}}
        for name, (size, position) in _BOXES.items()
    )
)

#: Two joints that turn round a ball: planners that find their way slowly find this one.
_BALL = {
    "id": "ball",
    "shape": {"type": "sphere", "radius": 0.1},
    "pose": {"position": [1.0, 0.0, 0.9]},
}
_PLANAR = _PLAN | {
    "robot": "planar_rr", "scene": scene(_BALL), "start": {"joints": [0.0, 0.3]},
    "goal": {"joints": [-1.5, 0.3]},
}  # fmt: skip


def _planned_by(planner: str, **options: Any) -> Request:
    return "/v1/plan", _PLAN | {"planner": planner, "planner_options": options}


def _seam() -> list[dict[str, Any]]:
    """Waypoints round the upper side of a pipe of 15 cm."""
    waypoints = []
    for k in range(24):
        angle = -0.7 + 1.4 * k / 23
        normal = [0.0, math.sin(angle), math.cos(angle)]
        point = [0.5 + 0.02 * angle, 0.15 * normal[1], 0.2 + 0.15 * normal[2]]
        waypoints.append({"point": point, "normal": normal})
    return waypoints


def _task(**changes: Any) -> Request:
    """Pick a crate whichever way, and put it behind a wall."""
    down = {"position": [0.0, 0.0, 0.02], "rpy": [math.pi, 0.0, 0.0]}
    around = [0.0, 2.0 * math.pi]
    place = {"pose": {"position": [0.5, 0.25, 0.15]}, "size": [0.1, 0.1], "angles": around}
    stages = [
        {"kind": "move"},
        {"kind": "approach", "distance": [0.05, 0.1]},
        {"kind": "grasp", "object": "crate", "region": {"pose": down, "angles": around},
         "touch_links": ["panda_hand"], "support": "table"},
        {"kind": "attach", "object": "crate"},
        {"kind": "lift", "distance": [0.05, 0.15]},
        {"kind": "move"},
        {"kind": "approach", "distance": [0.05, 0.1], "direction": [0, 0, -1], "frame": "root"},
        {"kind": "place", "region": place, "support": "table"},
        {"kind": "detach"},
        {"kind": "retreat", "distance": [0.05, 0.1]},
        {"kind": "move", "goal": {"joints": HOME}},
    ]  # fmt: skip
    body = {
        "robot": "panda", "start": {"joints": HOME}, "scene": _CRATE, "stages": stages,
        "improve": 0.0, "timeout": _TIMEOUT,
    }  # fmt: skip
    return "/v1/tasks", body | changes


def _tour(**changes: Any) -> Request:
    """Six poses with a free spin, a configuration, and a post between them."""
    goals: list[dict[str, Any]] = [
        {
            "pose": {"position": [x, y, 0.35], "quaternion_xyzw": _TURN},
            "tolerance": {"free": ["rz"], "samples": 4},
        }
        for x in (0.4, 0.5, 0.55)
        for y in (-0.35, -0.1)
    ]
    body = {
        "robot": "panda", "scene": _PLACE, "start": {"joints": HOME},
        "goals": [{"joints": ASIDE}, *goals], "rounds": 3, "leg_timeout": _TIMEOUT,
        "timeout": _TIMEOUT, "seed": 2,
    }  # fmt: skip
    return "/v1/tours", body | changes


def _ik(**changes: Any) -> Request:
    body = {"pose": _ACROSS, "timeout": _TIMEOUT}
    return "/v1/robots/panda/ik", body | changes


_HELD = {
    "pose": {"position": [0.45, 0.1, 0.5]}, "method": "constrained", "axes": ["x", "y", "z"],
    "constraints": [_UPRIGHT, {"type": "clearance", "margin": 0.02}], "scene": _PLACE,
}  # fmt: skip
_HARD_PLAN = _POSE_PLAN | {"constraints": [_UPRIGHT]}
_FREE = {"waypoints": _seam(), "tool_speed": 0.05, "tolerance": {"tilt": 0.1}}

PATIENT: Mapping[str, Request] = {
    "auto": ("/v1/plan", _PLAN),
    "pose goal": ("/v1/plan", _POSE_PLAN),
    "any of": ("/v1/plan", _PLAN | {"goal": {"any_of": [{"joints": ASIDE}, {"pose": _ABOVE}]}}),
    "rrt_connect": _planned_by("rrt_connect"),
    "potential_field": _planned_by("potential_field"),
    "bit_star": _planned_by("bit_star", max_edges=300),
    "aorrtc": _planned_by("aorrtc", max_edges=300),
    "rrt_star": (
        "/v1/plan",
        _PLANAR | {"planner": "rrt_star", "planner_options": {"max_edges": 1000}},
    ),
    "informed_rrt_star": (
        "/v1/plan",
        _PLANAR | {"planner": "informed_rrt_star", "planner_options": {"max_edges": 1000}},
    ),
    "prm": _planned_by("prm"),
    "prm_star": _planned_by("prm_star", max_edges=300),
    "fmt": _planned_by("fmt"),
    "kpiece1": _planned_by("kpiece1"),
    "constrained": ("/v1/plan", _HARD_PLAN),
    "preferred clearance": ("/v1/plan", _PLAN | {"clearance": {"preferred": 0.05}}),
    "refine": ("/v1/plan", _PLAN | {"refine": {}}),
    "optimize": _planned_by("optimize"),
    "spline": ("/v1/plan", _PLAN | {"timing": {"method": "spline"}}),
    "toppra": ("/v1/plan", _PLAN | {"timing": {"method": "toppra"}}),
    "jerk_limited": ("/v1/plan", _PLAN | {"timing": {"method": "jerk_limited"}}),
    "torque limits": ("/v1/plan", _PLAN | {"timing": {"torque_limits": True}}),
    "cartesian": ("/v1/plan", _PLAN | {"planner": "cartesian", "goal": _STRAIGHT, "scene": None}),
    "seam": (
        "/v1/plan",
        {name: _PLAN[name] for name in ("robot", "start", "timeout")}
        | {"planner": "cartesian", "planner_options": _FREE},
    ),
    "batch": (
        "/v1/plan/batch",
        {name: _PLAN[name] for name in ("robot", "scene", "start", "timeout")}
        | {"problems": [{"goal": {"joints": ASIDE}, "seed": n} for n in range(4)]},
    ),
    "task": _task(),
    "tour": _tour(),
    "reach": (
        "/v1/robots/panda/reach",
        {
            "box": {
                "pose": {"position": [0.5, 0.0, 0.4]}, "size": [0.4, 0.8, 0.4], "spacing": 0.1,
                "orientations": [_TURN],
            },
            "tolerance": {"free": ["rz"], "samples": 6}, "scene": _PLACE,
        },
    ),
    "bases": (
        "/v1/robots/ur5e/reach",
        {
            "poses": [_ABOVE, _ACROSS],
            "bases": [{"position": [0.0, 0.1 * n, 0.0]} for n in range(5)],
        },
    ),
    "ik": _ik(),
    "ik numeric": _ik(method="numeric", all_solutions=True, scene=_PLACE),
    "ik gradient": _ik(method="gradient"),
    "ik constrained": _ik(**_HELD),
    "simulate": (
        "/v1/simulate",
        {
            "robot": "planar_rr",
            "reference": {"type": "hold", "joints": [0.3, -0.4], "duration": 0.1},
            "controller": {"type": "computed_torque", "natural_frequency": 10.0},
            "model_error": {"mass_scale": 1.2},
        },
    ),
    "check": ("/v1/check", {"robot": "panda", "scene": _PLACE, "joints": [HOME, ASIDE]}),
    "potential": (
        "/v1/robots/panda/potential",
        {"joints": HOME, "goal_joints": ASIDE, "scene": _PLACE},
    ),
}  # fmt: skip
