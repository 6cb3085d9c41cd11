"""References of tasks, and the server that they keep small."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from service import task_references
from service.task_references import MODULES
from service.workers.task import TaskReference, load_tasks, registered_task, task_names

ROOT = Path(__file__).parents[2]
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
