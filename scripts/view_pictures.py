"""Draw the pictures of the pages of kept plans: ``python -m scripts.view_pictures``."""

import tempfile
from pathlib import Path

from playwright.sync_api import ViewportSize

from service.app import create_app
from service.settings import Settings
from tests.service.robots import DETOUR
from tests.service.server import serving
from tests.service.viewer.browser import browsing

PICTURES = Path(__file__).parents[1] / "docs" / "pictures"
#: Wide enough for both columns of a page, and no larger than a document shows it.
SIZE: ViewportSize = {"width": 1180, "height": 980}


def draw(folder: Path) -> None:
    """Draw them.

    Args:
        folder: For the database of the service.
    """
    with serving(create_app(Settings(data_dir=folder, workers=1))) as client, browsing() as browser:
        plan = client.post("/v1/plan", json=DETOUR | {"keep": True}).json()
        page = folder / "view.html"
        page.write_bytes(client.get(f"/v1/plans/{plan['plan_id']}/view").content)
        shown = browser.new_page(viewport=SIZE)
        shown.goto(page.as_uri())
        shown.check("#show-ghosts")
        shown.evaluate("setTime(0.4 * motion.duration)")
        shown.select_option("#curve", index=1)
        shown.evaluate("view.zoom(0.62)")
        shown.wait_for_timeout(500)
        shown.screenshot(path=PICTURES / "view_plan.png")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        draw(Path(name))
