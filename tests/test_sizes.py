"""Sizes and names of modules and functions: what keeps the code readable."""

import ast
import re
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
FOLDERS = (*PRODUCT, "client/armwright_client", "tests", "benchmarks", "examples", "scripts")
MODULES = sorted(path for name in FOLDERS for path in (ROOT / name).rglob("*.py"))

#: Lines of a module, lines of a function with its docstring, arguments of a function.
MAX_MODULE_LINES = 400
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
#: Past participles that say what became of something and not what the function does.
PARTICIPLES = re.compile(
    r"^_*(sought|found|kept|held|made|told|given|known|planted|grown|unkept|ungrouped|together|"
    r"asked|taken|shown|seen|met|left|lost|spent|chosen|outlined|planned|started|begun|"
    r"driven|stacked|narrowed|carried|checked|evaluated|solved|timed|exceeded|overloaded|"
    r"reached|wished|answered|described|slowed|ended|tightened|calmed|stretched|missing|"
    r"watched|repeated|handled|built|malformed|validated|numbered|refused|unpacked|zipped|"
    r"damped|registered|filtered|applied|fitted|needed|blocked|refining)$"
)

#: First words of docstrings that do not say what a thing is.
_VAGUE = re.compile(r"(What|The same\b|Of both|Likewise)")
_QUESTIONS = re.compile(r"(What|The same\b|Of\b|Likewise|How|Where\b|When\b|Which)")
OPENINGS = {
    package: _VAGUE if package in ("kinematics", "obstacles") else _QUESTIONS
    for package in (*PRODUCT, "client")
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
        docstrings: Those of the module, its classes and functions, by name.
    """

    length: int
    functions: list[Function]
    docstrings: list[tuple[str, str]]


@cache
def read(path: Path) -> Module:
    """A module that is parsed once for all rules."""
    text = path.read_text("utf-8")
    functions, docstrings = [], []
    for node in definitions(ast.parse(text)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            functions.append(described(node))
        docstrings.append((getattr(node, "name", "module"), ast.get_docstring(node) or ""))
    return Module(len(text.splitlines()), functions, docstrings)


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


@pytest.mark.parametrize("package", [name.split("/")[0] for name in FOLDERS])
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


@pytest.mark.parametrize("package", [*PRODUCT, "client"])
def test_functions_are_not_named_by_participles(package: str) -> None:
    wrong = [
        f"{path.relative_to(ROOT)}:{function.line} {function.name}"
        for path in MODULES
        if path.relative_to(ROOT).parts[0] == package
        for function in read(path).functions
        if PARTICIPLES.match(function.name)
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("package", [*PRODUCT, "client"])
def test_docstrings_begin_with_what_the_thing_is(package: str) -> None:
    wrong = []
    for path in MODULES:
        if path.relative_to(ROOT).parts[0] != package:
            continue
        wrong += [
            f"{path.relative_to(ROOT)} {name}: {text.splitlines()[0]}"
            for name, text in read(path).docstrings
            if OPENINGS[package].match(text)
        ]
    assert not wrong, "\n".join(wrong)
