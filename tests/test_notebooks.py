"""The notebooks: they run from top to bottom, and print and draw what is stored in them."""

import json
from pathlib import Path
from typing import Any

import pytest

from scripts.notebooks import FOLDER, run

NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))


def shown(notebook: dict[str, Any]) -> list[list[str]]:
    """Texts that each cell prints, and the kinds of what it draws."""
    return [
        ["".join(output.get("text", sorted(output.get("data", {})))) for output in cell["outputs"]]
        for cell in notebook["cells"]
        if cell["cell_type"] == "code"
    ]


@pytest.mark.timeout(300)
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_prints_what_is_stored(path: Path) -> None:
    notebook = json.loads(path.read_text("utf-8"))
    again = run(notebook)
    assert shown(again) == shown(notebook)
    assert any(any(outputs) for outputs in shown(notebook))
    assert notebook["cells"][0]["cell_type"] == "markdown"


def test_there_are_seven() -> None:
    assert [path.stem for path in NOTEBOOKS] == [
        "control", "first_plan", "identified_arm", "kinematics", "obstacles", "taught_path",
        "tool_paths",
    ]  # fmt: skip


def test_a_cell_that_fails_is_no_output() -> None:
    cell = {"cell_type": "code", "source": "1 / 0", "outputs": []}
    with pytest.raises(ZeroDivisionError):
        run({"cells": [cell]})


def test_names_are_kept_from_cell_to_cell() -> None:
    cells = [{"cell_type": "code", "source": text} for text in ("a = 2", "print(a + 1)")]
    assert shown(run({"cells": cells})) == [[], ["3\n"]]
