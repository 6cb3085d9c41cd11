"""The public names of the library."""

import json
import subprocess
import sys
from pathlib import Path
from typing import cast

import armwright

ROOT = Path(__file__).parents[2]


def test_every_public_name_is_listed_and_shown() -> None:
    names = cast(list[str], armwright.__all__)  # type: ignore[attr-defined]
    assert {"fk", "ik", "plan", "witness", "Box", "Problem"} <= set(names)
    assert len(set(names)) == len(names)
    assert set(names) <= set(dir(armwright))


def test_names_of_arms_need_no_planning() -> None:
    program = "import sys, armwright as aw; aw.fk, aw.ik; assert 'planning' not in sys.modules"
    subprocess.run([sys.executable, "-c", program], cwd=ROOT, check=True)


def test_an_unknown_name_is_an_attribute_error() -> None:
    assert not hasattr(armwright, "plann")


def test_importing_the_library_imports_nothing_else() -> None:
    program = "import sys, json, armwright; print(json.dumps(sorted(sys.modules)))"
    answer = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, check=True, text=True
    )
    modules = set(json.loads(answer.stdout))
    assert not {"numpy", "numba", "kinematics", "planning", "fastapi"} & modules


def test_the_library_never_imports_the_service() -> None:
    program = (
        "import sys, armwright as aw\n"
        "for name in aw.__all__: getattr(aw, name)\n"
        "assert not [m for m in sys.modules if m.split('.')[0] in ('service', 'fastapi')]"
    )
    subprocess.run([sys.executable, "-c", program], cwd=ROOT, check=True, capture_output=True)
