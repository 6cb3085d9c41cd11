"""The public names of the library."""

import ast
import json
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import armwright

ROOT = Path(__file__).parents[2]


def declared_for_type_checkers() -> dict[str, str]:
    """Names imported under ``TYPE_CHECKING``, with their modules."""
    tree = ast.parse((ROOT / "armwright/__init__.py").read_text())
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    return {
        alias.name: node.module or ""
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }


def test_every_public_name_is_the_one_of_its_module() -> None:
    for name, module in armwright._MODULES.items():
        assert getattr(armwright, name) is getattr(import_module(module), name), name


def test_the_three_lists_of_names_agree() -> None:
    assert sorted(armwright._MODULES) == armwright.__all__
    assert declared_for_type_checkers() == armwright._MODULES
    assert set(armwright.__all__) <= set(dir(armwright))


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
