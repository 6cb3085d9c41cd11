"""Requests of many kinds, answered in this process: what no kernel may be missing for."""

import json
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from kinematics import pose as rotation
from kinematics.forward import forward
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.search.rrt_connect import rrt_connect
from planning.values.deadline import Deadline
from service.endpoints.check import task as check_tasks
from service.endpoints.ik import task as inverse_kinematics
from service.endpoints.plan import task as plan_tasks
from service.endpoints.potential import task as potential_tasks
from service.endpoints.retime import task as retime_tasks
from service.endpoints.simulate import task as simulate_tasks
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import Reference, builtin_reference
from service.workers import current
from service.workers.result import PlanOutcome

_START = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
_GOAL = [1.2, -0.3, 0.0, -2.0, 0.0, 1.8, 0.785]
_TIMEOUT = 60.0
#: One of each kind of solid; the post and the plate are in the straight line's way.
_SHAPES: dict[str, tuple[dict[str, Any], list[float]]] = {
    "floor": ({"type": "halfspace", "normal": [0.0, 0.0, 1.0], "offset": -0.2}, [0.0, 0.0, 0.0]),
    "post": ({"type": "box", "size": [0.1, 0.1, 1.2]}, [0.42, 0.28, 0.6]),
    "ball": ({"type": "sphere", "radius": 0.05}, [-0.6, 0.3, 0.6]),
    "can": ({"type": "cylinder", "radius": 0.05, "height": 0.2}, [-0.6, -0.3, 0.6]),
    "pill": ({"type": "capsule", "radius": 0.05, "height": 0.2}, [-0.6, 0.0, 0.6]),
    "hat": ({"type": "cone", "radius": 0.05, "height": 0.2}, [-0.6, 0.0, 0.9]),
    "cloud": (
        {"type": "point_cloud", "points": [[0, 0, 0], [0, 0, 0.1]], "radius": 0.02},
        [-1, 0, 0],
    ),
}


def requests() -> Iterator[Callable[[], object]]:
    """Requests that between them call kernels of every kind of answer."""
    panda = builtin_reference("panda")
    yield from inverse_kinematics_requests(panda)
    touching = [[0.53, 0.0, 0.0, -2.2, 0.0, 2.2, 0.8], [0.53, 0.6, 0.0, -1.6, 0.0, 2.2, 0.8]]
    check = {"robot": "panda", "scene": _scene(0.001), "joints": [_START, *touching]}
    yield partial(_ask, check_tasks.check, panda, check)
    for planner in ("auto", "straight_line", "potential_field", "rrt_connect"):
        yield partial(_plan, panda, planner)
    yield partial(_grow, panda)
    field = {"joints": _START, "goal_joints": _GOAL, "scene": _scene()}
    yield partial(_ask, potential_tasks.potential, panda, field)
    yield partial(_collide, panda)
    # A start in collision: the nearest free one is looked for.
    stuck = _problem("auto") | {"start": {"joints": touching[0]}}
    yield partial(_ask, plan_tasks.plan, panda, stuck)
    yield partial(_lead, panda)
    yield from _hold(panda)
    yield from _retime(panda)


def inverse_kinematics_requests(robot: Reference) -> Iterator[Callable[[], object]]:
    """Poses that are reached and one that is not, by each method."""
    ask = partial(_ask, inverse_kinematics.ik, robot)
    down = {"position": [0.4, -0.2, 0.4], "rpy": [3.1, 0.0, 0.0]}
    for scene in (None, _scene()):
        yield partial(ask, {"pose": down, "scene": scene})
    yield partial(ask, {"pose": {"position": [3.0, 0.0, 0.0]}})
    for method in ("numeric", "gradient"):
        yield partial(ask, {"pose": down, "method": method})
    for method in ("auto", "numeric"):
        yield partial(ask, {"poses": [down, down], "method": method})


def _retime(panda: Reference) -> Iterator[Callable[[], object]]:
    """Each way to time a path; with torques, whose bounds have kernels of their own."""
    middle = [
        0.5 * (a + b) + 0.1 * (i % 2) for i, (a, b) in enumerate(zip(_START, _GOAL, strict=True))
    ]
    body: dict[str, Any] = {"robot": "panda", "path": {"joints": [_START, middle, _GOAL]}}
    loads = {"torque_limits": True, "tool_speed": 0.5}
    for timing in (
        {"method": "toppra", "blend_tolerance": 0.1, **loads},
        {"method": "jerk_limited", "blend_tolerance": 0.1, "sample_period": 0.1},
        {"method": "jerk_limited", "interpolation": "natural_spline", **loads},
        {"method": "spline"},
    ):
        content = json.dumps(body | {"timing": timing}).encode()
        yield partial(retime_tasks.retime, panda, content)


def _hold(panda: Reference) -> Iterator[Callable[[], object]]:
    """Constraints of a configuration, with obstacles and without, and of a motion."""
    upright = {"type": "orientation", "axis": [0, 0, 1], "direction": [0, 0, -1]}
    wanted = [
        upright | {"cone_angle": 0.3},
        {
            "type": "relative_pose",
            "pose": {"position": [0.4, 0.0, 0.4], "rpy": [3.1, 0, 0]},
            "position_tolerance": 0.05,
            "orientation_tolerance": [0.3, 0.3, 3.2],
            "weight": 1.0,
        },
    ]
    for scene in (None, _scene()):
        query = {"constraints": wanted, "scene": scene}
        yield partial(_ask, inverse_kinematics.ik, panda, query)
    for angle, planner in ((0.3, "auto"), (0.3, "rrt_connect"), (1e-3, "auto")):
        body = _problem(planner) | {"constraints": [upright | {"cone_angle": angle}]}
        body["goal"] = {"joints": [-0.6, *_START[1:]]}
        yield partial(_ask, plan_tasks.plan, panda, body)


def _lead(panda: Reference) -> None:
    """The tool along a line and an arc."""
    tip = forward(worker_cache.robot(panda).chain, _START)
    turn = rotation.to_quaternion(tip[:3, :3]).tolist()
    places = [(tip[:3, 3] + shift).tolist() for shift in np.diag([0.05, 0.05, 0.0])[:2]]
    poses = [{"position": place, "quaternion_xyzw": turn} for place in places]
    motions = [
        {"type": "lin", "pose": poses[0]},
        {"type": "circ", "pose": poses[1], "center": tip[:3, 3].tolist()},
    ]
    body = {
        "robot": "panda",
        "start": {"joints": _START},
        "goal": {"pose": poses[1]},
        "planner": "cartesian",
        "planner_options": {"motions": motions},
    }
    _ask(plan_tasks.plan, panda, body)


def _problem(planner: str) -> dict[str, Any]:
    return {
        "robot": "panda",
        "scene": _scene(),
        "start": {"joints": _START},
        "goal": {"joints": _GOAL},
        "planner": planner,
        "timing": {"sample_period": 0.1},
    }


def _plan(panda: Reference, planner: str) -> None:
    answer = _ask(plan_tasks.plan, panda, _problem(planner))
    if isinstance(answer, PlanOutcome):
        trajectory = json.loads(answer.content)["trajectory"]
        if planner == "auto":
            _track(panda, trajectory)
        motion = {"robot": "panda", "scene": _scene(), "trajectory": trajectory}
        _ask(plan_tasks.validate, panda, motion)


def _grow(panda: Reference) -> None:
    """Trees, which the ladder has no need of where a rung before them finds a way."""
    checker = Checker.of(worker_cache.robot(panda).geometry, Scene())
    rrt_connect(checker, np.array(_START), [np.array(_GOAL)], 0, Deadline.after(_TIMEOUT), 1000)


def _collide(panda: Reference) -> None:
    """A motion through the post: what comes close is left to the referee of the proof."""
    rows = [[a, b - a] for a, b in zip(_START, _GOAL, strict=True)]
    segment = {"t0": 0.0, "t1": 1.0, "coefficients": rows}
    body = {"robot": "panda", "scene": _scene(), "trajectory": {"segments": [segment]}}
    _ask(plan_tasks.validate, panda, body)


def _track(panda: Reference, motion: dict[str, Any]) -> None:
    """The beginning of a closed loop: the kernels are the same for all controllers."""
    controller = {"type": "adaptive", "natural_frequency": 5.0}
    body = {"robot": "panda", "trajectory": motion, "controller": controller, "scene": _scene()}
    _ask(simulate_tasks.simulate, panda, body | {"duration": 0.02})


def _scene(margin: float = 0.0) -> dict[str, Any]:
    obstacles = [
        {"id": name, "shape": shape, "pose": {"position": position}, "margin": margin}
        for name, (shape, position) in _SHAPES.items()
    ]
    return {"obstacles": obstacles}


def _ask(task: Any, robot: Reference, body: dict[str, Any]) -> Any:
    current.begin(Deadline.after(_TIMEOUT), None)
    try:
        return task(robot, None, json.dumps(body).encode())
    finally:
        current.end()
