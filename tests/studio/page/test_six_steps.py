"""From a bare public arm to a proved pick and place in a real browser: six steps, and it plays."""

import pytest
from playwright.sync_api import Browser, expect

from armwright_client import Client
from benchmarks.arms import UPLOADS
from benchmarks.problems.example_arms import archive
from studio.page.studio_page import StudioPage, serve_page
from studio.state import TaskPlanned
from studio.workbench import Workbench
from tests.service.processes import wait_until
from tests.studio.page.mouse import blank, field, typed

#: Fine meshes are cut into convex pieces, and drawn in software.
pytestmark = pytest.mark.timeout(400)
PATIENCE = 120_000


def test_six_steps_with_the_mouse_and_the_keyboard(url: str, browser: Browser) -> None:
    with Client(url) as client, blank(browser) as page:
        studio = StudioPage(serve_page(0), Workbench(client, url, "panda"))
        workbench = studio.workbench
        try:
            page.set_default_timeout(PATIENCE)
            page.goto(f"http://127.0.0.1:{studio.server.get_port()}")

            page.get_by_role("tab", name="Robot").click()
            with page.expect_file_chooser() as chooser:
                page.get_by_role("button", name="Upload a URDF").click()
            content = archive(UPLOADS["UR10"][0])
            name = "walked.zip"
            file = {"name": name, "mimeType": "application/zip", "buffer": content}
            chooser.value.set_files(file)  # type: ignore[arg-type]
            expect(field(page, "Robot")).to_have_value("walked", timeout=PATIENCE)

            field(page, "Tool").click()
            page.get_by_role("option", name="parallel_jaw", exact=True).click()
            assert wait_until(lambda: workbench.state.tool == "parallel_jaw", 60.0)

            page.get_by_role("tab", name="Scene").click()
            page.get_by_role("button", name="box", exact=True).click()
            expect(page.get_by_text("box_1").filter(visible=True).last).to_be_visible(
                timeout=PATIENCE
            )

            page.get_by_role("tab", name="Goal").click()
            typed(page, "Position [m]", "0.5, -0.4, 0.3")
            typed(page, "Roll, pitch, yaw [rad]", "3.14159265, 0, 0")
            assert wait_until(lambda: [*workbench.goal_tip().position] == [0.5, -0.4, 0.3], 60.0)
            expect(page.get_by_text("configurations are valid")).to_be_visible(timeout=PATIENCE)

            page.get_by_role("tab", name="Task").click()
            page.get_by_role("button", name="both", exact=True).click()
            expect(page.locator("li", has_text="place")).to_be_visible(timeout=PATIENCE)
            page.get_by_role("button", name="Plan the task").click()
            done = page.get_by_text("12 stages planned").filter(visible=True)
            expect(done).to_be_in_viewport(timeout=PATIENCE)

            outcome = workbench.outcome
            assert isinstance(outcome, TaskPlanned), outcome
            assert all(stage.certificate.verified for stage in outcome.plan.stages)
            # All that is drawn, the jaws among it, and the button that plays it are in sight.
            assert {"parallel_jaw", "parallel_jaw/left"} <= {
                body.link for body in workbench.geometry("visual").bodies
            }
            play = page.get_by_role("button", name="Play", exact=True)
            expect(play).to_be_in_viewport(timeout=PATIENCE)
            play.click()
            expect(field(page, "Time [s]")).not_to_have_value("0", timeout=PATIENCE)
        finally:
            studio.close()
