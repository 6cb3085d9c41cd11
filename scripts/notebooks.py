"""Run the notebooks of docs/notebooks and write what they print and draw into them.

    python scripts/notebooks.py

Each runs from top to bottom in this process, as Jupyter would run it, without Jupyter.
"""

import base64
import contextlib
import io
import json
import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))
FOLDER = ROOT / "docs/notebooks"
#: Resolution of pictures [1/inch].
_DOTS = 80


def run(notebook: dict[str, Any]) -> dict[str, Any]:
    """A notebook with the outputs of its cells, run in their order.

    Args:
        notebook: As its file has it; it stays as it is.

    Raises:
        Exception: Whatever a cell raises.
    """
    names: dict[str, Any] = {"__name__": "__main__"}
    cells = []
    count = 0
    for cell in notebook["cells"]:
        if cell["cell_type"] != "code":
            cells.append(cell)
            continue
        count += 1
        outputs = _outputs("".join(cell["source"]), names)
        cells.append(cell | {"execution_count": count, "outputs": outputs})
    return notebook | {"cells": cells}


def _outputs(source: str, names: dict[str, Any]) -> list[dict[str, Any]]:
    """Text and pictures of one cell, run with the names of those before it."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        exec(compile(source, "notebook", "exec"), names)
    text = said.getvalue()
    outputs: list[dict[str, Any]] = []
    if text:
        outputs.append({"output_type": "stream", "name": "stdout", "text": text})
    outputs += [_picture(number) for number in plt.get_fignums()]
    plt.close("all")
    return outputs


def _picture(number: int) -> dict[str, Any]:
    content = io.BytesIO()
    plt.figure(number).savefig(content, format="png", dpi=_DOTS)
    encoded = base64.b64encode(content.getvalue()).decode()
    return {
        "output_type": "display_data",
        "metadata": {},
        "data": {"image/png": encoded},
    }


def main() -> None:
    """Run all and write them."""
    for path in sorted(FOLDER.glob("*.ipynb")):
        done = run(json.loads(path.read_text("utf-8")))
        path.write_text(json.dumps(done, indent=1, ensure_ascii=False) + "\n", "utf-8")
        print(path.name)


if __name__ == "__main__":
    main()
