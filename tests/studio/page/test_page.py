"""The studio in a real browser: it draws, answers, plans, plays, and asks no other host."""

from collections.abc import Iterator
from urllib.parse import urlsplit

import httpx
import pytest
from playwright.sync_api import Browser, Page, expect
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from armwright_client import Client
from studio.page.local_server import is_own, serve_page
from studio.page.studio_page import StudioPage
from studio.workbench import Workbench
from tests.service.processes import wait_until
from tests.service.viewer.browser import browsing


@pytest.fixture(scope="module")
def studio(url: str) -> Iterator[StudioPage]:
    with Client(url) as client:
        page = StudioPage(serve_page(0), Workbench(client, url, "panda"))
        yield page
        page.close()


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with browsing() as opened:
        yield opened


def address(studio: StudioPage) -> str:
    return f"127.0.0.1:{studio.server.get_port()}"


def colours(page: Page) -> int:
    """Different colours in a picture of the page's canvas, coarsely."""
    from io import BytesIO

    import numpy as np
    from PIL import Image

    picture = Image.open(BytesIO(page.locator("canvas").first.screenshot()))
    return len(np.unique(np.asarray(picture.convert("RGB")).reshape(-1, 3) // 16, axis=0))


def test_from_a_moved_goal_to_a_motion_that_plays(studio: StudioPage, browser: Browser) -> None:
    page = browser.new_page(viewport={"width": 800, "height": 420})
    faults, hosts = [], set()
    page.on("console", lambda m: faults.append(m.text) if m.type == "error" else None)
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on("request", lambda request: hosts.add(urlsplit(request.url).netloc))
    page.goto(f"http://{address(studio)}")
    expect(page.get_by_role("button", name="Plan", exact=True)).to_be_visible(timeout=20_000)
    assert wait_until(lambda: colours(page) > 8, 10.0)

    page.get_by_role("tab", name="Goal").click()
    height = studio.workbench.goal_tip().position[2]
    field = page.get_by_role("textbox").nth(2)
    field.fill(f"{height - 0.05:.3f}")
    field.press("Enter")
    assert wait_until(lambda: studio.workbench.state.goal_pose is not None, 10.0)
    expect(page.get_by_text("configurations are valid")).to_be_visible()
    assert studio.workbench.branches

    page.get_by_role("tab", name="Plan").click()
    page.get_by_role("button", name="Plan", exact=True).click()
    expect(page.get_by_text("Planned by")).to_be_visible(timeout=20_000)
    shown = page.get_by_text("0.00 of")
    expect(shown).to_be_visible()
    page.get_by_role("button", name="Play", exact=True).click()
    expect(shown).not_to_be_visible()
    assert not faults
    assert hosts <= {address(studio), ""}
    page.close()


def test_foreign_pages_are_refused(studio: StudioPage) -> None:
    where = address(studio)
    assert httpx.get(f"http://{where}/").status_code == 200
    evil = {"Origin": "http://evil.example"}
    assert httpx.get(f"http://{where}/", headers=evil).status_code == 403
    assert httpx.get(f"http://{where}/", headers={"Host": "evil.example:80"}).status_code == 403
    with pytest.raises(InvalidStatus, match="403"):
        connect(f"ws://{where}/", origin="http://evil.example").close()  # type: ignore[arg-type]


def test_own_pages_are_those_of_this_machine() -> None:
    assert is_own("127.0.0.1:8080", [])
    assert is_own("localhost:8080", ["http://localhost:8080"])
    assert not is_own(None, [])
    assert not is_own("127.0.0.1:8080", ["http://127.0.0.1:9090"])
    assert not is_own("127.0.0.1:8080", ["null"])
    assert not is_own("evil.example:8080", ["http://evil.example:8080"])
