"""Settings for all tests: reproducible examples of hypothesis, and quick collecting."""

import contextlib
import gc
import importlib
import os
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

from tests.programs import not_run

#: Examples of each property: enough for its corners, few enough for a tenth of a second.
_EXAMPLES = 60
#: Folders whose files share a service, a browser or plans: one process takes all of a folder.
_TOGETHER = (
    "tests/client/", "tests/planning/witness/", "tests/service/jobs/", "tests/service/viewer/",
    "tests/studio/",
)  # fmt: skip

#: Files of few tests that take long: they begin first, for who takes one last is waited for.
LONG = (
    "tests/service/test_kernels.py", "tests/compiled/test_kernel.py",
    "tests/service/test_cli.py", "tests/service/test_reproducible.py",
    "tests/test_wheels.py", "tests/service/test_durability.py",
    "tests/compiled/test_build.py", "tests/command_line/test_studio.py",
    "tests/planning/goal_choice/test_plans.py",
    "tests/service/test_startup.py", "tests/service/test_agents.py",
    "tests/obstacles/distance/triangles/test_distance.py",
    "tests/service/test_positioner_obstacles.py",
    "tests/course/test_example_course.py", "tests/test_readme.py",
    "tests/kinematics/calibration/test_calibrate.py",
    "tests/command_line/test_main.py", "tests/planning/proof/test_mimic_joints.py",
)  # fmt: skip

if "PYTEST_XDIST_WORKER" in os.environ:
    # One thread for linear algebra, as workers of the service have it: the other processes have
    # the other cores, and threads that wait for one another keep theirs busy. Read by numpy, which
    # is not loaded yet.
    for _library in ("OMP", "OPENBLAS", "MKL"):
        os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

settings.register_profile(
    "reproducible", derandomize=True, deadline=None, database=None, max_examples=_EXAMPLES
)
settings.load_profile("reproducible")


@pytest.hookimpl(wrapper=True)
def pytest_collection(session: pytest.Session) -> Iterator[None]:
    """Look for garbage once when all modules are there, and never again among what they made.

    Collecting makes a million objects that stay. Looking through them again and again took a
    quarter of its time, and 0.6 s each time that a test had made enough.
    """
    gc.disable()
    try:
        _import_share(session.config)
        return (yield)
    finally:
        gc.collect()
        gc.freeze()
        gc.enable()


def _import_share(config: pytest.Config) -> None:
    """Import a part of the modules of tests before all of them, each process of xdist another one.

    Every process collects all tests. The first one that imports a module rewrites its assertions,
    which takes most of the time, and keeps the byte code for the others.
    """
    worker = getattr(config, "workerinput", None)
    if worker is None or sys.dont_write_bytecode or config.args != config.getini("testpaths"):
        return
    number, count = int(worker["workerid"].removeprefix("gw")), worker["workercount"]
    folder = Path(__file__).parent
    for path in sorted(folder.rglob("test_*.py"))[number::count]:
        with contextlib.suppress(Exception):  # which is told when it is collected
            importlib.import_module(".".join(path.relative_to(folder.parent).with_suffix("").parts))


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> Iterator[None]:
    """Say at the end which tests were not run for want of a program, and how to get it."""
    yield
    skipped = terminalreporter.stats.get("skipped", ())
    line = not_run(report.longrepr[2] for report in skipped)
    if line is not None:
        terminalreporter.write_line(line, yellow=True)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Give each file to one process, and all files of a folder that share something dear."""
    if config.getvalue("dist") != "loadfile":
        return None
    config.option.loadscopereorder = False  # the order is that of collecting
    scheduling = importlib.import_module("xdist.scheduler").LoadFileScheduling(config, log)
    scheduling._split_scope = _file_or_folder
    return scheduling


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Where several processes share the tests: files that take long first, then those of most."""
    if not hasattr(config, "workerinput"):
        return
    counts = Counter(_file_or_folder(item.nodeid) for item in items)
    long = {name: rank for rank, name in enumerate(LONG)}

    def rank(item: pytest.Item) -> tuple[int, int]:
        scope = _file_or_folder(item.nodeid)
        return long.get(scope, len(long)), -counts[scope]

    items.sort(key=rank)


def _file_or_folder(nodeid: str) -> str:
    return next((name for name in _TOGETHER if nodeid.startswith(name)), nodeid.partition("::")[0])
