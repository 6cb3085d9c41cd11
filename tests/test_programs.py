"""Tests that need a program which is not installed: skipped and counted, or an error in CI."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.programs import not_run
from tests.service.postgresql import postgresql
from tests.service.viewer.browser import program

ROOT = Path(__file__).parents[1]


def run(folder: Path, **settings: str) -> tuple[int, str]:
    """Exit code and output of tests that need a program."""
    (folder / "test_needs.py").write_text(
        "from tests.programs import missing\n"
        "def test_a(): missing('Chromium', 'apt-get install chromium')\n"
        "def test_b(): missing('PostgreSQL', 'apt-get install postgresql')\n"
        "def test_c(): missing('PostgreSQL', 'apt-get install postgresql')\n"
    )
    others = {name: text for name, text in os.environ.items() if name != "ARMWRIGHT_TEST_ALL"}
    ran = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "tests.conftest", "-p", "no:cacheprovider", folder],
        cwd=ROOT, env=others | settings, capture_output=True, check=False, text=True,
    )  # fmt: skip
    return ran.returncode, ran.stdout


def test_without_the_programs_tests_pass_and_a_line_says_what_was_not_run(tmp_path: Path) -> None:
    code, output = run(tmp_path)
    assert code == 0, output
    assert (
        "Not run: 1 for want of Chromium (apt-get install chromium), "
        "2 for want of PostgreSQL (apt-get install postgresql). "
        "ARMWRIGHT_TEST_ALL=1 makes this an error.\n"
    ) in output


def test_ci_takes_a_missing_program_for_an_error(tmp_path: Path) -> None:
    code, output = run(tmp_path, ARMWRIGHT_TEST_ALL="1")
    assert code == 1, output
    assert "3 failed" in output
    assert "export ARMWRIGHT_TEST_ALL=1" in (ROOT / ".ci/run").read_text("utf-8")


@pytest.mark.parametrize("start", [program, lambda: postgresql().__enter__()])
def test_tests_of_pages_and_of_postgresql_are_skipped_where_the_program_is_missing(
    monkeypatch: pytest.MonkeyPatch, start: Callable[[], object]
) -> None:
    monkeypatch.delenv("ARMWRIGHT_TEST_ALL", raising=False)
    monkeypatch.setattr(shutil, "which", lambda _: None)
    monkeypatch.setattr(Path, "glob", lambda _, __: iter(()))
    with pytest.raises(pytest.skip.Exception, match="needs"):
        start()


@pytest.mark.parametrize("reasons", [[], ["Skipped: another reason"]])
def test_other_skips_are_not_counted(reasons: list[str]) -> None:
    assert not_run(reasons) is None
