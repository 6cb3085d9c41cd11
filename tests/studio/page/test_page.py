"""The studio in a real browser: it draws, answers, plans, plays, and asks no other host."""

from collections.abc import Iterator
from typing import NamedTuple
from urllib.parse import urlsplit

import httpx
import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from armwright_client import Box, Client, Pose
from studio.page.studio_page import StudioPage, is_own, serve_page
from studio.pose import rotation
from studio.state import TaskPlanned
from studio.workbench import Workbench
from tests.service.processes import wait_until
from tests.studio.page.mouse import UNDRAWN, drag, field, pixel


@pytest.fixture(scope="module")
def studio(url: str) -> Iterator[StudioPage]:
    with Client(url) as client:
        page = StudioPage(serve_page(0), Workbench(client, url, "scara"))
        yield page
        page.close()


def address(studio: StudioPage) -> str:
    return f"127.0.0.1:{studio.server.get_port()}"


def colours(page: Page) -> int:
    """Different colours in a picture of the page's canvas, coarsely."""
    from io import BytesIO

    from PIL import Image

    picture = Image.open(BytesIO(page.locator("canvas").first.screenshot()))
    return len(np.unique(np.asarray(picture.convert("RGB")).reshape(-1, 3) // 16, axis=0))


class Shown(NamedTuple):
    """The page in a browser, what went wrong in it, and whom it asked."""

    page: Page
    faults: list[str]
    hosts: set[str]


@pytest.fixture(scope="module")
def shown(studio: StudioPage, browser: Browser) -> Iterator[Shown]:
    with browser.new_page(viewport={"width": 900, "height": 320}) as page:
        seen = Shown(page, [], set())
        page.on("console", lambda m: seen.faults.append(m.text) if m.type == "error" else None)
        page.on("pageerror", lambda error: seen.faults.append(str(error)))
        page.on("request", lambda request: seen.hosts.add(urlsplit(request.url).netloc))
        page.goto(f"http://{address(studio)}")
        yield seen


def test_from_a_dragged_goal_to_a_motion_that_plays(studio: StudioPage, shown: Shown) -> None:
    page = shown.page
    expect(page.get_by_role("button", name="Plan", exact=True)).to_be_visible(timeout=20_000)
    assert wait_until(lambda: colours(page) > 8, 10.0)
    page.evaluate(UNDRAWN)

    # The mouse takes the goal's frame at the arrow along its x, and drags it by 8 cm.
    (client,) = studio.server.get_clients().values()
    goal = studio.workbench.goal_tip()
    x = rotation(goal).as_matrix()[:, 0]
    held, let_go = (np.array(goal.position) + along * x for along in (0.15, 0.23))
    way = 0.08 * x

    def arrived() -> bool:
        at = np.array(studio.workbench.goal_tip().position)
        return bool(np.linalg.norm(at - goal.position - way) < 0.01)

    begin, end = (pixel(page, client.camera, point) for point in (held, let_go))
    assert drag(page, begin, end, arrived), studio.workbench.goal_tip()
    turned = rotation(studio.workbench.goal_tip()).as_matrix()[:, 0]
    np.testing.assert_allclose(turned, x, atol=1e-6)
    assert studio.queue.join(20.0)
    page.get_by_role("tab", name="Goal").click()
    expect(page.get_by_text("configurations are valid")).to_be_visible()
    assert studio.workbench.branches

    page.get_by_role("tab", name="Plan").click()
    page.get_by_role("button", name="Plan", exact=True).click()
    expect(page.get_by_text("Planned by")).to_be_visible(timeout=20_000)
    clock = field(page, "Time [s]")
    expect(clock).to_have_value("0")
    page.get_by_role("button", name="Play", exact=True).click()
    expect(clock).not_to_have_value("0")
    assert not shown.faults
    assert shown.hosts <= {address(studio), ""}


def test_stages_are_added_and_planned_in_the_page(studio: StudioPage, shown: Shown) -> None:
    page = shown.page
    page.get_by_role("tab", name="Task").click()
    page.get_by_role("button", name="Add stage", exact=True).click()
    expect(page.locator("li", has_text="move")).to_be_visible()
    page.get_by_role("button", name="Take the goal's frame").click()
    assert wait_until(lambda: "goal" in (*studio.workbench.state.stages, {})[0], 10.0)
    page.get_by_role("button", name="Plan the task").click()
    expect(page.get_by_text("1 stages planned").filter(visible=True)).to_be_visible(timeout=20_000)
    outcome = studio.workbench.outcome
    assert isinstance(outcome, TaskPlanned)
    end = outcome.plan.stages[0].trajectory.sample([outcome.plan.duration])[0]
    tip = studio.workbench.link_poses(end)[studio.workbench.model.tip_link]
    np.testing.assert_allclose(tip.position, studio.workbench.goal_tip().position, atol=1e-4)
    assert not shown.faults


def test_waypoints_are_added_in_the_page(studio: StudioPage, shown: Shown) -> None:
    page = shown.page
    page.get_by_role("tab", name="Paths").click()
    page.get_by_role("button", name="Plan the tool path").click()
    told = page.get_by_text("two waypoints or more").filter(visible=True)
    expect(told).to_be_visible(timeout=20_000)
    page.get_by_role("button", name="Add waypoint", exact=True).click()
    added = page.locator("li", has_text="waypoint").filter(visible=True)
    expect(added).to_be_visible(timeout=20_000)
    (waypoint,) = studio.workbench.state.waypoints
    place = waypoint["pose"]["position"]
    np.testing.assert_allclose(place, studio.workbench.goal_tip().position, atol=1e-6)
    assert not shown.faults


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


def test_the_mouse_scales_an_obstacle_by_its_corner(studio: StudioPage, shown: Shown) -> None:
    page, workbench = shown.page, studio.workbench
    page.get_by_role("tab", name="Scene").click()
    box = workbench.add_obstacle("box")
    before = box.model_copy(
        update={"shape": Box(size=[0.2, 0.2, 0.2]), "pose": Pose.at(0.1, 0.5, 0.2)}
    )
    workbench.change_obstacle(before)
    studio.refresh()
    page.get_by_text("Size handles").click()
    (client,) = studio.server.get_clients().values()
    # The handle is at the corner, its arrow along z is as long as it is large: 0.1 m.
    x, y, z = 0.2, 0.6, 0.3
    begin, end = (pixel(page, client.camera, (x, y, z + along)) for along in (0.075, 0.135))

    def shape() -> list[float]:
        (item,) = [item for item in workbench.state.obstacles if item.id == box.id]
        assert isinstance(item.shape, Box)
        return list(item.shape.size)

    assert drag(page, begin, end, lambda: shape()[2] > 0.25), shape()
    assert studio.queue.join(20.0)
    # The middle stays, so that the size grows by twice the way of the corner.
    np.testing.assert_allclose(shape(), [0.2, 0.2, 0.32], atol=0.03)
    assert shape()[:2] == pytest.approx([0.2, 0.2])
    assert not shown.faults
