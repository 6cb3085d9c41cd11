"""The page of worked examples: every test that it names exists, and its counts are right."""

import ast
import re
from functools import lru_cache
from pathlib import Path

FOLDER = Path(__file__).parent
ROOT = FOLDER.parents[1]
PAGE = (ROOT / "docs/course/examples.md").read_text("utf-8")
ROW = re.compile(r"^\| (\S+) \| (.+) \| (.+) \| (.+) \|$", re.MULTILINE)
ROWS = [row for row in ROW.findall(PAGE) if row[0] != "lecture"]


@lru_cache
def functions_of(file: str) -> set[str]:
    tree = ast.parse((FOLDER / file).read_text("utf-8"))
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_every_example_names_a_test_that_exists() -> None:
    for lecture, example, request, test in ROWS:
        if test == "–":
            assert request.startswith("no door: "), example
            continue
        file, _, name = test.strip("`").partition("::")
        assert name in functions_of(file), f"{lecture} {example}: {test}"


def test_every_endpoint_named_exists() -> None:
    from service.app import create_app

    known = {path.rpartition("/")[2] for path in create_app().openapi()["paths"]}
    known |= {"poses/convert", "robots"}
    for _, example, request, test in ROWS:
        assert test == "–" or request.strip("`") in known, f"{example}: {request}"


def test_the_counts_are_right() -> None:
    without = sum(test == "–" for *_, test in ROWS)
    assert f"{len(ROWS)} in all: {len(ROWS) - without} have a door, {without} have none" in PAGE


def test_every_lecture_with_examples_is_there() -> None:
    lectures = {lecture for lecture, *_ in ROWS}
    assert lectures == {str(i) for i in range(2, 35) if i != 8} | {"2024"}
