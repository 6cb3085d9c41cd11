"""Other packages with the names of Armwright's."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def run(folder: Path, program: str) -> subprocess.CompletedProcess[str]:
    """Run a program that begins in ``folder``, which comes first on its path."""
    path = os.pathsep.join([str(folder), str(ROOT)])
    return subprocess.run(
        [sys.executable, "-c", program],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        check=False,
        text=True,
    )


def test_the_error_names_the_package_that_shadows_ours(tmp_path: Path) -> None:
    (tmp_path / "planning").mkdir()
    (tmp_path / "planning" / "__init__.py").write_text("")
    answer = run(tmp_path, "import armwright as aw; aw.plan")
    assert answer.returncode != 0
    assert "ImportError" in answer.stderr
    assert f"the package 'planning' at {tmp_path / 'planning'} shadows Armwright's" in answer.stderr


def test_a_module_file_of_the_same_name_is_named_too(tmp_path: Path) -> None:
    (tmp_path / "kinematics.py").write_text("")
    answer = run(tmp_path, "import armwright as aw; aw.Scene")
    assert f"{tmp_path / 'kinematics.py'} shadows" in answer.stderr


def test_a_folder_without_modules_shadows_nothing(tmp_path: Path) -> None:
    (tmp_path / "planning").mkdir()
    answer = run(tmp_path, "import armwright as aw; print(aw.Options().planner)")
    assert answer.stdout.strip() == "auto", answer.stderr
