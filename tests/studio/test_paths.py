"""Tours and tool paths of the studio against a real service."""

import io
import json
import zipfile
from contextlib import redirect_stdout
from itertools import pairwise

import numpy as np

from armwright_client import Pose
from studio.code import plan_code
from studio.motion_frames import motion_frames, tour_frames
from studio.page.studio_page import StudioPage, serve_page
from studio.stages import goal_entry, pose_entry
from studio.state import Failure, Planned, TaskPlanned, TourPlanned
from studio.workbench import Workbench
from tests.service.robots import ASIDE, HOME


def test_a_tour_is_planned_played_and_exported(workbench: Workbench) -> None:
    refused = workbench.plan("tour")
    assert isinstance(refused, Failure)
    assert "two goals" in refused.detail
    workbench.set_start(HOME)
    # The goal of the studio becomes one of the tour, as joints or as the pose it was dragged to.
    workbench.set_goal_joints(ASIDE)
    goals = [goal_entry(workbench.state, workbench.goal_tip()) | {"id": "aside", "dwell": 0.5}]
    workbench.move_goal(Pose.from_rpy([0.45, -0.2, 0.4], 3.14159265, 0.0, 0.0))
    goals.append(goal_entry(workbench.state, workbench.goal_tip()))
    assert [set(goal) - {"id", "dwell"} for goal in goals] == [{"joints"}, {"pose"}]
    workbench.set_entries("goals", tuple(goals))
    workbench.set_option("tour", "end", "start")
    workbench.set_option("tour", "rounds", 0)
    outcome = workbench.plan("tour")
    assert isinstance(outcome, TourPlanned), outcome
    assert {*outcome.plan.order} == {"aside", "1"}
    assert all(leg.certificate.verified for leg in outcome.plan.legs)
    assert sum(text.startswith("Every leg is proved") for text in outcome.sentences) == 1
    frames = tour_frames(workbench, outcome)
    np.testing.assert_allclose(frames.joints[0], HOME, atol=1e-9)
    np.testing.assert_allclose(frames.joints[-1], HOME, atol=1e-9)
    still = [bool(np.ptp([a, b], axis=0).max() < 1e-9) for a, b in pairwise(frames.joints)]
    assert 10 <= sum(still) <= 20  # 0.5 s at 30 frames a second
    assert workbench.view_url() == f"{workbench.url}/v1/plans/{outcome.plan_id}/view"
    exported = workbench.export("joint_trajectory_json")
    with zipfile.ZipFile(io.BytesIO(exported.content)) as archive:
        points = [json.loads(archive.read(name))["points"] for name in sorted(archive.namelist())]
    assert len(points) == 3
    np.testing.assert_allclose(points[0][0]["positions"], HOME, atol=1e-6)
    for before, after in pairwise(points):
        np.testing.assert_allclose(before[-1]["positions"], after[0]["positions"], atol=1e-6)
    printed = io.StringIO()
    with redirect_stdout(printed):
        exec(compile(plan_code(workbench.url, workbench.state, "tour")[0], "shown", "exec"), {})
    rows = [line.split()[:2] for line in printed.getvalue().splitlines()]
    assert rows == [[str(leg.origin), str(leg.target)] for leg in outcome.plan.legs]
    page = StudioPage(serve_page(0), workbench)
    try:
        page.show_outcome()
        page.refresh()
    finally:
        page.close()
    workbench.set_entries("goals", ({"joints": [0.0]}, {"pose": {"position": [3.0, 0.0, 0.0]}}))
    assert isinstance(workbench.plan("tour"), Failure)


def test_a_tool_path_is_planned_and_played(workbench: Workbench) -> None:
    workbench.set_start(HOME)
    tip = workbench.goal_tip()
    way = [(0.45, -0.1, 0.45), (0.45, 0.1, 0.45), (0.5, 0.1, 0.45)]
    poses = [tip.model_copy(update={"position": place}) for place in way]
    workbench.set_entries("waypoints", tuple(pose_entry(pose) for pose in poses))
    workbench.set_option("path", "tool_speed", 0.05)
    workbench.set_option("path", "tolerance", {"free": ["rz"]})
    outcome = workbench.plan("tool path")
    assert isinstance(outcome, Planned), outcome
    assert outcome.plan.planner == "cartesian"
    assert outcome.plan.certificate.verified
    frames = motion_frames(workbench, outcome)
    tips = frames.links[workbench.model.tip_link].positions
    # The tool passes the waypoints, and between the first and the last leaves their lines nowhere.
    distances = [np.linalg.norm(tips - place, axis=1) for place in np.array(way)]
    assert max(row.min() for row in distances) < 2e-3
    on_way = tips[int(distances[0].argmin()) : int(distances[2].argmin()) + 1]
    off = np.minimum(np.abs(on_way[:, 0] - 0.45), np.abs(on_way[:, 1] - 0.1))
    assert off.max() < 1e-3
    python, curl = plan_code(workbench.url, workbench.state, "tool path")
    assert "planner='cartesian'" in python
    assert "tool_speed" in curl
    assert workbench.export("csv").content
    workbench.set_option("path", "tool_speed", None)
    assert dict(workbench.state.path_options) == {"tolerance": {"free": ["rz"]}}


def test_stages_that_are_passed_are_exported_as_one_motion(workbench: Workbench) -> None:
    workbench.set_start(HOME)
    on = [0.4, -0.2, 0.3, -1.5, 0.2, 1.2, -0.3]
    goals = [{"kind": "move", "goal": {"joints": joints}} for joints in (ASIDE, on, HOME)]
    workbench.set_entries("stages", ({**goals[0], "blend": 0.3}, *goals[1:]))
    outcome = workbench.plan("task")
    assert isinstance(outcome, TaskPlanned), outcome
    assert [stage.passes for stage in outcome.plan.stages] == [True, False, False]
    exported = workbench.export("joint_trajectory_json")
    with zipfile.ZipFile(io.BytesIO(exported.content)) as archive:
        files = {name: json.loads(archive.read(name))["points"] for name in archive.namelist()}
    assert [name.partition("_armwright")[0] for name in sorted(files)] == ["00-01_move", "02_move"]
    for points, ends in zip((files[n] for n in sorted(files)), ((HOME, on), (on, HOME)),
                            strict=True):  # fmt: skip
        for point, place in zip((points[0], points[-1]), ends, strict=True):
            np.testing.assert_allclose(point["positions"], place, atol=1e-6)
            np.testing.assert_allclose(point["velocities"], 0.0, atol=1e-6)
        inside = np.abs([point["velocities"] for point in points[1:-1]]).max(axis=1)
        assert inside.min() > 1e-3


def test_the_forms_are_those_of_the_api(workbench: Workbench) -> None:
    for forms, names in (
        (workbench.goal_forms, {"joints", "pose", "any_of", "dwell", "group"}),
        (workbench.waypoint_forms, {"pose", "point", "normal", "tolerance", "blend"}),
    ):
        (fields,) = forms.fields.values()
        assert names <= {field.path for field in fields}
    fields = (*workbench.tour_fields, *workbench.path_fields)
    assert {"rounds", "tool_speed"} <= {field.path for field in fields}
    assert all(field.description for field in fields)
