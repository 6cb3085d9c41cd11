"""The pages about security and faults: every test that is named exists."""

import ast
import re
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]
PAGE = (TESTS.parent / "docs" / "security.md").read_text()
#: Files of tests that the page names, by the end of their paths.
NAMES = sorted(set(re.findall(r"`([\w/]*test_\w+\.py)`", PAGE)))
#: Rows of the tables of dangers: danger, defence, test.
ROWS = re.findall(r"^\| ([^|]+) \| ([^|]+) \| ([^|]+) \|$", PAGE, re.MULTILINE)
DANGERS = [row for row in ROWS if row[0] not in ("who", "danger") and "test_" in row[2]]


@pytest.mark.parametrize("name", NAMES)
def test_a_file_that_is_named_is_there_and_has_tests(name: str) -> None:
    files = [path for path in TESTS.rglob("test_*.py") if f"/{path}".endswith(f"/{name}")]
    assert len(files) == 1, f"{name}: name it so that there is one, not {files}"
    tests = [
        node
        for node in ast.parse(files[0].read_text()).body
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and node.name.startswith("test_")
    ]
    assert tests
    for test in tests:
        assert not any("skip" in ast.unparse(mark) for mark in test.decorator_list), test.name


def test_every_danger_has_a_test() -> None:
    headers = PAGE.count("| danger | defence | test |")
    whom = PAGE.partition("## Browsers")[0]
    assert headers >= 5
    assert len(DANGERS) == len(ROWS) - headers - len(re.findall(r"^\| (?!-)", whom, re.MULTILINE))
    assert len(DANGERS) >= 25


FAULTS = (TESTS.parent / "docs" / "faults.md").read_text()
FAULT_ROWS = [
    row
    for row in re.findall(r"^\| ([^|]+) \| ([^|]+) \| ([^|]+) \|$", FAULTS, re.MULTILINE)
    if row[0] != "fault"
]


@pytest.mark.parametrize("row", FAULT_ROWS, ids=lambda row: row[0])
def test_the_test_of_a_fault_is_there(row: tuple[str, str, str]) -> None:
    named = re.fullmatch(r"`([\w/]+\.py)::(test_\w+)`", row[2])
    assert named is not None, row
    tree = ast.parse((TESTS / named[1]).read_text())
    found = [
        node
        for node in tree.body
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.name == named[2]
    ]
    assert len(found) == 1, row[2]
    assert not any("skip" in ast.unparse(mark) for mark in found[0].decorator_list)


def test_there_are_as_many_rows_as_faults_that_were_measured() -> None:
    assert len(FAULT_ROWS) >= 35
    assert len({row[2] for row in FAULT_ROWS}) == len(FAULT_ROWS)
