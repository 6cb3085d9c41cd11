"""After warming, no request compiles anything."""

from pathlib import Path

from tests.compiled.programs import run

ROOT = Path(__file__).parents[2]
#: Run in a process of its own, since this one may have called anything by now.
SCRIPT = """
import gc, json, tempfile
from numba.core.dispatcher import Dispatcher
from service.warm_up import kernels


def signatures():
    # Compiled now or loaded from the cache on disk: neither may happen in a request.
    kernels = [k for k in gc.get_objects() if isinstance(k, Dispatcher)]
    return {(k.__module__, k.__name__, str(s)) for k in kernels for s in k.overloads}


kernels.prepare(lambda *_: None)
before = signatures()

import numpy as np
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.values.deadline import Deadline
from planning.search.rrt_connect import rrt_connect
from service.storage.caches import worker_cache
from service.endpoints.check import task as check
from service.endpoints.dynamics import task as dynamics
from service.endpoints.ik import task as inverse_kinematics
from service.endpoints.kinematics import task as kinematics
from service.endpoints.plan import task as plan
from service.endpoints.potential import task as potential
from service.endpoints.robots import task as robots
from service.endpoints.simulate import task as simulate
from service.workers import current
from service.storage.caches.cache_key import builtin_reference
from armwright_wire.robots.kinematics import FkRequest, JacobianRequest

ROBOTS = {"ur5e": 6, "stanford": 6, "scara": 4, "iiwa14": 7}
OBSTACLES = [
    {"id": "a", "shape": {"type": "box", "size": [0.1, 0.1, 0.1]}, "margin": 0.01},
    {"id": "b", "shape": {"type": "cylinder", "radius": 0.1, "height": 0.2}},
    {"id": "c", "shape": {"type": "cone", "radius": 0.1, "height": 0.2}},
    {"id": "d", "shape": {"type": "convex", "vertices": [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]}},
]
SCENE = {"obstacles": [o | {"pose": {"position": [2.0, 0, i]}} for i, o in enumerate(OBSTACLES)]}


def ask(task, name, body, seconds=20.0):
    current.begin(Deadline.after(seconds), None)
    return task(builtin_reference(name), None, json.dumps(body).encode())


for name, n in ROBOTS.items():
    lower = json.loads(worker_cache.robot(builtin_reference(name)).answer)["limits"]["lower"]
    home = [0.2 + 0.9 * (value or 0.0) * 0.1 for value in lower]
    near = [value + 0.1 for value in home]
    chain = worker_cache.chain(builtin_reference(name))
    body = {"joints": home, "link": chain.links[2].name}
    kinematics.fk(chain, FkRequest.model_validate(body))
    kinematics.jacobian(chain, JacobianRequest.model_validate(body | {"point": [0.1, 0, 0]}))
    pose = {"position": [0.3, 0.1, 0.3]}
    ask(inverse_kinematics.ik, name, {"pose": pose, "scene": SCENE, "all_solutions": True})
    ask(inverse_kinematics.ik, name, {"poses": [pose, pose]})
    ask(inverse_kinematics.ik, name, {"poses": [pose, pose], "method": "numeric"})
    ask(check.check, name, {"robot": name, "scene": SCENE, "joints": [home, near]})
    rod = {"id": "rod", "shape": {"type": "capsule", "radius": 0.01, "height": 0.02},
           "pose": {"position": [0, 0, 0]}, "link": chain.tip_link, "touch_links": []}
    problem = {"robot": name, "scene": SCENE, "start": {"joints": home}, "goal": {"joints": near},
               "attached": [rod], "margin": 0.001}
    for planner in ("auto", "rrt_connect", "potential_field"):
        ask(plan.plan, name, problem | {"planner": planner}, 5.0)
    checker = Checker.of(worker_cache.robot(builtin_reference(name)).geometry, Scene(), 0.001)
    rrt_connect(checker, np.array(home), [np.array(near)], 0, Deadline.after(5.0), 100)
    ask(potential.potential, name, {"joints": [home, near], "goal_joints": near, "scene": SCENE,
                                          "options": {"attractive_weights": [1.0] * n}})
    motion = {"samples": {"time": [0, 1, 3], "position": [home, near, home]}, "interpolation": "natural_spline"}
    ask(plan.validate, name, {"robot": name, "scene": SCENE, "trajectory": motion}, 5.0)
    state = {key: [home, near] for key in ("joints", "velocities", "accelerations")}
    state["payload"] = {"mass": 1.0}
    for task in (dynamics.dynamics_task, dynamics.regressor_task):
        task(builtin_reference(name), json.dumps(state).encode())
    for kind in ("independent_joint", "computed_torque", "pd_gravity", "passivity", "adaptive"):
        loop = {"robot": name, "trajectory": motion, "scene": SCENE, "control_period": 0.01,
                "controller": {"type": kind, "natural_frequency": 5.0}, "noise": {"position": 1e-5},
                "model_error": {"mass_scale": 1.1}, "disturbance": {"wrench": [1, 0, 0, 0, 0, 0]}}
        ask(simulate.simulate, name, loop, 20.0)
from tests.service.robots import bench
with tempfile.TemporaryDirectory() as folder:
    robots.prepare_robot(json.dumps(bench("warm")).encode(), folder)
assert len(before) > 20
print(sorted(name for module, name, _ in signatures() - before))
"""  # noqa: E501


def test_no_request_compiles_anything() -> None:
    ran = run(SCRIPT, ROOT)
    assert ran.returncode == 0, ran.stderr[-3000:]
    assert ran.stdout.strip() == "[]"
