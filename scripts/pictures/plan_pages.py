"""Draw the pictures of the pages of kept plans: ``python -m scripts.pictures.plan_pages``."""

import tempfile
from pathlib import Path

from playwright.sync_api import ViewportSize

from service.app import create_app
from service.settings import Settings
from tests.service.server import serving
from tests.service.viewer.browser import browsing

PICTURES = Path(__file__).parents[2] / "docs" / "pictures"
#: Wide enough for both columns of a page, and no larger than a document shows it.
SIZE: ViewportSize = {"width": 1180, "height": 980}

#: The plan of the README: past a post.
PLAN = {
    "robot": "panda",
    "start": {"joints": [0.8, 0.3, 0.0, -1.8, 0.0, 2.1, 0.8]},
    "goal": {"joints": [-0.8, 0.3, 0.0, -1.8, 0.0, 2.1, 0.8]},
    "scene": {
        "obstacles": [
            {"id": "post", "shape": {"type": "box", "size": [0.1, 0.1, 1.0]},
             "pose": {"position": [0.5, 0.0, 0.5]}},
        ]
    },
}  # fmt: skip
#: A seam of two arcs over a bench; the tool may turn about its own axis and tilt.
SEAM = {
    "robot": "panda",
    "start": {"state": "home"},
    "planner": "cartesian",
    "planner_options": {
        "waypoints": [
            {"point": [0.45, -0.25, 0.3], "normal": [-0.3, 0.0, 1.0]},
            {"point": [0.6, 0.0, 0.35], "normal": [-0.3, 0.0, 1.0], "via": [0.57, -0.14, 0.34]},
            {"point": [0.45, 0.25, 0.3], "normal": [-0.3, 0.0, 1.0], "via": [0.57, 0.14, 0.34]},
        ],
        "tolerance": {"free": ["rz"], "tilt": 0.26},
        "tool_speed": 0.1,
    },
    "scene": {
        "obstacles": [
            {"id": "bench", "shape": {"type": "box", "size": [0.5, 0.8, 0.2]},
             "pose": {"position": [0.6, 0.0, 0.1]}},
        ]
    },
}  # fmt: skip

#: Request, name of the picture, share of the motion's time, and zoom.
PICTURED = ((PLAN, "view_plan", 0.4, 0.85), (SEAM, "seam", 0.7, 0.62))


def draw(folder: Path) -> None:
    """Draw them.

    Args:
        folder: For the database of the service.
    """
    with serving(create_app(Settings(data_dir=folder, workers=1))) as client, browsing() as browser:
        for request, name, share, zoom in PICTURED:
            answer = client.post("/v1/plan", json=request | {"keep": True})
            assert answer.status_code == 200, answer.text
            page = folder / f"{name}.html"
            page.write_bytes(client.get(f"/v1/plans/{answer.json()['plan_id']}/view").content)
            shown = browser.new_page(viewport=SIZE)
            shown.goto(page.as_uri())
            shown.evaluate(f"setTime({share} * motion.duration)")
            shown.select_option("#curve", index=1)
            shown.evaluate(f"view.zoom({zoom})")
            shown.wait_for_timeout(500)
            shown.screenshot(path=PICTURES / f"{name}.png")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        draw(Path(name))
