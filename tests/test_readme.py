"""Claims of the README: its example, commands, pictures, tables and numbers."""

import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import get_args

import pytest

from armwright_wire.motions.simulation import Controller
from armwright_wire.plans.tour import MAX_GOALS
from kinematics.robots import builtin_names
from planning.exports.options import ExportFormat
from planning.values.optimize_options import OBJECTIVES
from service.version import VERSION
from tests.command_line.commands import Run, runner
from tests.service.commands import serve

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
#: One line of the table of features.
ROWS = dict(re.findall(r"^\| \[(\w[^\]]*)\]\([^|]* \| (.*) \|$", README, re.MULTILINE))
COUNTS = {"five": 5, "ten": 10}


def test_example_prints_what_the_readme_says(tmp_path: Path) -> None:
    example = re.search(r"```python\n(.*?)```", README, re.DOTALL)
    printed = re.search(r"prints\n\n```\n(.*?)```", README, re.DOTALL)
    assert example is not None
    assert printed is not None
    # A busy machine may take longer over the first plan of a worker than users wait.
    settings = {"ARMWRIGHT_DEFAULT_TIMEOUT": "60", "ARMWRIGHT_WORKERS": "1"}
    with serve(tmp_path, environment=settings) as (_, client):
        code = example[1].replace("http://127.0.0.1:8000", str(client.base_url))
        answer = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=90.0
        )
    assert (answer.stdout, answer.stderr) == (printed[1], "")


def test_the_first_screen_has_a_picture_and_names_the_commands() -> None:
    first = README[: README.index("```python")]
    (picture,) = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", first)
    assert (ROOT / picture).is_file()
    assert re.findall(r"^make (\w+) ", first, re.MULTILINE) == ["demo", "serve", "studio", "test"]
    targets = re.findall(r"^(\w[\w-]*):.*##", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE)
    assert set(re.findall(r"`?make ([a-z-]+)`? ", README)) <= set(targets)


def test_every_feature_is_one_line_with_a_page() -> None:
    assert len(ROWS) == 21
    assert all(len(re.sub(r"\]\([^)]*\)", "]", text)) <= 140 for text in ROWS.values())
    for page in re.findall(r"\]\((docs/[^)#]+)", README):
        assert (ROOT / page).is_file(), page


def test_numbers_and_names_of_the_table_are_those_of_the_code() -> None:
    count, kind = re.findall(r"(ten) (built-in arms)", ROWS["Robots"])[0]
    assert (COUNTS[count], kind) == (len(builtin_names()), "built-in arms")
    assert f"up to {MAX_GOALS} goals" in ROWS["Tasks"]
    assert ROWS["Tracking"].startswith("five controllers")
    assert len(get_args(get_args(Controller)[0])) == COUNTS["five"]
    exported = {"ROS 2": "joint_trajectory", "CSV": "csv", "URScript": "urscript", "RAPID": "rapid"}
    exported |= {"KRL": "krl", "EGM": "egm", "RSI": "rsi"}
    for name, begin in exported.items():
        assert name in ROWS["Timing"]
        assert any(file.value.startswith(begin) for file in ExportFormat), name
    for objective in OBJECTIVES:
        assert {"path_length": "length"}.get(objective, objective) in ROWS["Optimisation"]


def test_what_is_needed_is_what_is_declared() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    pythons = [text.split()[-1] for text in project["classifiers"] if ":: 3." in text]
    assert f"Python {', '.join(pythons[:-1])} or {pythons[-1]}" in README
    client = tomllib.loads((ROOT / "client/pyproject.toml").read_text("utf-8"))["project"]
    needed = [re.match(r"\w+", text) for text in client["dependencies"]]
    assert [name[0] for name in needed if name] == ["httpx", "pydantic"]
    assert "the client alone, with `httpx` and `pydantic`" in README
    assert client["version"] == VERSION


def test_the_command_of_the_readme_plans(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ARMWRIGHT_DATA_DIR", str(tmp_path / "data"))
    monkeypatch.setattr("command_line.backends.local.cache_folder", lambda: tmp_path / "cache")
    monkeypatch.delenv("ARMWRIGHT_URL", raising=False)
    found = re.search(r"`armwright (plan[^`]*)`", README)
    assert found is not None
    run: Run = runner(capsys)
    answer = run(*shlex.split(found[1]))
    assert answer.code == 0, answer
