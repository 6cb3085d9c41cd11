"""Commands of the studio against a real service: no browser is needed for any of them."""

import io
import json
import subprocess
from contextlib import redirect_stdout

import numpy as np
import pytest

from armwright_client import NotFound, Pose
from kinematics.forward import forward
from kinematics.robots import builtin_chain
from studio.branch import Verdict
from studio.motion_frames import motion_frames
from studio.pose import rotation
from studio.result import Failure, Planned, compare
from studio.workbench import Workbench
from tests.service.robots import ASIDE, HOME, urdf

TABLE = {
    "id": "table",
    "shape": {"type": "box", "size": [0.4, 0.5, 0.1]},
    "pose": {"position": [0.6, 0.0, -0.1]},
}


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
    python, curl = workbench.plan_code()
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
    assert best.verdict is Verdict.VALID
    workbench.choose_branch(1)
    assert workbench.state.goal_joints == best.joints
    assert workbench.state.goal_pose is None
    code = workbench.ik_code(pose)
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
    workbench.import_scene(json.dumps({"obstacles": [TABLE]}).encode())
    (table,) = workbench.state.obstacles
    assert table.id == "table"
    assert list(table.shape.size) == [0.4, 0.5, 0.1]  # type: ignore[union-attr]
    workbench.save_scene("again")
    workbench.remove_obstacle("table")
    workbench.load_scene("again")
    assert workbench.state.obstacles == (table,)
    with pytest.raises(NotFound):
        workbench.load_scene("nothing")
    with pytest.raises(ValueError, match="MoveIt"):
        workbench.import_scene(b'{"moveit": "name: cell"}')


def test_an_uploaded_robot_is_shown_with_its_lint(workbench: Workbench) -> None:
    text = urdf().replace('<mesh filename="package://meshes/box.obj"/>', '<box size=".1 .1 .1"/>')
    workbench.upload_robot("bench.urdf", text.encode())
    assert workbench.state.robot == "bench"
    assert len(workbench.state.start) == 2
    assert {body.link for body in workbench.geometry().bodies} == {"lower", "upper"}
    workbench.set_goal_joints([0.2, 0.1])
    assert isinstance(workbench.plan(), Planned), workbench.outcome
    with pytest.raises(ValueError, match=r"\.urdf"):
        workbench.upload_robot("bench.txt", b"")


def test_a_setting_out_of_range_is_a_failure_in_words(workbench: Workbench) -> None:
    workbench.set_setting("timing.velocity_scaling", -1.0)
    outcome = workbench.plan()
    assert isinstance(outcome, Failure)
    assert "velocity_scaling" in outcome.detail


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
    assert workbench.export("csv").content.splitlines()[-1]
