"""The page about faults: every row names a test that is there."""

import ast
import re
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]
PAGE = (TESTS.parent / "docs" / "faults.md").read_text()
ROWS = [
    row
    for row in re.findall(r"^\| ([^|]+) \| ([^|]+) \| ([^|]+) \|$", PAGE, re.MULTILINE)
    if row[0] != "fault"
]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0])
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
    assert len(ROWS) >= 35
    assert len({row[2] for row in ROWS}) == len(ROWS)
