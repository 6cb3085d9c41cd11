"""Sessions of the studio over restarts, and tools that are mounted."""

from pathlib import Path

import numpy as np
import pytest

from armwright_client import Box, FramedPose, NamedTool, Obstacle
from studio.page.studio_page import StudioPage, serve_page
from studio.requests import plan_request
from studio.state import Planned, load_session, save_session
from studio.workbench import Workbench


def test_a_session_comes_back_as_it_was(workbench: Workbench, tmp_path: Path) -> None:
    file = tmp_path / "deep" / "studio.json"
    box = Obstacle(id="b", shape=Box(size=[0.1, 0.2, 0.3]), pose=FramedPose.at(0.5, 0.1, 0.2))
    workbench.change_obstacle(box)
    workbench.attach("b", "panda_hand")
    workbench.set_setting("timing.method", "spline")
    workbench.set_entries("stages", ({"type": "move", "goal": {"joints": [0.1] * 7}},))
    workbench.move_goal(FramedPose.at(0.4, 0.2, 0.5))
    save_session(file, workbench.state)
    found = load_session(file)
    assert found is not None
    assert found == workbench.state
    other = Workbench(workbench.client, workbench.url, "ur5e")
    other.restore(found)
    assert other.state == workbench.state
    assert other.model.name == "panda"


@pytest.mark.parametrize("text", ["", "{", "{}", "[]", '{"robot": "panda"}', '{"obstacles": 3}'])
def test_a_file_that_is_no_session_is_passed_over(tmp_path: Path, text: str) -> None:
    file = tmp_path / "studio.json"
    assert load_session(file) is None
    file.write_text(text)
    assert load_session(file) is None


def test_a_session_of_a_robot_that_is_gone_is_passed_over(
    workbench: Workbench, tmp_path: Path
) -> None:
    file = tmp_path / "studio.json"
    save_session(file, workbench.state)
    file.write_text(file.read_text().replace('"panda"', '"gone"'))
    found = load_session(file)
    assert found is not None
    workbench.restore(found)
    assert workbench.state.robot == "panda"


def test_the_page_saves_every_change(workbench: Workbench, tmp_path: Path) -> None:
    file = tmp_path / "studio.json"
    page = StudioPage(serve_page(0), workbench, file)
    try:
        workbench.set_goal_joints([0.3, *workbench.state.start[1:]])
        page.refresh()
    finally:
        page.close()
    found = load_session(file)
    assert found is not None
    assert found.goal_joints[0] == 0.3


def test_a_tool_is_mounted_for_goals_and_plans(workbench: Workbench) -> None:
    stick = {"type": "capsule", "radius": 0.01, "height": 0.1}
    pose = {"position": [0.0, 0.0, 0.16]}
    tool = NamedTool.model_validate({
        "name": "stick",
        "tcp": {"end": {"position": [0.0, 0.0, 0.25]}},
        "solids": [{"shape": stick, "pose": pose}],
    })  # fmt: skip
    bare = np.array(workbench.goal_tip().position)
    workbench.client.tools.create(tool)
    try:
        assert "stick" in workbench.tool_names()
        workbench.mount("stick")
        reach = np.linalg.norm(np.array(workbench.goal_tip().position) - bare)
        assert reach > 0.1
        assert plan_request(workbench.state).tool == "stick"
        goal = FramedPose.of(position=[0.45, 0.1, 0.3], rpy=[np.pi, 0.0, 0.0])
        assert workbench.move_goal(goal)
        planned = workbench.plan()
        assert isinstance(planned, Planned), planned
        workbench.mount(None)
        assert plan_request(workbench.state).tool is None
    finally:
        workbench.client.tools.delete("stick")
