"""The house rules that no other tool checks: pins, versions, layers, entry points, addresses."""

import importlib
import json
import os
import re
import subprocess
import sys
import tomllib
from importlib.metadata import requires
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

from tests.conftest import LONG
from tests.test_sizes import PRODUCT as PACKAGES

ROOT = Path(__file__).parents[1]
CONFIGURATION = (
    "pyproject.toml",
    "client/pyproject.toml",
    "constraints.txt",
    "Makefile",
    "Dockerfile",
    "compose.yaml",
    ".dockerignore",
    ".gitignore",
    ".ci/run",
)
SUPPORTED = ("3.11", "3.12", "3.13")


def load(path: str) -> dict[str, Any]:
    return tomllib.loads((ROOT / path).read_text())


APP = load("pyproject.toml")
CLIENT = load("client/pyproject.toml")


def pins() -> dict[str, Version]:
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pairs = [line.split("==") for line in lines]
    return {canonicalize_name(name): Version(version) for name, version in pairs}


def declared() -> list[Requirement]:
    project = APP["project"]
    # JupyterLab is a program of its user, with a hundred packages of its own.
    groups = project["optional-dependencies"].items()
    extras = [text for name, group in groups if name != "notebook" for text in group]
    texts = [*project["dependencies"], *extras, *CLIENT["project"]["dependencies"]]
    # Client and checker are of this repository.
    return [Requirement(text) for text in texts if not text.startswith("armwright-")]


def test_constraints_are_plain_pins_in_order() -> None:
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    for line in lines:
        assert re.fullmatch(r"[A-Za-z0-9._-]+==[0-9][A-Za-z0-9.]*", line), line
    assert len(pins()) == len(lines), "a package is pinned twice"


@pytest.mark.parametrize("requirement", declared(), ids=str)
def test_declared_dependencies_are_bounded_and_pinned_within(requirement: Requirement) -> None:
    operators = {specifier.operator for specifier in requirement.specifier}
    assert operators == {">=", "<"}
    assert pins()[canonicalize_name(requirement.name)] in requirement.specifier


@pytest.mark.parametrize("python", SUPPORTED)
def test_pins_cover_all_that_is_needed_on(python: str) -> None:
    """Walk the requirements of what is installed here as another Python would."""
    environment = {"python_version": python, "python_full_version": f"{python}.0"}
    known = pins()
    waiting = [(requirement, "") for requirement in declared()]
    seen: set[tuple[str, str]] = set()
    while waiting:
        requirement, extra = waiting.pop()
        if requirement.marker and not requirement.marker.evaluate({**environment, "extra": extra}):
            continue
        name = canonicalize_name(requirement.name)
        assert name in known, f"{requirement} is needed and not pinned"
        assert known[name] in requirement.specifier, f"{requirement} against {known[name]}"
        for wanted in ("", *requirement.extras):
            if (name, wanted) in seen:
                continue
            seen.add((name, wanted))
            waiting.extend((Requirement(text), wanted) for text in requires(name) or ())


def test_versions_and_pythons_agree() -> None:
    client = importlib.import_module("armwright_client")
    service = importlib.import_module("service.version")
    assert APP["tool"]["setuptools"]["dynamic"]["version"] == {"attr": "service.version.VERSION"}
    assert service.VERSION == CLIENT["project"]["version"] == client.__version__
    assert f"armwright-client=={service.VERSION}" in APP["project"]["dependencies"]
    assert APP["project"]["requires-python"] == CLIENT["project"]["requires-python"]
    named = [text.rsplit(" ", 1)[1] for text in APP["project"]["classifiers"] if ":: 3." in text]
    assert tuple(named) == SUPPORTED


@pytest.mark.parametrize("path", CONFIGURATION)
def test_configuration_has_no_addresses_and_no_paths_of_one_machine(path: str) -> None:
    text = (ROOT / path).read_text()
    own = re.sub(r"https?://(127\.0\.0\.1|localhost)", "", text)
    assert not re.search(r"\w+://", own)
    assert not re.search(r"index-url|find-links|trusted-host|/home/|/root/|file:", text)


def test_layers_stand_in_order() -> None:
    contracts = {contract["id"]: contract for contract in APP["tool"]["importlinter"]["contracts"]}
    assert contracts["layers"]["layers"] == [
        "command_line",
        "studio",
        "service | armwright",
        "planning | tracking",
        "dynamics | obstacles",
        "kinematics",
        "compiled",
    ]
    forbidden = {name for c in contracts.values() for name in c.get("forbidden_modules", ())}
    assert forbidden >= {"fcl", "ompl", "toppra", "ruckig", "trimesh", "casadi", "numba"}
    assert forbidden >= {"fastapi", "pydantic", "uvicorn", "defusedxml", "xml"}


@pytest.mark.parametrize("name", PACKAGES)
def test_packages_are_typed_described_and_shipped(name: str) -> None:
    assert (ROOT / name / "py.typed").is_file()
    assert (importlib.import_module(name).__doc__ or "").rstrip().endswith(".")
    assert f"{name}*" in APP["tool"]["setuptools"]["packages"]["find"]["include"]


@pytest.mark.parametrize("folder", [*PACKAGES, "tests", "benchmarks"])
def test_every_folder_with_modules_is_a_package(folder: str) -> None:
    for module in (ROOT / folder).rglob("*.py"):
        assert (module.parent / "__init__.py").is_file(), module


def test_every_file_of_data_is_shipped() -> None:
    patterns = APP["tool"]["setuptools"]["package-data"]["*"]
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*"):
            ours = path.is_file() and "__pycache__" not in path.parts and path.suffix != ".py"
            assert not ours or any(path.match(pattern) for pattern in patterns), path


def test_targets_of_the_makefile() -> None:
    wanted = ["install", "demo", "studio", "test", "check", "bench", "bench-timing", "bench-arms"]
    wanted += ["bench-verdict", "bench-mbm", "bench-course", "serve", "clients", "site", "wheels"]
    wanted += ["kernel-list", "docker-steps", "audit", "contract", "clean", "help"]
    dry = ["make", "-n", "PROBLEMS=problems", *wanted]
    # Run by make, make would say more: that it enters a folder, and what it was told.
    plain = {name: value for name, value in os.environ.items() if not name.startswith("MAKE")}
    subprocess.run(dry, cwd=ROOT, env=plain, capture_output=True, check=True)
    shown = subprocess.run(
        ["make", "help"], cwd=ROOT, env=plain, capture_output=True, check=True, text=True
    )
    assert [line.split()[1] for line in shown.stdout.splitlines()] == wanted


def test_files_that_begin_first_are_there() -> None:
    assert [name for name in LONG if not (ROOT / name).is_file()] == []


def test_ci_runs_what_people_run() -> None:
    script = ROOT / ".ci" / "run"
    assert os.access(script, os.X_OK)
    text = script.read_text()
    assert "set -euo pipefail" in text
    assert "make check test" in text


def test_containers_copy_every_package_and_nothing_secret() -> None:
    copied = re.findall(r"^COPY (\w+) \./\1$", (ROOT / "Dockerfile").read_text(), re.MULTILINE)
    assert sorted(copied) == sorted([*PACKAGES, "client"])
    ignored = (ROOT / ".dockerignore").read_text().splitlines()
    assert ignored[0] == "*"
    assert {f"!{name}" for name in PACKAGES} <= set(ignored)


def test_importing_a_package_does_no_work() -> None:
    """A package name costs nothing: no solver, no compiler, no web framework comes along."""
    program = f"import sys, json, {', '.join(PACKAGES)}; print(json.dumps(sorted(sys.modules)))"
    answer = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, check=True, text=True
    )
    assert not {"numba", "casadi", "ompl", "fastapi"} & set(json.loads(answer.stdout))
