"""Sizes: source lines of the product, modules, functions and folders."""

import ast
import io
import tokenize
import tomllib
from collections import defaultdict
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[1]
PRODUCT = (
    "armwright",
    "command_line",
    "compiled",
    "kinematics",
    "dynamics",
    "obstacles",
    "planning",
    "tracking",
    "service",
)
#: Folders whose source lines have a ceiling.
COUNTED = (*PRODUCT, "studio", "client")
FOLDERS = (
    *PRODUCT,
    "studio",
    "client/armwright_client",
    "client/armwright_wire",
    "tests",
    "benchmarks",
    "examples",
    "scripts",
)
MODULES = sorted(path for name in FOLDERS for path in (ROOT / name).rglob("*.py"))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]
#: Ceilings: they fall with each removal, and rise by a commit that says what for.
CEILINGS = PROJECT["armwright"]

#: Lines of a module, lines of a function with its docstring, arguments of a function.
MAX_MODULE_LINES = 600
MAX_FUNCTION_LINES = 100
MAX_ARGUMENTS = 8
#: Loose modules of a folder, without __init__.
MAX_LOOSE = 12
#: Source lines below which a module with one importer is part of that importer.
MIN_SOURCE_LINES = 60
#: Files that are exempt from lint rules in pyproject.toml.
MAX_EXEMPTIONS = 8
#: Kernels that are slower with tuples, see their modules: a call of ``plane_bound`` from Python
#: takes 2.2 us for 0.9 us, a stiff simulation 1.03 times as long; and a command of the shell,
#: whose options are its arguments.
MANY_ARGUMENTS = {
    "plane_bound": 9,
    "implicit_step": 9,
    "load_robot": 10,
    "retime": 9,
}
#: Folders with more loose modules than MAX_LOOSE that are still to be sorted.
CROWDED = {"planning/proof/collision"}

Definition = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
#: Fields of a tree that hold statements, or what holds statements.
_BLOCKS = ("body", "orelse", "finalbody", "handlers", "cases")
_NO_SOURCE = {
    tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT,
    tokenize.ENDMARKER,
}  # fmt: skip


class Function(NamedTuple):
    """A function or method.

    Attributes:
        line: First line in the module.
        name: Name of the function.
        length: Number of lines, with the docstring.
        arguments: Number of arguments, without `self` or `cls`.
    """

    line: int
    name: str
    length: int
    arguments: int


class Module(NamedTuple):
    """A module as the rules see it, so that its tree need not be stored or made again.

    Attributes:
        length: Number of lines.
        source: Number of lines without blank lines, comments and docstrings; 0 outside COUNTED.
        functions: Every function and method.
        imports: Dotted names that are imported from, and those with each imported name.
        is_value: Whether it defines nothing but classes and constants.
    """

    length: int
    source: int
    functions: list[Function]
    imports: frozenset[str]
    is_value: bool


@cache
def read(path: Path) -> Module:
    """A module that is parsed once for all rules."""
    text = path.read_text("utf-8")
    tree = ast.parse(text)
    found = list(definitions(tree))
    functions = [
        described(node)
        for node in found
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    ]
    is_counted = path.relative_to(ROOT).parts[0] in COUNTED
    return Module(
        len(text.splitlines()),
        source_lines(text, found) if is_counted else 0,
        functions,
        frozenset(imports(tree)),
        not any(isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) for node in tree.body),
    )


def source_lines(text: str, found: Iterable[Definition]) -> int:
    """Number of lines without blank lines, comments and docstrings."""
    docstrings: set[int] = set()
    for node in found:
        # The first statement, and those below the fields of a class.
        for below in node.body if isinstance(node, ast.ClassDef) else node.body[:1]:
            if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant):
                docstrings.update(range(below.lineno, (below.end_lineno or 0) + 1))
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in _NO_SOURCE:
            lines.update(range(token.start[0], token.end[0] + 1))
    return len(lines - docstrings)


def imports(tree: ast.Module) -> Iterator[str]:
    """Dotted names of modules that a module may import, wherever it does."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{name.name}" for name in node.names)
        elif isinstance(node, ast.Import):
            yield from (name.name for name in node.names)


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


def dotted(path: Path) -> str:
    """Name by which a module is imported."""
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removeprefix("client.")


def adapters() -> set[str]:
    """Modules that import-linter names as the only ones that may import something."""
    contracts = PROJECT["importlinter"]["contracts"]
    lines = [line for contract in contracts for line in contract.get("ignore_imports", ())]
    return {line.split(" -> ")[0] for line in lines}


def small_modules() -> list[str]:
    """Modules below MIN_SOURCE_LINES that one module of their package imports, and no other.

    Values, adapters and modules of a lower package stand alone.
    """
    paths = {
        dotted(path): path
        for path in MODULES
        if path.relative_to(ROOT).parts[0] in COUNTED and path.stem != "__init__"
    }
    importers: dict[str, set[str]] = defaultdict(set)
    for name in COUNTED:
        for path in (ROOT / name).rglob("*.py"):
            for imported in read(path).imports & paths.keys():
                importers[imported].add(dotted(path))
    exempt = adapters()
    return [
        f"{name} ({read(path).source} lines) of {min(importers[name])}"
        for name, path in paths.items()
        if len(importers[name]) == 1
        and min(importers[name]).split(".")[0] == name.split(".")[0]
        and read(path).source < MIN_SOURCE_LINES
        and not read(path).is_value
        and name not in exempt
    ]


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


def test_the_product_stays_below_its_ceiling() -> None:
    paths = [path for name in COUNTED for path in (ROOT / name).rglob("*.py")]
    count = sum(read(path).source for path in paths)
    assert count <= CEILINGS["source_lines"], f"{count} source lines in {len(paths)} modules"


def test_few_modules_are_too_small_to_stand_alone() -> None:
    small = small_modules()
    assert len(small) <= CEILINGS["small_modules"], "\n".join([str(len(small)), *small])


def test_folders_have_few_loose_modules() -> None:
    loose: dict[str, int] = defaultdict(int)
    for path in MODULES:
        folder = path.parent.relative_to(ROOT).as_posix()
        loose[folder] += path.stem != "__init__" and not folder.startswith("tests")
    crowded = {folder for folder, count in loose.items() if count > MAX_LOOSE}
    assert crowded <= CROWDED, f"more than {MAX_LOOSE} modules: {sorted(crowded - CROWDED)}"


def test_few_files_are_exempt_from_lint() -> None:
    assert len(PROJECT["ruff"]["lint"]["per-file-ignores"]) <= MAX_EXEMPTIONS
