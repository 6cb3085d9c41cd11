"""Packages that could not be audited do not pass for clean ones."""

import subprocess
import sys
from pathlib import Path

import pytest

from scripts.audit import verdict

CLEAN = {"name": "numpy", "version": "2.0", "vulns": []}
FAULTY = {
    "name": "old", "version": "1.0",
    "vulns": [{"id": "PYSEC-1", "fix_versions": ["1.1"], "aliases": [], "description": "bad"}],
}  # fmt: skip
MISSED = {"name": "h11", "skip_reason": "Dependency not found on PyPI and could not be audited"}


@pytest.mark.parametrize(
    ("packages", "code", "text"),
    [([CLEAN], 0, "1 packages without"), ([CLEAN, FAULTY], 1, "old 1.0: PYSEC-1, mended in 1.1"),
     ([CLEAN, MISSED], 2, "1 of 2 packages could not be audited (h11)"),
     ([FAULTY, MISSED], 1, "PYSEC-1"), ([MISSED] * 9, 2, "h11, ...)"), ([], 2, "nothing")],
)  # fmt: skip
def test_only_what_was_looked_up_is_clean(packages: list[object], code: int, text: str) -> None:
    found, said = verdict({"dependencies": packages})
    assert found == code
    assert text in said


def test_a_program_that_fails_is_no_clean_answer(tmp_path: Path) -> None:
    broken = tmp_path / "pip-audit"
    broken.write_text("#!/bin/sh\necho no route to host >&2\nexit 1\n")
    broken.chmod(0o755)
    done = subprocess.run(
        [sys.executable, "-m", "scripts.audit", str(broken)],
        cwd=Path(__file__).parents[1], capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert "no route to host" in done.stderr
    assert "no package could be audited" in done.stderr
