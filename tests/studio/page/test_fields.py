"""Fields of the studio in a real browser: numbers as they are typed, lists, play and curves."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, expect
from scipy.spatial.transform import Rotation

from armwright_client import Box, Client, FramedPose
from studio.page.studio_page import StudioPage, serve_page
from studio.pose import rotation
from studio.state import Failure
from studio.workbench import Workbench
from tests.service.processes import wait_until
from tests.studio.page.mouse import blank, field, typed


@pytest.fixture(scope="module")
def studio(url: str) -> Iterator[StudioPage]:
    with Client(url) as client:
        page = StudioPage(serve_page(0), Workbench(client, url, "panda"))
        yield page
        page.close()


@pytest.fixture(scope="module")
def page(studio: StudioPage, browser: Browser) -> Iterator[Page]:
    with blank(browser) as page:
        page.goto(f"http://127.0.0.1:{studio.server.get_port()}")
        yield page


def test_numbers_are_taken_as_they_are_typed(studio: StudioPage, page: Page) -> None:
    workbench = studio.workbench
    page.get_by_role("tab", name="Goal").click()
    typed(page, "Position [m]", "0.412345678, -0.35, 0.30")
    goal = [0.412345678, -0.35, 0.3]
    assert wait_until(lambda: [*workbench.goal_tip().position] == goal, 20.0)
    assert studio.queue.join(20.0)
    expect(field(page, "Position [m]")).to_have_value("0.412345678, -0.35, 0.30")
    field(page, "Units").click()
    page.get_by_role("option", name="mm, degrees").click()
    expect(field(page, "Position [mm]")).to_have_value("412.345678, -350, 300")
    typed(page, "Roll, pitch, yaw [°]", "180, 0, -90.5")
    turned = Rotation.from_euler("xyz", [180.0, 0.0, -90.5], degrees=True)
    field(page, "Units").click()
    page.get_by_role("option", name="m, rad").click()
    assert wait_until(
        lambda: bool((rotation(workbench.goal_tip()) * turned.inv()).magnitude() < 1e-9), 20.0
    )


def test_obstacles_are_placed_by_numbers_and_their_lists_stay_open(
    studio: StudioPage, page: Page
) -> None:
    workbench = studio.workbench
    workbench.add_obstacle("box")
    studio.refresh()
    page.get_by_role("tab", name="Scene").click()
    page.get_by_text("box_1").filter(visible=True).last.click()
    typed(page, "x [m]", "0.205")
    typed(page, "Position [m]", "0.5, -0.4, 0.25")
    assert wait_until(
        lambda: [*workbench.state.obstacles[0].pose.position] == [0.5, -0.4, 0.25], 20.0
    )
    shape = workbench.state.obstacles[0].shape
    assert isinstance(shape, Box)
    assert shape.size[0] == 0.205
    expect(field(page, "x [m]")).to_be_visible()


def test_joints_are_typed_with_all_digits(studio: StudioPage, page: Page) -> None:
    workbench = studio.workbench
    page.get_by_role("tab", name="Robot").click()
    joints = [0.123456789, -0.7, 0.0, -2.3, 0.0, 1.6, 0.8]
    typed(page, "All [rad]", ", ".join(map(str, joints)))
    assert wait_until(lambda: [*workbench.state.start] == joints, 20.0)
    assert studio.queue.join(20.0)


def test_a_failure_speaks_of_the_form_and_leaves_with_its_cause(
    studio: StudioPage, page: Page
) -> None:
    workbench = studio.workbench
    tip = workbench.goal_tip()
    workbench.change_obstacle(
        workbench.state.obstacles[0].model_copy(update={"pose": FramedPose(**tip.model_dump())})
    )
    studio.refresh()
    page.get_by_role("tab", name="Plan").click()
    page.get_by_role("button", name="Plan", exact=True).click()
    told = page.get_by_text("is in collision").filter(visible=True)
    expect(told.first).to_be_visible(timeout=20_000)
    outcome = workbench.outcome
    assert isinstance(outcome, Failure)
    assert "Move the goal" in outcome.hint
    assert not set("`_") & set(outcome.hint)
    page.get_by_role("button", name="undo", exact=True).click()
    expect(page.get_by_text("Set start and goal, then plan.")).to_be_visible(timeout=20_000)
    expect(told).to_have_count(0)


def test_play_and_curves_are_in_sight(studio: StudioPage, page: Page) -> None:
    workbench = studio.workbench
    workbench.set_goal_joints([q + 0.2 for q in workbench.state.start])
    studio.refresh()
    page.get_by_role("tab", name="Plan").click()
    field(page, "Curves").click()
    page.get_by_role("option", name="velocities [1/s]").click()
    page.get_by_role("button", name="Plan", exact=True).click()
    for seen in (page.get_by_role("button", name="Play", exact=True), page.locator(".uplot")):
        expect(seen.first).to_be_in_viewport(timeout=20_000)
