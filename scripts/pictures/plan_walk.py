"""Draw the walk of one plan through the code: docs/pictures/plan_walk.svg.

    python scripts/pictures/plan_walk.py

A warm request to plan is made once in the server and once in a worker, and every call of a function
of this repository is counted. The picture names each file once, below its folder, with the place in
the order in which the files are first entered and the number of calls.
"""

import json
import sys
import tempfile
import threading
from collections import Counter
from pathlib import Path
from types import FrameType
from typing import Any
from xml.sax.saxutils import escape

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "client")]

import httpx  # noqa: E402
import uvicorn  # noqa: E402

from planning.values.deadline import Deadline  # noqa: E402
from service.app import create_app  # noqa: E402
from service.endpoints.plan import task  # noqa: E402
from service.settings import Settings  # noqa: E402
from service.storage.caches.cache_key import builtin_reference  # noqa: E402
from service.workers import current  # noqa: E402

PICTURE = ROOT / "docs/pictures/plan_walk.svg"
_POST = {
    "id": "post",
    "shape": {"type": "box", "size": [0.1, 0.1, 1.2]},
    "pose": {"position": [0.42, 0.28, 0.6]},
}
_BODY = {
    "robot": "panda",
    "scene": {"obstacles": [_POST]},
    "start": {"joints": [0, -0.785, 0, -2.356, 0, 1.571, 0.785]},
    "goal": {"joints": [1.2, -0.3, 0, -2, 0, 1.8, 0.785]},
}
#: Sizes of the picture [px]: a row, a column, a space between two folders.
_ROW, _COLUMN, _SPACE = 16, 320, 10
_COLORS = {"service": "#edf2fc", "planning": "#fff7e6", "obstacles": "#faeef0", "proof": "#f1edfb"}


class _Walk:
    """Counts the calls of each file while it is on.

    Args:
        calls: Calls by file, in the order in which the files are first entered.
    """

    def __init__(self) -> None:
        self.calls: Counter[str] = Counter()
        self.is_on = False

    def __call__(self, frame: FrameType, event: str, _argument: Any) -> None:
        name = frame.f_code.co_filename
        if self.is_on and event == "call" and name.startswith(str(ROOT)) and ".venv" not in name:
            path = Path(name).relative_to(ROOT)
            if path.parts[0] != "scripts":
                self.calls[str(path)] += 1


def _in_worker() -> _Walk:
    walk, body = _Walk(), json.dumps(_BODY).encode()
    for turn in range(4):
        current.begin(Deadline.after(60), None)
        walk.is_on = turn == 3
        sys.setprofile(walk if walk.is_on else None)
        try:
            task.plan(builtin_reference("panda"), None, body)
        finally:
            sys.setprofile(None)
            current.end()
    return walk


def _in_server() -> _Walk:
    walk = _Walk()
    app = create_app(Settings(data_dir=Path(tempfile.mkdtemp()), workers=1))
    server = uvicorn.Server(uvicorn.Config(app, port=0, log_level="warning"))
    threading.setprofile(walk)
    thread = threading.Thread(target=server.run)
    thread.start()
    while not server.started:
        pass
    port = server.servers[0].sockets[0].getsockname()[1]
    with httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=60) as client:
        while client.get("/readyz").status_code != 200:
            pass
        for turn in range(5):
            walk.is_on = turn == 4
            client.post("/v1/plan", json=_BODY).raise_for_status()
        walk.is_on = False
    server.should_exit = True
    thread.join()
    return walk


def _column(title: str, walk: _Walk, first: int) -> tuple[list[str], int]:
    """Boxes of one or two columns from column ``first`` on, and the height that they take [px]."""
    folders: dict[str, list[str]] = {}
    places = {name: place for place, name in enumerate(walk.calls, 1)}
    for name in walk.calls:
        folders.setdefault(str(Path(name).parent), []).append(name)
    moves = f"{len(places)} files, {sum(walk.calls.values())} calls"
    x, y, tallest = first * _COLUMN + 10, 44, 0
    half = sum((len(names) + 1) * _ROW + 2 * _SPACE for names in folders.values()) / _columns(walk)
    out = [f'<text x="{x}" y="24" class="t">{title}: {moves}</text>']
    for folder, names in folders.items():
        if y > half + 44:
            x, y = x + _COLUMN, 44
        height = (len(names) + 1) * _ROW + _SPACE
        kind = "proof" if "/proof" in folder else folder.split("/", maxsplit=1)[0]
        color = _COLORS.get(kind, "#eef9ef")
        out.append(
            f'<rect x="{x}" y="{y}" width="{_COLUMN - 20}" height="{height}" rx="5" fill="{color}"'
            ' stroke="#999"/>'
        )
        out.append(f'<text x="{x + 8}" y="{y + _ROW}" class="f">{escape(folder)}</text>')
        for row, name in enumerate(names, 2):
            text = f"{places[name]}. {Path(name).name}"
            out.append(f'<text x="{x + 14}" y="{y + row * _ROW}">{escape(text)}</text>')
            out.append(
                f'<text x="{x + _COLUMN - 30}" y="{y + row * _ROW}" text-anchor="end" class="n">'
                f"{walk.calls[name]}</text>"
            )
        y += height + _SPACE
        tallest = max(tallest, y)
    return out, tallest


def _columns(walk: _Walk) -> int:
    return 1 + (len(walk.calls) > 40)


def main() -> None:
    """Walk twice, and write the picture."""
    server, worker = _in_server(), _in_worker()
    left, left_height = _column("server", server, 0)
    right, right_height = _column("worker", worker, _columns(server))
    width = (_columns(server) + _columns(worker)) * _COLUMN
    PICTURE.write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" '
        f'height="{max(left_height, right_height)}" font-family="sans-serif" font-size="12">'
        "<style>.t{font-size:15px;font-weight:bold}.f{font-weight:bold}.n{fill:#666}</style>"
        '<rect width="100%" height="100%" fill="white"/>' + "\n".join(left + right) + "</svg>\n"
    )


if __name__ == "__main__":
    main()
