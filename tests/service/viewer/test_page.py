"""Pages of kept plans in a real browser, from disk: they draw, move, and ask no host."""

import base64
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser

import armwright as aw
from armwright_wire.plans.task import TaskRequest
from kinematics.forward import forward
from kinematics.pose import from_rpy, transform
from service.viewer.page import page as page_of
from tests.planning.sequence import test_gripper as jaws
from tests.service.conftest import Served
from tests.service.robots import (
    ASIDE,
    DETOUR,
    FLOOR,
    HOME,
    LOOKS,
    POST,
    bench,
    scene,
    urdf,
)
from tests.service.viewer.pages import colours, document, fetch, show, wait


@pytest.fixture(autouse=True)
def _no_page_stays(browser: Browser) -> Iterator[None]:
    """Close what a test has opened: each page is a process that goes on."""
    yield
    for context in browser.contexts:
        context.close()


def test_a_motion_is_drawn_played_and_scrubbed(
    browser: Browser, plan: bytes, tmp_path: Path
) -> None:
    page, events = show(browser, plan, tmp_path)
    assert colours(page) > 20
    assert "proved" in page.inner_text("#words")
    duration = document(plan)["motion"]["breaks"][-1]
    page.focus("#time")
    page.evaluate("""() => { const time = document.getElementById("time"); time.value = "500";
        time.dispatchEvent(new Event("input")); }""")
    wait(page, "!window.armwrightView.changed")
    assert page.evaluate("window.armwrightView.time") == pytest.approx(duration / 2)
    assert f"{duration / 2:.3f} of" in page.inner_text("#clock")
    before = page.inner_text("#now")
    page.select_option("#speed", "0.1")  # so that it does not end meanwhile
    page.focus("#view")
    page.keyboard.press("Space")
    wait(page, f"window.armwrightView.time > {duration / 2 + 0.002}")
    page.keyboard.press("Space")
    assert page.inner_text("#play") == "Play"
    assert page.inner_text("#now") != before
    assert len(events) == 1


def test_keys_move_time_and_view(browser: Browser, plan: bytes, tmp_path: Path) -> None:
    page, _ = show(browser, plan, tmp_path)
    page.focus("#plot")
    page.keyboard.press("End")
    wait(page, "window.armwrightView.time === motion.duration")
    page.focus("#view")
    yaw = page.evaluate("view.yaw")
    page.keyboard.press("ArrowLeft")
    assert page.evaluate("view.yaw") == pytest.approx(yaw + 0.1)


def test_curves_have_limits_and_differ_without_colour(
    browser: Browser, plan: bytes, tmp_path: Path
) -> None:
    page, _ = show(browser, plan, tmp_path)
    names = page.evaluate("curves.map((curve) => curve.name)")
    assert names == [
        *(f"{name} of joints" for name in ("position", "velocity", "acceleration", "jerk")),
        "torque of joints", "tool speed", "clearance",
    ]  # fmt: skip
    patterns = page.evaluate(
        """() => [...document.querySelectorAll("#legend line")].map(
            (line) => line.getAttribute("stroke-dasharray"))"""
    )
    assert len(set(patterns)) == len(patterns) == 7
    page.select_option("#curve", label="clearance [m]")
    wait(page, "!window.armwrightView.changed")
    assert "closest pair" in page.inner_text("#legend")


def test_the_page_moves_the_arm_as_the_library_does(
    browser: Browser, plan: bytes, tmp_path: Path
) -> None:
    page, _ = show(browser, plan, tmp_path)
    chain = aw.load_robot("panda").chain
    for joints in (HOME, [0.3, -0.4, 0.5, -1.6, 0.7, 1.8, -0.9]):
        drawn = page.evaluate("(q) => arm.tip(q)", joints)
        assert pytest.approx(forward(chain, joints), abs=1e-12) == np.reshape(drawn, (4, 4)).T
    rows = document(plan)["motion"]
    local, piece = 0.4 * rows["breaks"][1], np.array(rows["coefficients"][0])
    for order in range(4):
        expected = [np.polynomial.Polynomial(row).deriv(order)(local) for row in piece]
        drawn = page.evaluate("([t, d]) => motion.at(t, d)", [local, order])
        assert drawn == pytest.approx(expected, abs=1e-9)


def test_a_failure_shows_the_candidates_and_why(
    browser: Browser, failure: bytes, tmp_path: Path
) -> None:
    content = failure
    page, _ = show(browser, content, tmp_path)
    shown = page.inner_text("#list")
    assert "0. • asked for: start" in shown
    assert "1. ✗ collides: goal, IK solution 0" in shown
    assert "'post'" in shown
    assert "GOAL_IN_COLLISION" in page.inner_text("#words")
    chosen = document(content)["configurations"][1]
    assert chosen["cause"] == "collision"
    assert "post" in chosen["pair"]
    assert chosen["near"]["distance"] < 0.0
    assert colours(page) > 20
    labels = page.locator("#labels span").all_inner_texts()
    assert set(chosen["pair"]) <= set(labels)
    assert {"• 0", "✗ 1"} <= set(labels)
    assert "overlap" in page.inner_text("#now")
    # The label of the chosen configuration is where its tip is seen.
    places = page.evaluate("""() => { const box = document.querySelector("#labels .chosen");
        return [parseFloat(box.style.left), parseFloat(box.style.top),
                ...view.project(Matrix.origin(tips[state.chosen])).map((v) => 100 * v)]; }""")
    assert places[:2] == pytest.approx(places[2:], abs=0.01)
    # Start and goal are free of each other: a line joins the nearest points.
    page.locator("#list button").first.click()
    wait(page, "!window.armwrightView.changed")
    start = document(content)["configurations"][0]
    assert start["near"]["distance"] > 0.0
    assert f"{1000.0 * start['near']['distance']:.1f} mm" in page.inner_text("#now")


def test_checks_and_inverse_kinematics_have_pages(
    served: Served, browser: Browser, tmp_path: Path
) -> None:
    place = scene(POST, FLOOR)
    hit = [a + 0.65 * (b - a) for a, b in zip(HOME, ASIDE, strict=True)]
    body = {"robot": "panda", "scene": place, "joints": [HOME, hit, [9.0, *HOME[1:]]]}
    page, _ = show(browser, fetch(served.client, "/v1/check", body), tmp_path)
    shown = page.inner_text("#list")
    assert "0. ✓ valid: configuration 0" in shown
    assert "1. ✗ collides: configuration 1" in shown
    assert "2. ⊘ outside limits: configuration 2" in shown
    solve = {"pose": {"position": [0.42, 0.28, 0.2], "rpy": [3.14, 0, 0]}, "all_solutions": True}
    content = fetch(served.client, "/v1/robots/ur5e/ik", solve | {"scene": place})
    page, _ = show(browser, content, tmp_path)
    assert len(document(content)["configurations"]) == page.locator("#list button").count() > 1


def test_a_task_plays_stage_by_stage_with_fingers_and_what_they_hold(
    browser: Browser, task: bytes, tmp_path: Path
) -> None:
    page, events = show(browser, task, tmp_path)
    data = document(task)
    names = ["open", "move", "approach", "grasp", "close", "attach", "lift"]
    listed = page.inner_text("#list").splitlines()
    assert [line.split(",")[0] for line in listed] == [
        f"{number}: {name}" for number, name in enumerate(names)
    ]
    place = "(t) => placed(arm.frames(motion.at(t)), t)"
    duration, lift = data["motion"]["breaks"][-1], data["stages"][-1]["begins"]
    end, begin = (page.evaluate(place, t) for t in (duration, lift))
    assert page.evaluate(place, 0.0)["crate"][12:15] == pytest.approx([0.5, -0.25, 0.15])
    assert begin["crate"][12:15] == pytest.approx([0.5, -0.25, 0.15], abs=1e-5)
    assert end["crate"][14] > 0.19
    # The fingers open in the first second, then close on the crate, and go up with it.
    closed = np.subtract(end["finger claw_left_plate"], end["finger claw_right_plate"])
    wide = page.evaluate(place, data["stages"][1]["begins"])
    opened = np.subtract(wide["finger claw_left_plate"], wide["finger claw_right_plate"])
    assert np.linalg.norm(opened[12:15]) == pytest.approx(0.11)
    assert np.linalg.norm(closed[12:15]) == pytest.approx(0.05)
    page.locator("#list button").last.click()
    wait(page, "!window.armwrightView.changed")
    assert page.evaluate("window.armwrightView.time") == pytest.approx(lift)
    assert page.locator("#list button[aria-current=step]").inner_text() == listed[-1]
    assert "6: lift" in page.inner_text("#now")
    assert colours(page) > 20
    assert len(events) == 1


def test_text_of_a_request_can_not_leave_its_place() -> None:
    nasty = "</script><script>alert(1)</script><!--"
    content = page_of({"title": nasty, "words": nasty})
    assert content.count(b"<script") == 2
    assert content.count(b"</script>") == 2
    assert b"&lt;/script&gt;" in content


def test_the_tree_of_a_planner_is_drawn_on_request(
    served: Served, browser: Browser, tmp_path: Path
) -> None:
    bounds = {"planner": "rrt", "planner_options": {"max_edges": 40}, "timeout": 1.5, "keep": True}
    problem = served.client.post("/v1/plan", json=DETOUR | bounds).json()
    assert problem["code"] == "PLANNING_FAILED"
    view = f"/v1/plans/{problem['details']['plan_id']}/view"
    assert document(served.client.get(view).content)["tree"] is None
    content = served.client.get(view, params={"tree": True}).content
    tree = document(content)["tree"]
    assert tree["planner"] == "rrt"
    assert 5 < tree["edges"] <= 40
    points = np.frombuffer(base64.b64decode(tree["parts"][0]["points"]), "<f4").reshape(-1, 4, 3)
    assert len(points) == tree["edges"]
    # The tree hangs together, and begins where the tool is at the start.
    root = forward(aw.load_robot("panda").chain, HOME)[:3, 3]
    known = [root]
    for edge in points:
        assert min(np.linalg.norm(edge[0] - q) for q in known) < 1e-6
        known.append(edge[-1])
    page, _ = show(browser, content, tmp_path)
    assert f"rrt explored {tree['edges']} edges" in page.inner_text("#words")
    strokes = "trees.map((tree) => tree.count)"
    assert page.evaluate(strokes) == [6 * tree["edges"]]
    green = """(() => { view.begin(); draw(); const gl = view.gl;
      const size = 4 * gl.drawingBufferWidth * gl.drawingBufferHeight, all = new Uint8Array(size);
      gl.readPixels(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight, gl.RGBA,
                    gl.UNSIGNED_BYTE, all);
      let count = 0;
      for (let i = 0; i < size; i += 4) count += all[i + 1] > 1.6 * Math.max(all[i], all[i + 2]);
      return count; })()"""
    assert page.evaluate(green) > 50
    page.uncheck("#show-tree")
    assert page.evaluate(green) == 0
    check = {"robot": "panda", "joints": HOME, "keep": True}
    kept = served.client.post("/v1/check", json=check).json()["plan_id"]
    refused = served.client.get(f"/v1/plans/{kept}/view", params={"tree": True})
    assert refused.status_code == 422
    assert "have no tree" in refused.json()["detail"]


def test_links_are_drawn_as_they_look_or_as_they_collide(
    served: Served, browser: Browser, tmp_path: Path
) -> None:
    robot = bench("looks", urdf=urdf(extra=LOOKS))
    assert served.client.post("/v1/robots", json=robot).status_code == 201
    moves = {"robot": "looks", "start": {"joints": [0.0, 0.0]}, "goal": {"joints": [0.5, -0.5]}}
    content = fetch(served.client, "/v1/plan", moves)
    drawn = [(item["name"], item["kind"], item["color"]) for item in document(content)["bodies"]]
    assert drawn == [
        ("lower", "link", None),
        ("upper", "link", None),
        ("eye", "visual", [1.0, 0.5, 0.0]),
        ("eye", "visual", [0.0, 0.0, 1.0]),
    ]
    page, _ = show(browser, content, tmp_path)
    # The blue ball of what the robot looks like; collision geometry has its switch.
    blue = """(() => { draw(); const gl = view.gl;
      const size = 4 * gl.drawingBufferWidth * gl.drawingBufferHeight, all = new Uint8Array(size);
      gl.readPixels(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight, gl.RGBA,
                    gl.UNSIGNED_BYTE, all);
      let count = 0;
      for (let i = 0; i < size; i += 4) count += all[i + 2] > 100 && all[i] < 20;
      return count; })()"""
    assert page.evaluate(blue) > 100
    page.uncheck("#show-visuals")
    assert page.evaluate(blue) == 0


def test_a_task_of_the_library_plays_likewise(browser: Browser, tmp_path: Path) -> None:
    """``aw.view`` of a task."""
    grasp = transform(from_rpy([np.pi, 0.0, 0.0]), [0.0, 0.0, 0.02])
    task = aw.plan_task(aw.Task(jaws.world(), jaws.HOME, jaws.stages(grasp[None])), jaws.TIME)
    assert isinstance(task, aw.SequencePlan), task
    content = aw.view(task).html.encode()
    page, events = show(browser, content, tmp_path)
    names = ["move", "approach", "grasp", "close", "attach", "lift"]
    listed = [line.split(",")[0] for line in page.inner_text("#list").splitlines()]
    assert listed == [f"{number}: {name}" for number, name in enumerate(names)]
    sentences = document(content)["sentences"]
    assert sentences[0].endswith("stages proved: 6 of 6.")
    assert "the robot holds crate" in sentences[-1]
    assert len(events) == 1
    with pytest.raises(aw.ArmwrightError, match="each stage of a task"):
        aw.view(task, jaws.JAW)


def test_failed_tasks_and_tours_show_what_was_tried(
    served: Served, browser: Browser, tmp_path: Path
) -> None:
    example: Any = TaskRequest.model_json_schema()["examples"][0]
    size = {"type": "box", "size": [0.5, 0.5, 0.02]}
    lid = {"id": "lid", "shape": size, "pose": {"position": [0.5, -0.25, 0.3]}}
    far = {"pose": {"position": [3.0, 0.0, 0.5]}}
    obstacles = [*example["scene"]["obstacles"], lid]
    blocked = example | {"scene": {"obstacles": obstacles}}
    content = fetch(served.client, "/v1/tasks", blocked)
    data = document(content)
    tried = data["configurations"][1:-1]
    assert data["configurations"][-1]["label"] == "goal of stage 12"
    assert len(tried) == 18
    for number, item in enumerate(tried):
        assert item["label"] == f"stage 2, choice {number}"
        assert (item["verdict"], item["cause"]) == ("rejected", "collision")
        first, second = item["pair"]
        assert item["reason"] == f"'{first}' and '{second}' collide"
    # The check of the service finds the same, there.
    joints = [item["joints"] for item in tried]
    body = {"robot": "panda", "scene": blocked["scene"], "joints": joints}
    found = served.client.post("/v1/check", json=body).json()["collisions"]
    for item, hits in zip(tried, found, strict=True):
        assert set(item["pair"]) in [set(hit["pair"]) for hit in hits]
    page, _ = show(browser, content, tmp_path)
    assert "1. \u2717 collides: stage 2, choice 0." in page.inner_text("#list")
    assert any("1 to 18" in text or "2 to 18" in text for text in
               page.locator("#labels span").all_inner_texts())  # fmt: skip
    moves = {"stages": [{"kind": "move", "goal": far}]}
    words = document(fetch(served.client, "/v1/tasks", example | moves))["sentences"]
    assert "Stage 0, choice 0: out_of_reach." in words
    within = {"id": "lid", "pose": {"position": [0.5, -0.25, 0.3], "rpy": [3.14, 0.0, 0.0]}}
    tour = {
        "robot": "panda",
        "scene": blocked["scene"],
        "goals": [within, {"joints": ASIDE}],
        "start": example["start"],
    }
    shown = document(fetch(served.client, "/v1/tours", tour))["configurations"]
    assert shown[0]["label"] == "start"
    assert shown[-1]["label"] == "goal 1"
    candidates = shown[1:-1]
    assert len(candidates) == 6
    assert all(item["label"].startswith("goal lid, IK solution") for item in candidates)
    assert {item["cause"] for item in candidates} == {"collision"}


def test_a_witness_is_checked_in_the_browser(browser: Browser, plan: bytes, tmp_path: Path) -> None:
    """By the checker in C, in a few milliseconds; a false one is not believed."""
    page, _ = show(browser, plan, tmp_path)
    wait(page, "document.getElementById('checked').dataset.codes !== undefined")
    assert page.get_attribute("#checked", "data-codes") == "0"
    told = page.inner_text("#checked")
    assert told.startswith("Checked here, in your browser, in ")
    assert "apart by" in told
    assert int(told.split(" ms")[0].split()[-1]) <= 250
    shown = document(plan)
    file = bytearray(base64.b64decode(shown["witnesses"][0]))
    for changed, why in ((file[:-9], "ends early"), (b"no witness", "no witness")):
        false = shown | {"witnesses": [base64.b64encode(changed).decode()]}
        page, _ = show(browser, page_of(false), tmp_path)
        wait(page, "document.getElementById('checked').dataset.codes !== undefined")
        assert page.inner_text("#checked").startswith("✗ Your browser can't follow the proof")
        assert why in page.inner_text("#checked")
