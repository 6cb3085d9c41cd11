"""The start of the service: what its processes load, take and say."""

import contextlib
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from service import task_references
from service.task_references import MODULES
from service.workers.task import TaskReference, load_tasks, registered_task, task_names
from tests.service.commands import serve
from tests.service.processes import alive, children, descendants, wait_until
from tests.service.robots import HOME, answer, problem

#: Libraries that compute; each has files whose paths hold its name.
LIBRARIES = ("casadi", "fcl", "llvmlite", "numba", "numpy", "ompl", "ruckig", "scipy", "toppra")
Service = tuple[subprocess.Popen[str], httpx.Client]
CHECK = {"robot": "panda", "scene": {"obstacles": []}, "joints": HOME, "timeout": 60.0}


def size(pid: int, kind: str) -> int:
    """A size that the system tells of a process [MB]."""
    text = Path(f"/proc/{pid}/smaps_rollup").read_text()
    sizes = re.findall(rf"^{kind}:\s+(\d+) kB", text, re.MULTILINE)
    return sum(map(int, sizes)) // 1024


def libraries(pid: int) -> set[str]:
    """Those of `LIBRARIES` that a process has mapped."""
    maps = Path(f"/proc/{pid}/maps").read_text()
    return {name for name in LIBRARIES if f"/{name}" in maps or f"lib{name}" in maps}


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    with serve(tmp_path_factory.mktemp("startup")) as started:
        yield started


def test_only_workers_have_what_computes_and_they_share_it(service: Service) -> None:
    process, client = service
    (fork_server,) = children(process.pid)
    assert wait_until(lambda: len(children(fork_server)) == 3, 20.0), "two and a spare one"
    answer(client.post("/v1/check", json=CHECK))
    answer(client.post("/v1/robots/panda/fk", json={"joints": HOME}))
    assert answer(client.get("/v1/robots/panda"))["name"] == "panda"
    assert libraries(process.pid) == set(), "after requests that compute, too"
    assert libraries(fork_server) >= {"llvmlite", "numpy", "scipy"}
    # Generous: 62 MB and 280 MB are usual, and 10 MB for a worker that has begun.
    assert size(process.pid, "Rss") < 130
    assert size(fork_server, "Rss") < 450
    sizes: list[int] = []

    def measured() -> bool:
        # Workers that were forked early are replaced meanwhile: one may end while it is read.
        with contextlib.suppress(OSError):
            sizes[:] = [size(pid, "Private_(?:Clean|Dirty)") for pid in children(fork_server)]
        return len(sizes) == 3

    assert wait_until(measured, 20.0)
    assert max(sizes) < 60


def test_killed_workers_cost_no_later_request(service: Service) -> None:
    process, client = service
    (fork_server,) = children(process.pid)
    for count in (1, 3):
        victims = sorted(children(fork_server))[:count]
        for pid in victims:
            os.kill(pid, signal.SIGKILL)
        # One that has a signal pending may still take a job, which then fails with it.
        assert wait_until(lambda: not any(map(alive, victims)), 20.0)  # noqa: B023
        answer(client.post("/v1/check", json=CHECK))
        assert wait_until(lambda: len(children(fork_server)) == 3, 20.0)
    assert answer(client.get("/readyz"))["workers"] == 2


def test_a_cold_cache_is_told_in_readyz_and_in_the_log(tmp_path: Path) -> None:
    cold = {
        "NUMBA_CACHE_DIR": str(tmp_path / "cold"),
        "ARMWRIGHT_KERNELS": str(tmp_path / "none"),
    }
    with serve(tmp_path, warm=False, environment=cold) as (process, client):
        assert answer(client.get("/healthz"))["status"] == "ok"
        documents = []

        def compiling() -> bool:
            documents.append(problem(client.get("/readyz"), 503, "NOT_READY"))
            return bool(documents[-1]["details"].get("compiled", 0) >= 1)

        assert wait_until(compiling, 90.0)
        details, text = documents[-1]["details"], documents[-1]["detail"]
        assert 1 <= details["compiled"] < details["kernels"]
        assert details["seconds_left"] > 0.0
        expected = r"kernels are being compiled: \d+ of \d+, about \d+ s left"
        assert re.fullmatch(expected, text), text
        assert 1 <= int(client.get("/readyz").headers["retry-after"]) <= 60
        problem(client.post("/v1/check", json=CHECK | {"timeout": 0.2}), 504, "TIMED_OUT")
        process.terminate()
        _, log = process.communicate(timeout=20.0)
        assert re.search(r"INFO service\.workers\.pool: compiling kernels: \d+ of \d+", log), log


#: The same as the command that is installed: the script's folder is on the path, not the current.
SCRIPT = "import sys\nfrom service.cli import main\nsys.exit(main())\n"
MARK = "import pathlib, os\npathlib.Path({marker!r}).write_text(__file__)\n"
ROOT = Path(__file__).parents[2]


def start(folder: Path, tmp_path: Path) -> subprocess.Popen[str]:
    script = tmp_path / "bin" / "armwright"
    script.parent.mkdir()
    script.write_text(SCRIPT)
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONSAFEPATH"}
    environment |= {"ARMWRIGHT_WORKERS": "1", "PYTHONPATH": str(ROOT)}
    return subprocess.Popen(
        [sys.executable, str(script), "serve", "--port", "0", "--data-dir", str(tmp_path / "data")],
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
    )


def test_packages_in_the_current_folder_are_not_imported(tmp_path: Path) -> None:
    folder, marker = tmp_path / "project", tmp_path / "marker"
    for package, module in (("service", "warm"), ("planning", "pipeline"), ("signal", "x")):
        (folder / package).mkdir(parents=True)
        for name in ("__init__", module):
            (folder / package / f"{name}.py").write_text(MARK.format(marker=str(marker)))
    process = start(folder, tmp_path)
    try:
        assert process.stdout is not None
        assert re.match(r"Armwright serves on http://", process.stdout.readline())
        # The fork server; what it imports is imported within a second.
        assert wait_until(lambda: len(descendants(process.pid)) >= 1, 20.0)
        assert not wait_until(marker.exists, 3.0), marker.read_text()
    finally:
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=30)


REFERENCES: dict[str, Any] = {
    name: value for name, value in vars(task_references).items() if isinstance(value, TaskReference)
}
LOOK = """
import sys
import service.app, service.server
from service.app import create_app
create_app().openapi()
print(*sys.modules)
"""


def load_all() -> None:
    for module in MODULES:
        load_tasks(module)


@pytest.mark.parametrize("name", REFERENCES)
def test_a_reference_makes_the_jobs_of_its_task(name: str) -> None:
    load_all()
    reference = REFERENCES[name]
    assert reference.job(1, b=2) == registered_task(reference.name).job(1, b=2)
    assert reference.name.endswith(f":{name.removesuffix('_task')}")


def test_every_task_has_a_reference() -> None:
    for path in (ROOT / "service/endpoints").rglob("*.py"):
        if path.stem not in ("route", "__init__"):
            load_tasks(".".join(path.relative_to(ROOT).with_suffix("").parts))
    referred = {reference.name for reference in REFERENCES.values()}
    assert referred == task_names("service.endpoints")


def test_the_server_loads_nothing_that_computes() -> None:
    ran = subprocess.run([sys.executable, "-c", LOOK], cwd=ROOT, capture_output=True, check=True)
    modules = ran.stdout.decode().split()
    loaded = {name.partition(".")[0] for name in modules}
    heavy = {"casadi", "collada", "fcl", "llvmlite", "matplotlib", "numba", "numpy", "ompl"}
    heavy |= {"ruckig", "scipy", "toppra", "trimesh", "yaml"}
    assert not loaded & heavy
    assert not loaded & {"dynamics", "obstacles", "tracking"}
    # The web framework imports the interfaces; what makes spans is not loaded without a collector.
    makers = ("opentelemetry.sdk", "opentelemetry.exporter", "google", "service.tracing.t")
    assert not [name for name in modules if name.startswith(makers)]
