"""Digests of many answers, to the last bit: equal ones on every processor that a build is for.

    python scripts/answers.py

Prints a JSON object: a digest for each kind of answer, how many kernels had to be compiled, and
the processor that the machine code is for. Robots, states and problems are drawn from fixed seeds.
"""

import gc
import hashlib
import json
from collections.abc import Iterator
from typing import Any

import numpy as np

from armwright_wire.robots.kinematics import FkRequest, JacobianRequest
from compiled.compiler.dispatcher import Kernel
from compiled.compiler.target import target
from kinematics.forward import forward
from planning.values.deadline import Deadline
from service.endpoints.check import task as check
from service.endpoints.dynamics import task as dynamics
from service.endpoints.ik import task as inverse_kinematics
from service.endpoints.kinematics import task as kinematics
from service.endpoints.plan import task as plan
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import builtin_reference
from service.workers import current

#: Emulated processors are a hundred times as slow [s].
_TIMEOUT = 600.0
_ROBOTS = ("panda", "ur5e", "stanford", "scara")
_STATES = 64


_TASKS: tuple[tuple[str, Any, Any], ...] = (
    ("forward", kinematics.fk, FkRequest),
    ("jacobian", kinematics.jacobian, JacobianRequest),
)
#: How many states are checked for collisions.
_CHECKED = 200
_START = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
_GOAL = [1.2, -0.3, 0.0, -2.0, 0.0, 1.8, 0.785]
#: One of each kind of solid; the post is in the straight line's way.
_SHAPES: dict[str, tuple[dict[str, Any], list[float]]] = {
    "floor": ({"type": "halfspace", "normal": [0.0, 0.0, 1.0], "offset": -0.2}, [0.0, 0.0, 0.0]),
    "post": ({"type": "box", "size": [0.1, 0.1, 1.2]}, [0.42, 0.28, 0.6]),
    "ball": ({"type": "sphere", "radius": 0.15}, [-0.6, 0.3, 0.6]),
    "can": ({"type": "cylinder", "radius": 0.15, "height": 0.2}, [-0.6, -0.3, 0.6]),
    "pill": ({"type": "capsule", "radius": 0.05, "height": 0.2}, [-0.6, 0.0, 0.6]),
    "hat": ({"type": "cone", "radius": 0.15, "height": 0.2}, [-0.6, 0.0, 0.9]),
}


def main() -> None:
    """Print the digests and what was compiled for them."""
    digests = dict(_kinematics()) | dict(_motions())
    kernels = [one for one in gc.get_objects() if isinstance(one, Kernel)]
    compiled = sum(sum(one.stats.cache_misses.values()) for one in kernels)
    print(json.dumps({"answers": digests, "compiled": compiled, "target": target().name}))


def _kinematics() -> Iterator[tuple[str, str]]:
    random = np.random.default_rng(1)
    for name in _ROBOTS:
        chain = worker_cache.chain(builtin_reference(name))
        lower, upper = chain.sampling_bounds()
        states = random.uniform(lower, upper, (_STATES, len(lower)))
        for kind, task, request in _TASKS:
            for some in (states[0], states):
                found = task(chain, request.model_validate({"joints": some.tolist()}))
                yield f"{kind} of {name} {some.ndim}", _digest(found)
        motion = {key: states.tolist() for key in ("joints", "velocities", "accelerations")}
        content = json.dumps(motion).encode()
        terms = dynamics.dynamics_task(builtin_reference(name), content)
        yield f"dynamics of {name}", _digest(terms)
        regressor = dynamics.regressor_task(builtin_reference(name), content)
        yield f"regressor of {name}", _digest(regressor)
        poses = [_pose(forward(chain, state)) for state in states[:8]]
        for method in ("auto", "numeric"):
            found = _ask(inverse_kinematics.ik, name, {"poses": poses, "method": method})
            yield f"{method} inverse kinematics of {name}", _digest(found)


def _motions() -> Iterator[tuple[str, str]]:
    obstacles = [
        {"id": name, "shape": shape, "pose": {"position": position}}
        for name, (shape, position) in _SHAPES.items()
    ]
    problem: dict[str, Any] = {"robot": "panda", "scene": {"obstacles": obstacles}}
    chain = worker_cache.chain(builtin_reference("panda"))
    states = np.random.default_rng(2).uniform(*chain.sampling_bounds(), (_CHECKED, 7))
    yield "verdicts", _digest(_ask(check.check, "panda", problem | {"joints": states.tolist()}))
    problem |= {"start": {"joints": _START}, "goal": {"joints": _GOAL}, "seed": 3}
    problem |= {"planner": "rrt_connect", "timeout": _TIMEOUT}
    trajectory = json.loads(_ask(plan.plan, "panda", problem).content)["trajectory"]
    yield "plan", _digest(trajectory)
    motion = {key: problem[key] for key in ("robot", "scene")} | {"trajectory": trajectory}
    yield "proof", _digest(_ask(plan.validate, "panda", motion))


def _pose(T: Any) -> dict[str, Any]:
    return {"position": T[:3, 3].tolist(), "rotation_matrix": T[:3, :3].tolist()}


def _ask(task: Any, robot: str, body: dict[str, Any]) -> Any:
    current.begin(Deadline.after(_TIMEOUT), None)
    try:
        return task(builtin_reference(robot), None, json.dumps(body).encode())
    finally:
        current.end()


def _digest(answer: Any) -> str:
    """Digest of an answer without the times that it took."""
    if isinstance(answer, bytes):
        answer = json.loads(answer)
    return hashlib.sha256(json.dumps(_timeless(answer)).encode()).hexdigest()[:16]


def _timeless(value: Any) -> Any:
    if isinstance(value, dict):
        return {
            key: _timeless(one)
            for key, one in value.items()
            if "seconds" not in key and key not in ("timings", "compute_time")
        }
    return list(map(_timeless, value)) if isinstance(value, list) else value


if __name__ == "__main__":
    main()
