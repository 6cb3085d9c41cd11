"""Draw the pictures of the studio: ``python -m scripts.pictures.studio``."""

import tempfile
from pathlib import Path

from playwright.sync_api import Page, ViewportSize, expect

from armwright_client import Box, Client, Obstacle, Pose
from service.app import create_app
from service.settings import Settings
from studio.page.studio_page import StudioPage, serve_page
from studio.stages import pick_stages, place_stages
from studio.workbench import Workbench
from tests.service.server import serving
from tests.service.viewer.browser import browsing

PICTURES = Path(__file__).parents[2] / "docs/pictures"
SIZE: ViewportSize = {"width": 1280, "height": 860}
#: Software WebGL draws some frames each second; meshes arrive over a socket [ms].
_SETTLE = 4000
#: On a busy machine a frame may take seconds [ms].
_PATIENCE = 120_000


def draw(folder: Path) -> None:
    """Draw them.

    Args:
        folder: For the database of the service.
    """
    app = create_app(Settings(data_dir=folder, workers=1))
    with serving(app) as http, Client(str(http.base_url)) as client, browsing() as browser:
        workbench = Workbench(client, str(http.base_url), "panda")
        workbench.add_obstacle("box")
        workbench.move_goal(Pose.from_rpy([0.45, -0.25, 0.45], 3.14, 0.0, 0.0))
        page = StudioPage(serve_page(0), workbench)
        try:
            shown = browser.new_page(viewport=SIZE)
            shown.set_default_timeout(_PATIENCE)
            shown.goto(f"http://127.0.0.1:{page.server.get_port()}")
            plan = shown.get_by_role("button", name="Plan", exact=True)
            plan.click()
            expect(shown.get_by_text("Planned by")).to_be_visible(timeout=_PATIENCE)
            _take(shown, "studio.png")
            workbench.change_obstacle(_moved(workbench.state.obstacles[0], 0.45, -0.25, 0.42))
            page.refresh()
            plan.click()
            expect(shown.get_by_text("In collision:")).to_be_visible(timeout=_PATIENCE)
            _take(shown, "studio_failure.png")
            _task(workbench, page)
            shown.get_by_role("tab", name="Task").click()
            shown.get_by_role("button", name="Plan the task").click()
            words = shown.get_by_text("stages planned").filter(visible=True)
            expect(words).to_be_visible(timeout=_PATIENCE)
            _take(shown, "studio_task.png")
        finally:
            page.close()


def _task(workbench: Workbench, page: StudioPage) -> None:
    """A pick of the box and a place on the other side."""
    small = Box(size=[0.04, 0.04, 0.04])
    box = _moved(workbench.state.obstacles[0], 0.45, 0.3, 0.3).model_copy(update={"shape": small})
    workbench.change_obstacle(box)
    place = Pose.from_rpy([0.45, -0.25, 0.3], 3.14159265, 0.0, 0.0)
    workbench.move_goal(place)
    workbench.set_entries(
        "stages", (*pick_stages(box, workbench.gripper_links()), *place_stages(box, place))
    )
    page.refresh()


def _moved(obstacle: Obstacle, x: float, y: float, z: float) -> Obstacle:
    return obstacle.model_copy(update={"pose": Pose.at(x, y, z)})


def _take(shown: Page, name: str) -> None:
    shown.wait_for_timeout(_SETTLE)
    shown.screenshot(path=PICTURES / name, timeout=_PATIENCE)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        draw(Path(name))
