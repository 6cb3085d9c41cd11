"""Small real requests that load libraries and compute values that others would wait for.

Kernels are loaded from their list; what a request needs beside them is here.
"""

import base64
import json
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
import scipy.interpolate
import scipy.signal

from kinematics.robots import builtin_names
from obstacles.collision.checker import Checker
from obstacles.collision.kept_robot import kept_solids
from obstacles.kept_files import keep_files_in, written_files
from obstacles.scenes.scene import Scene
from planning.optimize import scp
from planning.values.deadline import Deadline
from service.endpoints.check import task as check_tasks
from service.endpoints.ik import task as inverse_kinematics
from service.endpoints.plan import task as plan_tasks
from service.endpoints.potential import task as potential_tasks
from service.endpoints.retime import task as retime_tasks
from service.endpoints.robots import task as robots
from service.endpoints.simulate import task as simulate_tasks
from service.storage.caches import prepared_files, worker_cache
from service.storage.caches.cache_key import Reference, builtin_reference
from service.workers import current
from service.workers.result import PlanOutcome

#: Modules that others import where they first need them: in workers nothing waits for that.
_LOADED = (scipy.interpolate, scipy.signal, scp)
_START = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
_GOAL = [1.2, -0.3, 0.0, -2.0, 0.0, 1.8, 0.785]
_TIMEOUT = 60.0
#: A post in the straight line's way.
_SCENE = {
    "obstacles": [
        {
            "id": "post",
            "shape": {"type": "box", "size": [0.1, 0.1, 1.2]},
            "pose": {"position": [0.42, 0.28, 0.6]},
        }
    ]
}


def steps() -> Iterator[None]:
    """Answer requests of our own, one a step, so that first requests of others find all prepared.

    Libraries are loaded and values computed that are kept by process, such as the spheres around a
    robot's links. Whoever takes the steps can do something else in between.
    """
    for answer in _requests():
        answer()
        yield


def _requests() -> Iterator[Callable[[], object]]:
    # Before what needs them: only what is not in memory yet is written for the next server.
    for name in builtin_names():
        yield partial(_keep_apart, name)
    with tempfile.TemporaryDirectory() as folder:
        yield partial(_uploads, folder)
    panda = builtin_reference("panda")
    down = {"position": [0.4, -0.2, 0.4], "rpy": [3.1, 0.0, 0.0]}
    yield partial(_ask, inverse_kinematics.ik, panda, {"poses": [down, down]})
    upright = {"type": "orientation", "axis": [0, 0, 1], "direction": [0, 0, -1]}
    held = {"constraints": [upright | {"cone_angle": 0.3}], "scene": _SCENE}
    yield partial(_ask, inverse_kinematics.ik, panda, held)
    field = {"joints": _START, "goal_joints": _GOAL, "scene": _SCENE}
    yield partial(_ask, potential_tasks.potential, panda, field)
    yield partial(_plan, panda)
    yield partial(_collide, panda)
    timing = {"method": "toppra", "torque_limits": True}
    path = {"robot": "panda", "path": {"joints": [_START, _GOAL]}, "timing": timing}
    yield partial(retime_tasks.retime, panda, json.dumps(path).encode())


def _keep_apart(name: str) -> None:
    """A built-in robot with spheres and grids of its links, which would take each worker 0.9 s.

    They lie beside the machine code from then on, where the next server finds them.
    """
    geometry = worker_cache.robot(builtin_reference(name)).geometry
    keep_files_in(kept_solids())
    with written_files():
        Checker.of(geometry, Scene()).clearance(np.zeros(geometry.chain.n))


def _plan(panda: Reference) -> None:
    """A plan around an obstacle, and the beginning of a closed loop along it."""
    ends = {"start": {"joints": _START}, "goal": {"joints": _GOAL}}
    answer = _ask(plan_tasks.plan, panda, {"robot": "panda", "scene": _SCENE, **ends})
    if isinstance(answer, PlanOutcome):
        body = {
            "robot": "panda",
            "scene": _SCENE,
            "trajectory": json.loads(answer.content)["trajectory"],
            "controller": {"type": "adaptive", "natural_frequency": 5.0},
            "duration": 0.02,
        }
        _ask(simulate_tasks.simulate, panda, body)


def _collide(panda: Reference) -> None:
    """A motion through the post: what comes close is left to the referee of the proof."""
    rows = [[a, b - a] for a, b in zip(_START, _GOAL, strict=True)]
    segment = {"t0": 0.0, "t1": 1.0, "coefficients": rows}
    body = {"robot": "panda", "scene": _SCENE, "trajectory": {"segments": [segment]}}
    _ask(plan_tasks.validate, panda, body)


#: Without an SRDF, so that the links that always touch are looked for; with no two that do.
_URDF = """<robot name="warm">
<link name="a"><collision><geometry><sphere radius="0.1"/></geometry></collision></link>
<link name="b"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
<link name="c"><collision><geometry><mesh filename="c.obj"/></geometry></collision></link>
<joint name="ab" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
<joint name="bc" type="prismatic"><parent link="b"/><child link="c"/><origin xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"""
_OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def _uploads(folder: str) -> None:
    """A stored robot with a mesh; a scene with one of two bodies, and points projected onto it."""
    meshes = {"c.obj": base64.b64encode(_OBJ.encode()).decode()}
    robot = {"name": "warm", "urdf": _URDF, "meshes": meshes}
    robots.prepare_robot(json.dumps(robot).encode(), folder)
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]]
    faces += [[2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    mesh = {
        "type": "mesh",
        "vertices": [*corners.tolist(), *(0.5 * corners + [0.9, 0.9, 0.9]).tolist()],
        "faces": [*faces, *(np.array(faces) + 8).tolist()],
    }
    obstacle = {"id": "mesh", "shape": mesh, "pose": {"position": [2.0, 2.0, 2.0]}}
    document = json.dumps({"name": "warm", "obstacles": [obstacle]}).encode()
    robots.prepare_scene(document, folder, "warm")
    reference = Reference("scene", "warm", prepared_files.document_hash(document), folder)
    points = {"points": [[0.0, 0.0, 0.0], [2.5, 2.5, 2.5], [-0.6, 0.0, 0.6]]}
    check_tasks.project(reference, json.dumps(points).encode())


def _ask(task: Any, robot: Reference, body: dict[str, Any]) -> Any:
    current.begin(Deadline.after(_TIMEOUT), None)
    try:
        return task(robot, None, json.dumps(body).encode())
    finally:
        current.end()
