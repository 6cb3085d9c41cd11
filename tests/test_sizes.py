"""Sizes of modules and functions."""

import ast
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[1]
PRODUCT = (
    "armwright",
    "command_line",
    "kinematics",
    "dynamics",
    "obstacles",
    "planning",
    "tracking",
    "service",
)
FOLDERS = (
    *PRODUCT,
    "client/armwright_client",
    "client/armwright_wire",
    "tests",
    "benchmarks",
    "examples",
    "scripts",
)
MODULES = sorted(path for name in FOLDERS for path in (ROOT / name).rglob("*.py"))

#: Lines of a module, lines of a function with its docstring, arguments of a function.
MAX_MODULE_LINES = 600
MAX_FUNCTION_LINES = 100
MAX_ARGUMENTS = 8
#: Files that are exempt from lint rules in pyproject.toml.
MAX_EXEMPTIONS = 8
#: Kernels that are slower with tuples, see their modules: a call of ``plane_bound`` from Python
#: takes 2.2 us for 0.9 us, deviations of a tool 1.03 times as long, a stiff simulation likewise.
MANY_ARGUMENTS = {
    "plane_bound": 9,
    "deviation_kernel": 10,
    "cell_kernel": 9,
    "tip_motion_kernel": 9,
    "implicit_step": 9,
    "load_robot": 9,
}

Definition = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
#: Fields of a tree that hold statements, or what holds statements.
_BLOCKS = ("body", "orelse", "finalbody", "handlers", "cases")


class Function(NamedTuple):
    """A function or method.

    Attributes:
        line: Of the module, where it begins.
        name: Its name.
        length: Lines, with its docstring.
        arguments: How many, without `self` or `cls`.
    """

    line: int
    name: str
    length: int
    arguments: int


class Module(NamedTuple):
    """A module as the rules look at it, so that its tree need not be kept or made again.

    Attributes:
        length: Lines.
        functions: Every function and method.
    """

    length: int
    functions: list[Function]


@cache
def read(path: Path) -> Module:
    """A module that is parsed once for all rules."""
    text = path.read_text("utf-8")
    functions = [
        described(node)
        for node in definitions(ast.parse(text))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    ]
    return Module(len(text.splitlines()), functions)


def definitions(tree: ast.Module) -> Iterator[Definition]:
    """A module, and all its classes and functions: statements alone, for these hold no others."""
    waiting: list[ast.AST] = [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, Definition):
            yield node
        for field in _BLOCKS:
            waiting += getattr(node, field, ())


def described(node: ast.FunctionDef | ast.AsyncFunctionDef) -> Function:
    """A function of a tree."""
    arguments = node.args
    count = sum(map(len, (arguments.posonlyargs, arguments.args, arguments.kwonlyargs)))
    count -= bool(arguments.args and arguments.args[0].arg in ("self", "cls"))
    return Function(node.lineno, node.name, (node.end_lineno or 0) - node.lineno + 1, count)


@pytest.mark.parametrize("package", sorted({name.split("/")[0] for name in FOLDERS}))
def test_modules_and_functions_stay_short(package: str) -> None:
    wrong = []
    for path in MODULES:
        name = path.relative_to(ROOT)
        if name.parts[0] != package:
            continue
        module = read(path)
        if module.length > MAX_MODULE_LINES:
            wrong.append(f"{name}: {module.length} lines")
        for function in module.functions:
            where = f"{name}:{function.line} {function.name}"
            if function.length > MAX_FUNCTION_LINES:
                wrong.append(f"{where}: {function.length} lines")
            if function.arguments > MANY_ARGUMENTS.get(function.name, MAX_ARGUMENTS):
                wrong.append(f"{where}: {function.arguments} arguments")
    assert not wrong, "\n".join(wrong)


def test_few_files_are_exempt_from_lint() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    assert len(project["tool"]["ruff"]["lint"]["per-file-ignores"]) <= MAX_EXEMPTIONS
