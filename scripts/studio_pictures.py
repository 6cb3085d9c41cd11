"""Draw the picture of the studio: ``python -m scripts.studio_pictures``."""

import tempfile
from pathlib import Path

from playwright.sync_api import ViewportSize, expect

from armwright_client import Client, Pose
from service.app import create_app
from service.settings import Settings
from studio.page.local_server import serve_page
from studio.page.studio_page import StudioPage
from studio.workbench import Workbench
from tests.service.server import serving
from tests.service.viewer.browser import browsing

PICTURE = Path(__file__).parents[1] / "docs/pictures/studio.png"
SIZE: ViewportSize = {"width": 1280, "height": 860}
#: Software WebGL draws some frames each second; meshes arrive over a socket [ms].
_SETTLE = 4000


def draw(folder: Path) -> None:
    """Draw it.

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
            shown.goto(f"http://127.0.0.1:{page.server.get_port()}")
            button = shown.get_by_role("button", name="Plan", exact=True)
            button.click()
            expect(shown.get_by_text("Planned by")).to_be_visible(timeout=20_000)
            shown.wait_for_timeout(_SETTLE)
            shown.screenshot(path=PICTURE)
        finally:
            page.close()


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        draw(Path(name))
