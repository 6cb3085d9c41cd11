"""The command ``armwright doctor``: what is installed, compiled and reachable."""

import os
import platform
from contextlib import closing
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

from rich.console import Console

from command_line.backends.backend import at
from command_line.output import print_answer, print_table
from command_line.parameters import Connection, command
from command_line.problems import CommandProblem, negative

if TYPE_CHECKING:
    from packaging.requirements import Requirement

#: Where Linux says which processor it runs on.
_PROCESSORS = Path("/proc/cpuinfo")
_OPTIONAL = (
    *("armwright-client", "httpx", "matplotlib", "viser"),
    *("mcp", "mujoco", "robot_descriptions", "xacrodoc"),
)


class Finding(NamedTuple):
    """One thing that the doctor looked at.

    Args:
        part: Part of the installation.
        state: "fault" where commands can't work, "warning" where they are slow or lack a part.
        detail: Finding in words.
        cure: Remedy; empty where none is needed.
    """

    part: str
    state: Literal["ok", "warning", "fault"]
    detail: str
    cure: str = ""


@command
def doctor(connection: Connection) -> None:
    """Show what is installed, compiled and reachable; exit with 1 where something is broken."""
    with Console(stderr=True).status("looking"):
        findings = [
            *_machine(),
            *_packages(),
            _kernels(),
            _data_folder(),
            *([] if connection.url is None else [_service(connection.url, connection.token)]),
        ]
    print_answer({"findings": [finding._asdict() for finding in findings]}, connection.as_json)
    print_table("Installation", Finding._fields, findings)
    if any(finding.state == "fault" for finding in findings):
        raise negative()


def _machine() -> list[Finding]:
    from compiled.compiler.target import usual  # noqa: PLC0415
    from service.version import VERSION  # noqa: PLC0415

    chosen = os.environ.get("ARMWRIGHT_KERNEL_TARGET", usual())
    cores = len(os.sched_getaffinity(0))
    lines = _PROCESSORS.read_text("utf-8").splitlines() if _PROCESSORS.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return [
        Finding("armwright", "ok", f"{VERSION} in {Path(__file__).parents[1]}"),
        Finding("python", "ok", f"{platform.python_version()} on {platform.platform()}"),
        Finding("processor", "ok", f"{(names or [platform.machine()])[0]}, {cores} cores"),
        Finding("kernel target", "ok", chosen),
    ]


def _packages() -> list[Finding]:
    """Findings on the packages that Armwright needs, and on the optional ones."""
    findings = []
    for requirement in _requirements():
        name, there = requirement.name, _version(requirement.name)
        if there is not None and requirement.specifier.contains(there, prereleases=True):
            findings.append(Finding(name, "ok", there))
        else:
            wanted = f"{there}, needed is {requirement.specifier}"
            detail = "not installed" if there is None else wanted
            findings.append(Finding(name, "fault", detail, f"pip install '{requirement}'"))
    for name in _OPTIONAL:
        there = _version(name)
        findings.append(
            Finding(name, "warning", "not installed (optional)", f"pip install {name}")
            if there is None
            else Finding(name, "ok", f"{there} (optional)")
        )
    return findings


def _requirements() -> "list[Requirement]":
    from packaging.requirements import Requirement  # noqa: PLC0415

    try:
        declared = [Requirement(text) for text in requires("armwright") or ()]
    except PackageNotFoundError:
        return []
    return [item for item in declared if item.marker is None or item.marker.evaluate({"extra": ""})]


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _kernels() -> Finding:
    from compiled.compiler import build, kernel_list, store  # noqa: PLC0415
    from service.warm_up.kernels import LIST  # noqa: PLC0415

    entries, outdated = kernel_list.read(LIST)
    missing = len(build.missing_entries(entries))
    folders = " and ".join(map(str, store.layers()))
    detail = f"{len(entries) - missing} of {len(entries)} compiled, in {folders}"
    if missing:
        return Finding("kernels", "warning", f"{detail}; {missing} missing", "armwright warm")
    if outdated:
        return Finding("kernels", "warning", f"{detail}; the list is out of date: {outdated[0]}")
    return Finding("kernels", "ok", detail)


def _data_folder() -> Finding:
    from service.settings import Settings  # noqa: PLC0415

    folder = Settings().data_dir.absolute()
    existing = next(path for path in (folder, *folder.parents) if path.exists())
    if not existing.is_dir() or not os.access(existing, os.W_OK):
        cure = "choose another one with ARMWRIGHT_DATA_DIR"
        return Finding("data folder", "fault", f"{folder} can't be written", cure)
    database = folder / "armwright.db"
    size = f"database of {database.stat().st_size} bytes" if database.is_file() else "empty"
    return Finding("data folder", "ok", f"{folder}: {size}")


def _service(url: str, token: str | None) -> Finding:
    try:
        with closing(at(url, token)) as backend:
            detail = backend.readiness()
    except CommandProblem as problem:
        return Finding("service", "fault", str(problem), str(problem.document["hint"] or ""))
    return Finding("service", "ok", f"{url}: {detail}")
