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
import gc
from numba.core.dispatcher import Dispatcher
from service.storage.caches.cache_key import builtin_reference
from service.warm_up import kernels, warm_requests
from tests.service.kernel_requests import inverse_kinematics_requests, requests


def signatures():
    # Compiled now or loaded from the cache on disk: neither may happen in a request.
    kernels = [k for k in gc.get_objects() if isinstance(k, Dispatcher)]
    return {(k.__module__, k.__name__, str(s)) for k in kernels for s in k.overloads}


kernels.prepare(lambda *_: None)
before = signatures()
assert len(before) > 20
for _ in warm_requests.steps():
    pass
for ask in requests():
    ask()
for name in ("ur5e", "stanford", "scara", "iiwa14"):
    for ask in inverse_kinematics_requests(builtin_reference(name)):
        ask()
print(sorted(name for module, name, _ in signatures() - before))
"""


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
