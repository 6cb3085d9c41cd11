"""Commands of the studio against a real service: no browser is needed for any of them."""

import io
import json
import subprocess
import zipfile
from collections.abc import Mapping
from contextlib import redirect_stdout

import numpy as np
import pytest
import trimesh

from armwright_client import Box, Mesh, NotFound, Pose
from benchmarks.arms import UPLOADS
from benchmarks.problems.example_arms import archive
from kinematics.forward import forward
from kinematics.robots import builtin_chain
from studio.code import ik_code, plan_code
from studio.motion_frames import LinkPoses, motion_frames, task_frames
from studio.page.studio_page import StudioPage, serve_page
from studio.pose import rotation
from studio.stages import pick_stages, place_stages
from studio.state import Failure, Planned, TaskPlanned, Verdict, compare
from studio.workbench import Workbench, check, colliding_pairs
from tests.planning.sequence import fingers
from tests.service.robots import ASIDE, HOME, urdf
from tests.studio.arms_shown import show

TABLE = {
    "id": "table",
    "shape": {"type": "box", "size": [0.4, 0.5, 0.1]},
    "pose": {"position": [0.6, 0.0, -0.1]},
}

MOVEIT = b"""
name: cell
world:
  collision_objects:
    - id: lid
      header: {frame_id: panda_link0}
      primitives: [{type: box, dimensions: [0.1, 0.2, 0.01]}]
      primitive_poses: [{position: [0.6, 0.1, 0.2], orientation: [0, 0, 0, 1]}]
    - id: ball
      pose: {position: [1.0, 0.0, 0.0], orientation: [0, 0, 0.7071067811865476, 0.7071067811865476]}
      primitives: [{type: sphere, dimensions: [0.05]}]
      primitive_poses: [{position: [0.5, 0.0, 0.0], orientation: [0, 0, 0, 1]}]
"""


def test_a_motion_is_planned_shown_and_taken_back(workbench: Workbench) -> None:
    begin = workbench.state
    workbench.set_start(HOME)
    workbench.set_goal_joints(ASIDE)
    workbench.set_setting("margin", 0.01)
    outcome = workbench.plan()
    assert isinstance(outcome, Planned)
    assert outcome.plan.certificate.verified
    assert any("every instant" in text for text in outcome.sentences)
    assert workbench.view_url() == f"{workbench.url}/v1/plans/{outcome.plan_id}/view"
    frames = motion_frames(workbench, outcome)
    np.testing.assert_allclose(frames.joints[0], HOME, atol=1e-9)
    np.testing.assert_allclose(frames.joints[-1], ASIDE, atol=1e-9)
    assert frames.at(0.0) == 0
    assert frames.at(frames.times[-1]) == len(frames.times) - 1
    workbench.pin()
    workbench.set_setting("timing.velocity_scaling", 0.5)
    slower = workbench.plan()
    assert isinstance(slower, Planned)
    assert slower.plan.trajectory.duration > outcome.plan.trajectory.duration
    assert f"{slower.plan.trajectory.duration:.3f} s" in compare(outcome, slower)
    for _ in range(4):
        workbench.undo()
    assert workbench.state == begin
    for _ in range(4):
        workbench.redo()
    assert dict(workbench.state.settings) == {"margin": 0.01, "timing.velocity_scaling": 0.5}


def test_the_code_that_is_shown_does_the_same(workbench: Workbench) -> None:
    workbench.set_start(HOME)
    workbench.set_goal_joints(ASIDE)
    workbench.add_obstacle("sphere")
    workbench.set_setting("clearance.preferred", 0.03)
    outcome = workbench.plan()
    assert isinstance(outcome, Planned)
    python, curl = plan_code(workbench.url, workbench.state)
    printed = io.StringIO()
    with redirect_stdout(printed):
        exec(compile(python, "shown", "exec"), {})
    planner, duration, clearance = printed.getvalue().split()
    assert planner == outcome.plan.planner
    assert float(duration) == outcome.plan.trajectory.duration
    assert float(clearance) == outcome.plan.certificate.min_clearance
    answer = json.loads(
        subprocess.run(["bash", "-c", curl], capture_output=True, check=True).stdout
    )
    assert answer["trajectory"]["duration"] == outcome.plan.trajectory.duration


def test_a_moved_goal_is_answered_by_branches(workbench: Workbench) -> None:
    workbench.set_goal_joints(ASIDE)
    pose = workbench.goal_tip()
    workbench.move_goal(Pose(position=pose.position, quaternion_xyzw=pose.quaternion_xyzw))
    assert workbench.branches
    chain = builtin_chain("panda")
    for branch in workbench.branches:
        T = forward(chain, branch.joints)
        np.testing.assert_allclose(T[:3, 3], pose.position, atol=1e-5)
        np.testing.assert_allclose(T[:3, :3], rotation(pose).as_matrix(), atol=1e-4)
    best = workbench.branches[0]
    assert best.label == "0 ✓"
    workbench.choose_branch(0)
    assert workbench.state.goal_joints == best.joints
    assert workbench.state.goal_pose is None
    code = ik_code(workbench.url, workbench.state, pose)
    printed = io.StringIO()
    with redirect_stdout(printed):
        exec(compile(code, "shown", "exec"), {})
    assert "valid" in printed.getvalue()


def test_obstacles_reject_branches_and_explain_failures(workbench: Workbench) -> None:
    workbench.set_start(HOME)
    tip = Pose.from_rpy([0.45, 0.2, 0.4], 3.14, 0.0, 0.0)
    workbench.move_goal(tip)
    obstacle = workbench.add_obstacle("box")
    workbench.change_obstacle(obstacle.model_copy(update={"pose": Pose.at(0.45, 0.2, 0.4)}))
    workbench.solve_goal()
    assert workbench.branches
    assert {branch.verdict for branch in workbench.branches} <= {Verdict.COLLISION, Verdict.LIMITS}
    outcome = workbench.plan()
    assert isinstance(outcome, Failure)
    assert "box_1" in " ".join(outcome.sentences) + outcome.detail
    assert outcome.hint
    assert outcome.plan_id is not None
    assert outcome.pair is not None
    assert outcome.shown is not None
    at_tip = forward(builtin_chain("panda"), np.array(outcome.shown))
    np.testing.assert_allclose(at_tip[:3, 3], tip.position, atol=1e-5)
    pairs = colliding_pairs(workbench, outcome)
    verdict = check(workbench, outcome)
    assert {frozenset(hit.pair) for hit in verdict.collisions} <= {frozenset(p) for p in pairs}
    assert any("box_1" in pair for pair in pairs)
    workbench.remove_obstacle("box_1")
    assert isinstance(workbench.plan(), Planned)


def test_a_carried_obstacle_moves_with_its_link(workbench: Workbench) -> None:
    workbench.set_start(HOME)
    workbench.set_goal_joints(ASIDE)
    tip = workbench.link_poses(HOME)["panda_hand"].position
    ball = workbench.add_obstacle("sphere")
    place = Pose.at(tip[0], tip[1], tip[2] - 0.15)
    workbench.change_obstacle(ball.model_copy(update={"pose": place}))
    workbench.attach(ball.id, "panda_hand")
    outcome = workbench.plan()
    assert isinstance(outcome, Planned), outcome
    frames = motion_frames(workbench, outcome)
    hand, held = frames.links["panda_hand"], frames.carried[ball.id]
    np.testing.assert_allclose(held.positions[0], place.position, atol=1e-9)
    distances = np.linalg.norm(held.positions - hand.positions, axis=1)
    np.testing.assert_allclose(distances, distances[0], atol=1e-9)
    assert np.ptp(held.positions, axis=0).max() > 0.1


def test_scenes_are_imported_saved_and_loaded(workbench: Workbench) -> None:
    workbench.import_file("cell.json", json.dumps({"obstacles": [TABLE]}).encode())
    (table,) = workbench.state.obstacles
    assert table.id == "table"
    assert list(table.shape.size) == [0.4, 0.5, 0.1]  # type: ignore[union-attr]
    workbench.save_scene("again")
    workbench.remove_obstacle("table")
    workbench.load_scene("again")
    assert workbench.state.obstacles == (table,)
    with pytest.raises(NotFound):
        workbench.load_scene("nothing")
    with pytest.raises(ValueError, match=r"cell\.txt.*json, yaml"):
        workbench.import_file("cell.txt", b"")


def test_planning_scenes_of_moveit_are_imported(workbench: Workbench) -> None:
    workbench.import_file("cell.yaml", MOVEIT)
    lid, ball = workbench.state.obstacles
    assert (lid.id, ball.id) == ("lid", "ball")
    # By hand: the object's frame is a quarter turn about z, 1 m along x of the base.
    np.testing.assert_allclose(ball.pose.position, [1.0, 0.5, 0.0], atol=1e-12)
    np.testing.assert_allclose(lid.pose.position, [0.6, 0.1, 0.2], atol=1e-12)
    np.testing.assert_allclose(rotation(lid.pose).as_rotvec(), [0.0, 0.0, 0.0], atol=1e-12)
    with pytest.raises(ValueError, match="panda_hand"):
        workbench.import_file("cell.yaml", MOVEIT.replace(b"panda_link0", b"panda_hand"))
    with pytest.raises(ValueError, match=r"world\.collision_objects\[0\]"):
        workbench.import_file("cell.yaml", MOVEIT.replace(b"box", b"torus"))


def test_meshes_are_added_beside_what_is_there(workbench: Workbench) -> None:
    workbench.add_obstacle("box")
    mesh = trimesh.creation.box([0.1, 0.2, 0.3])
    workbench.import_file("crate.stl", mesh.export(file_type="stl"))
    workbench.import_file("crate.obj", mesh.export(file_type="obj").encode())
    names = [item.id for item in workbench.state.obstacles]
    assert names == ["box_1", "crate", "crate_1"]
    shape = workbench.state.obstacles[1].shape
    assert isinstance(shape, Mesh)
    np.testing.assert_allclose(np.ptp(np.array(shape.vertices), axis=0), [0.1, 0.2, 0.3])
    assert isinstance(workbench.plan(), Planned), workbench.outcome
    with pytest.raises(ValueError, match="millimetres"):
        workbench.import_file("crate.stl", mesh.apply_scale(1000.0).export(file_type="stl"))


def test_a_task_is_edited_planned_and_played(workbench: Workbench) -> None:
    """Pick a box that stands free, and put it where the goal's frame is."""
    workbench.set_start(HOME)
    box = workbench.add_obstacle("box")
    workbench.change_obstacle(
        box.model_copy(update={"pose": Pose.at(0.5, 0.2, 0.3), "shape": Box(size=[0.04] * 3)})
    )
    (crate,) = workbench.state.obstacles
    links = workbench.gripper_links()
    assert "panda_hand" in links
    assert "panda_link5" not in links
    tip = Pose.from_rpy([0.5, -0.2, 0.3], 3.14159265, 0.0, 0.0)
    workbench.set_entries("stages", (*pick_stages(crate, links), *place_stages(crate, tip)))
    outcome = workbench.plan("task")
    assert isinstance(outcome, TaskPlanned), outcome
    assert all(stage.certificate.verified for stage in outcome.plan.stages)
    assert workbench.view_url() == f"{workbench.url}/v1/plans/{outcome.plan_id}/view"
    assert sum("holds box_1" in text for text in outcome.sentences) == 6
    frames = task_frames(workbench, outcome)
    held = frames.carried["box_1"].positions
    np.testing.assert_allclose(held[0], [0.5, 0.2, 0.3], atol=1e-9)
    np.testing.assert_allclose(held[-1], [0.5, -0.2, 0.3], atol=1e-3)
    assert np.linalg.norm(np.diff(held, axis=0), axis=1).max() < 0.2
    chain = builtin_chain("panda")
    middle = len(frames.times) // 2
    T = forward(chain, frames.joints[middle])
    np.testing.assert_allclose(held[middle], T[:3, 3], atol=1e-5)  # grasped at its middle
    exported = workbench.export("joint_trajectory_json")
    assert exported.name == "task_joint_trajectory_json.zip"
    with zipfile.ZipFile(io.BytesIO(exported.content)) as archive:
        files = {name: json.loads(archive.read(name)) for name in archive.namelist()}
    still = {"open", "close", "attach", "detach", "grasp", "place"}
    kinds = [(f"{s.index:02}", s.kind) for s in outcome.plan.stages if s.kind not in still]
    assert [tuple(name.split("_")[:2]) for name in sorted(files)] == kinds
    # Each file goes on where the one before has ended, the first one at the start.
    end = HOME
    for name in sorted(files):
        points = files[name]["points"]
        np.testing.assert_allclose(points[0]["positions"], end, atol=1e-6)
        end = points[-1]["positions"]
    python, curl = plan_code(workbench.url, workbench.state, "task")
    printed = io.StringIO()
    with redirect_stdout(printed):
        exec(compile(python, "shown", "exec"), {})
    rows = [line.split() for line in printed.getvalue().splitlines()]
    assert [row[0] for row in rows] == [stage.kind for stage in outcome.plan.stages]
    assert "/v1/tasks" in curl
    workbench.undo()
    assert workbench.state.stages == ()


def test_a_public_arm_as_it_lies_picks_and_places_in_six_steps(workbench: Workbench) -> None:
    steps = (
        lambda: workbench.upload_robot("six_steps.zip", archive(UPLOADS["UR10"][0])),
        lambda: workbench.mount("parallel_jaw"),
        lambda: workbench.add_obstacle("box"),
        lambda: workbench.move_goal(Pose.from_rpy([0.5, -0.4, 0.3], np.pi, 0.0, 0.0)),
        lambda: workbench.add_pick_and_place(workbench.state.obstacles[-1]),
        lambda: workbench.plan("task"),
    )
    *_, outcome = [step() for step in steps]
    assert len(steps) <= 6
    assert isinstance(outcome, TaskPlanned), outcome
    assert all(stage.certificate.verified for stage in outcome.plan.stages)
    (box,) = workbench.state.obstacles
    opening = workbench.client.tools.get("parallel_jaw").form.opening  # type: ignore[union-attr]
    assert list(box.shape.size) == [0.8 * opening] * 3  # type: ignore[union-attr]
    held = task_frames(workbench, outcome).carried[box.id].positions
    np.testing.assert_allclose(held[0], box.pose.position, atol=1e-9)
    np.testing.assert_allclose(held[-1], [0.5, -0.4, 0.3], atol=2e-3)


def test_stages_and_constraints_that_do_not_fit_are_failures_in_words(
    workbench: Workbench,
) -> None:
    workbench.set_entries("stages", ({"kind": "approach"},))
    outcome = workbench.plan("task")
    assert isinstance(outcome, Failure)
    assert "distance" in outcome.detail
    workbench.set_entries("constraints", ({"type": "orientation", "cone_angle": -1.0},))
    outcome = workbench.plan()
    assert isinstance(outcome, Failure)
    assert "constraints" in outcome.detail


def test_constraints_of_the_form_are_held(workbench: Workbench) -> None:
    forms = workbench.constraint_forms
    assert forms.tag == "type"
    assert {"joint", "position", "orientation", "clearance"} <= set(forms.fields)
    workbench.set_start(HOME)
    workbench.set_goal_joints([0.3, *HOME[1:]])
    down = {"type": "orientation", "axis": [0, 0, 1], "direction": [0, 0, -1], "cone_angle": 0.2}
    workbench.set_entries("constraints", (down,))
    outcome = workbench.plan()
    assert isinstance(outcome, Planned), outcome
    (use,) = outcome.plan.certificate.path_constraints
    assert use.residual <= 0.0
    assert any("Constraint" in text for text in outcome.sentences)


def test_the_stage_forms_are_those_of_the_api(workbench: Workbench) -> None:
    forms = workbench.stage_forms
    assert set(forms.fields) == {
        *("move", "approach", "retreat", "lift", "grasp", "place"),
        *("attach", "detach", "wait", "open", "close"),
        *("line", "arc", "seam", "insert", "signal", "set", "wait_for"),
        *("for_each", "fallback", "regrasp"),
    }
    approach = {field.path: field for field in forms.fields["approach"]}
    assert approach["distance"].required
    assert approach["distance"].kind == "json"
    assert approach["frame"].choices == ("tool", "root", "object", "support")
    assert approach["margin"].kind == "number"
    assert approach["name"].kind == "text"
    assert all(field.description for fields in forms.fields.values() for field in fields)


def test_an_uploaded_robot_is_shown_with_its_lint(workbench: Workbench) -> None:
    text = urdf().replace('<mesh filename="package://meshes/box.obj"/>', '<box size=".1 .1 .1"/>')
    workbench.upload_robot("bench.urdf", text.encode())
    assert workbench.state.robot == "bench"
    assert len(workbench.state.start) == 2
    assert {body.link for body in workbench.geometry().bodies} == {"lower", "upper"}
    assert not workbench.geometry("visual").bodies
    workbench.set_goal_joints([0.2, 0.1])
    assert isinstance(workbench.plan(), Planned), workbench.outcome
    with pytest.raises(ValueError, match=r"\.urdf"):
        workbench.upload_robot("bench.txt", b"")
    with pytest.raises(ValueError, match="can't be expanded"):
        workbench.upload_robot("bench.urdf.xacro", b"<robot")


def test_fingers_are_set_and_move(workbench: Workbench) -> None:
    text = io.BytesIO()
    with zipfile.ZipFile(text, "w") as archive:
        archive.writestr("claws.urdf", fingers.urdf())
        archive.writestr("claws.srdf", fingers.srdf())
    workbench.upload_robot("claws.zip", text.getvalue())

    def opening(links: Mapping[str, LinkPoses]) -> list[float]:
        plates = (links[f"{name}_plate"].positions for name in ("claw_left", "claw_right"))
        return [float(value) for value in np.linalg.norm(np.subtract(*plates), axis=1)]

    assert set(workbench.model.fingers) == {"claw_left"}
    workbench.set_finger("claw_left", 0.03)
    workbench.set_start(HOME)
    workbench.set_goal_joints(ASIDE)
    outcome = workbench.plan()
    assert isinstance(outcome, Planned), outcome
    # A plan keeps them where they are; the opening is twice the way of each plate.
    np.testing.assert_allclose(opening(motion_frames(workbench, outcome).links), 0.06, atol=1e-9)
    python, _ = plan_code(workbench.url, workbench.state)
    assert "fingers={'claw_left': 0.03}" in python.replace('"', "'")
    workbench.set_entries("stages", ({"kind": "open"}, {"kind": "move", "goal": {"joints": ASIDE}}))
    task = workbench.plan("task")
    assert isinstance(task, TaskPlanned), task
    seen = opening(task_frames(workbench, task).links)
    assert seen[0] == pytest.approx(0.06)
    assert seen[-1] == pytest.approx(0.11)
    assert (np.diff(seen) > -1e-9).all()
    assert sum(0.061 < value < 0.109 for value in seen) > 3
    page = StudioPage(serve_page(0), workbench)
    page.close()
    workbench.undo()
    workbench.undo()
    assert workbench.state.fingers == {"claw_left": 0.03}


def test_the_form_has_what_the_api_says(workbench: Workbench) -> None:
    fields = {field.path: field for field in workbench.fields}
    assert "rrt_connect" in fields["planner"].choices
    assert fields["timing.method"].choices == ("toppra", "spline", "jerk_limited")
    assert (fields["margin"].minimum, fields["margin"].maximum) == (0.0, 10.0)
    assert fields["timing.velocity_scaling"].above_minimum
    assert fields["seed"].kind == "integer"
    assert fields["timing.torque_limits"].kind == "flag"
    assert all(field.description for field in fields.values())


def test_a_motion_is_exported(workbench: Workbench) -> None:
    with pytest.raises(ValueError, match="plan one first"):
        workbench.export("csv")
    workbench.set_start(HOME)
    workbench.set_goal_joints(ASIDE)
    workbench.plan()
    file = workbench.export("csv")
    assert file.name.endswith(".csv")
    assert file.content.splitlines()[-1]


def test_public_arms_are_shown_and_planned_for(workbench: Workbench) -> None:
    page = StudioPage(serve_page(0), workbench)
    try:
        arms = [show(page, name) for name in ("UR5", "PR2, left")]
    finally:
        page.close()
    assert [arm.joints for arm in arms] == [6, 8]
    for arm in arms:
        assert arm.triangles > 1_000
        assert arm.looks > 6
        assert isinstance(arm.outcome, Planned), arm.outcome
        assert arm.outcome.plan.certificate.verified
        duration = arm.outcome.plan.trajectory.duration
        assert arm.frames == pytest.approx(30.0 * duration + 1.0, abs=1.0)
        assert 0 < arm.branches[0] <= arm.branches[1]
