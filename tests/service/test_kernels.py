"""Kernels that requests reach: listed, compiled beforehand, and never in a request."""

import subprocess
import sys
from pathlib import Path

import pytest

from compiled.compiler import build, kernel_list, machine_code, store
from kinematics.robots import builtin_names
from obstacles import kept_files
from obstacles.collision.checker import Checker
from obstacles.collision.model import brackets, collision_model, pair_grid
from obstacles.collision.model.collision_model import _robot_part
from obstacles.convex import sphere_set
from obstacles.scenes.scene import Scene
from service.cli import main
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import builtin_reference
from service.warm_up import kernels, warm_requests
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


def test_workers_find_the_spheres_of_each_built_in_robot() -> None:
    steps = [step for step in warm_requests._requests() if "_keep_apart" in repr(step)]
    assert len(steps) == len(builtin_names())
    geometry = worker_cache.robot(builtin_reference("planar_rr")).geometry
    for step in steps:
        if "planar_rr" in repr(step):
            step()
    made = _robot_part.cache_info().misses
    assert Checker.of(geometry, Scene()).clearance(geometry.chain.limits.lower)[0] > 0.0
    assert _robot_part.cache_info().misses == made


def test_the_next_server_finds_them_on_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    in_memory = (
        collision_model._robot_part, brackets.brackets, sphere_set._spheres, pair_grid._values,
    )  # fmt: skip
    monkeypatch.setattr(kept_files, "_directory", None)  # as it was, afterwards
    monkeypatch.setattr(warm_requests, "kept_solids", lambda: tmp_path)
    for cache in in_memory:
        cache.cache_clear()
    warm_requests._keep_apart("scara")
    files = {path.name for path in tmp_path.iterdir()}
    assert files

    def refuse(*_arguments: object) -> None:
        pytest.fail("they are computed once more")

    for cache in in_memory:
        cache.cache_clear()
    monkeypatch.setattr(sphere_set, "_sphere_rows", refuse)
    monkeypatch.setattr(pair_grid, "_values", refuse)
    warm_requests._keep_apart("scara")
    assert {path.name for path in tmp_path.iterdir()} == files


#: Prints the kernels of modules that the service imports, and that nothing on the list calls.
FIND_UNREACHED = """
import sys
import service.app, service.warm_up.warm_requests
from compiled.compiler import kernel_list
from compiled.compiler.dispatcher import Kernel
from compiled.compiler.fingerprint import callees
from service.warm_up import kernels
from service.task_references import MODULES
from service.workers.task import load_tasks
for module in MODULES: load_tasks(module)
entries, _ = kernel_list.read(kernels.LIST)
reached, pending = set(), [entry.kernel.py_func for entry in entries]
while pending:
    function = pending.pop()
    if function not in reached:
        reached.add(function)
        pending.extend(callees(function))
packages = ("kinematics.", "dynamics.", "obstacles.", "planning.", "tracking.", "service.")
for name, module in sorted(sys.modules.items()):
    for key, value in vars(module).items() if name.startswith(packages) else ():
        if isinstance(value, Kernel) and value.py_func.__module__ == name:
            if value.py_func not in reached:
                print(f"{name}.{key}")
"""


def test_every_line_of_the_list_names_a_kernel_and_types_that_are_there() -> None:
    entries, unknown = kernel_list.read(kernels.LIST)
    assert unknown == []
    assert len(entries) > 400
    assert sum(entry.door for entry in entries) > 80


def test_kernels_on_disk_are_not_compiled_again(capsys: pytest.CaptureFixture[str]) -> None:
    reported: list[object] = []
    counts = kernels.compile_kernels(lambda *progress: reported.append(progress))
    assert (counts.compiled, counts.outdated) == (0, ())
    assert reported == []
    assert main(["warm"]) == 0
    assert f"{counts.total} kernels are there, 0 of them compiled now" in capsys.readouterr().out


def test_entries_are_missing_where_no_folder_has_them(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setenv("ARMWRIGHT_KERNELS", str(tmp_path))
    entries, _ = kernel_list.read(kernels.LIST)
    some = [entry for entry in entries if entry.door][:3]
    assert build.missing_entries(some) == some
    for name in [*some[0].files, some[1].files[0]]:
        store.file_of(tmp_path, name).touch(0o644)
    assert build.missing_entries(some) == some[1:]
    (tmp_path / "other").touch()
    store.file_of(tmp_path, f"no.kernel-{'0' * 32}.door").touch()
    (tmp_path / some[0].files[0]).touch()  # as files were called before
    assert kernels.prune() == 2
    assert (tmp_path / "other").is_file()
    assert build.missing_entries(some) == some[1:]


def test_every_kernel_that_the_service_imports_is_reached_from_the_list() -> None:
    ran = run(FIND_UNREACHED, ROOT)
    assert ran.returncode == 0, ran.stderr[-3000:]
    assert not ran.stdout.split()


def test_the_demonstration_needs_the_first_kernels_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    entries, _ = kernel_list.read(kernels.LIST)
    first = kernel_list.needed_by(kernels.first_names(), entries)
    assert kernels.first_names() == {entry.name for entry in first if entry.door}
    assert len(first) < 0.65 * len(entries)
    pending, linked = [name for entry in first for name in entry.files], set[str]()
    while pending:
        name = pending.pop()
        if name not in linked:
            linked.add(name)
            files = (store.file_of(one, name) for one in store.layers())
            found = next(file for file in files if file.is_file())
            (tmp_path / found.name).symlink_to(found)
            code = machine_code.find(name)
            assert code is not None
            # Some that only kernels call have types without a notation, and are on no list.
            pending += code.needs
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setenv("ARMWRIGHT_KERNELS", str(tmp_path))
    monkeypatch.setenv("ARMWRIGHT_KERNELS_FROZEN", "1")
    assert main(["warm", "--first"]) == 0
    told = capsys.readouterr().out
    assert told.startswith(f"{len(first)} kernels are there, 0 of them compiled now\n")
    assert "more, which other requests need" in told
    demo = [sys.executable, "examples/demo.py", "--output", str(tmp_path / "out")]
    ran = subprocess.run(demo, cwd=ROOT, capture_output=True, check=False, text=True)
    # It fails where a kernel is missing: `python scripts/kernel_list.py --first` writes the names.
    assert ran.returncode == 0, ran.stderr[-3000:]
    assert "Verified: True" in ran.stdout


def test_an_image_keeps_its_kernels_where_they_are_looked_for_first(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "user"))
    monkeypatch.setenv("ARMWRIGHT_KERNELS", str(tmp_path / "package"))
    kernels.keep_in_package()
    assert store.user_folder() == tmp_path / "package" == store.layers()[0]
