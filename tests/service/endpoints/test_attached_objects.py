"""Robots with attached objects: where these are, what they weigh, and what they may touch."""

import json
from typing import Any

import numpy as np
import pytest

from armwright_wire.scenes.check import Attached, CheckRequest
from armwright_wire.scenes.scene import Scene as SceneBody
from kinematics.forward import forward
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box, Sphere
from service.endpoints.attached_objects import RobotInScene, attach, requested_scene
from service.endpoints.check.task import check
from service.storage.caches.cache_key import NotPrepared, Reference, builtin_reference
from tests.planning.scenes import HOME, builtin
from tests.service.robots import solid

ROBOT = builtin("panda")
AT = np.array([[1, 0, 0, 0.5], [0, 1, 0, 0.1], [0, 0, 1, 0.4], [0, 0, 0, 1]], dtype=float)
CUP = Obstacle("cup", Sphere(0.03), AT)
SCENE = Scene((CUP, Obstacle("table", Box(np.array([1.0, 1.0, 0.1])))), frozenset({("a", "b")}))
PART: dict[str, Any] = solid("part", "box", [0.0, 0.0, 0.12], size=[0.02, 0.03, 0.04]) | {
    "link": "panda_hand"
}


def held(*parts: dict[str, Any], scene: Scene = SCENE, allowed: Any = None) -> RobotInScene:
    return attach(ROBOT, scene, [Attached.model_validate(part) for part in parts], allowed)


def taken(**changes: Any) -> dict[str, Any]:
    """The cup of the scene in the hand; a change to None leaves a field out."""
    body = {"id": "cup", "link": "panda_hand", "grasp_joints": HOME.tolist()} | changes
    return {key: value for key, value in body.items() if value is not None}


BOX: dict[str, Any] = {"type": "box", "size": [0.05, 0.05, 0.08]}
SOLIDS: list[dict[str, Any]] = [
    {"id": "mug/0", "shape": BOX, "pose": {"position": [0.45, -0.2, 0.14]}},
    {"id": "mug/1", "shape": BOX, "pose": {"position": [0.49, -0.2, 0.14]}},
    {"id": "table", "shape": BOX, "pose": {"position": [0.45, -0.2, 0.06]}},
]
MOVEIT = """
world:
  collision_objects:
    - {id: table, header: {frame_id: panda_link0}, primitives: [BOX],
       primitive_poses: [{position: [0.45, -0.2, 0.06]}]}
    - id: mug
      header: {frame_id: panda_link0}
      pose: {position: [0.45, -0.2, 0.14], orientation: [0, 0, 0, 1]}
      primitives: [BOX, BOX]
      primitive_poses: [{}, {position: [0.04, 0, 0]}]
""".replace("BOX", "{type: box, dimensions: [0.05, 0.05, 0.08]}")


@pytest.mark.parametrize("scene", [{"obstacles": SOLIDS}, {"moveit": MOVEIT}])
def test_an_object_of_several_solids_is_taken_and_allowed_by_its_name(
    scene: dict[str, Any],
) -> None:
    request: dict[str, Any] = {
        "robot": "panda", "joints": HOME.tolist(), "scene": scene,
        "attached": [taken(id="mug", touch_links=["table"])],
        "allowed_collisions": [["mug", "panda_link7"]],
    }  # fmt: skip
    body = CheckRequest.model_validate(request)
    around = requested_scene(None, body, ROBOT.chain, HOME)
    assert sorted(around.ids) == ["mug", "table"]
    cell = attach(ROBOT, around, body.attached, body.allowed_collisions)
    assert cell.scene.ids == ("table",)
    assert cell.scene.allows("mug", "table")
    assert cell.scene.allows("mug", "panda_link7")
    own = [i for i, link in enumerate(cell.robot.links) if link == "mug"]
    hand = ROBOT.chain.link("panda_hand")
    T_root_joint = forward(ROBOT.chain, HOME, "panda_hand") @ np.linalg.inv(hand.T_joint_link)
    centers = [T_root_joint @ [*cell.robot.pieces[i].bounding_sphere()[0], 1.0] for i in own]
    expected = [[0.45, -0.2, 0.14], [0.49, -0.2, 0.14]]
    np.testing.assert_allclose(np.array(centers)[:, :3], expected, atol=1e-9)


def test_a_pair_of_a_scene_may_name_an_object_of_several_solids() -> None:
    scene = {"obstacles": SOLIDS, "allowed_collisions": [["mug", "panda_hand"]]}
    body = CheckRequest.model_validate({"robot": "panda", "joints": HOME.tolist(), "scene": scene})
    around = requested_scene(None, body, ROBOT.chain, HOME)
    assert sorted(around.ids) == ["mug", "table"]
    assert around.allows("mug", "panda_hand")
    plain = body.model_copy(update={"scene": scene_of(SOLIDS)})
    assert len(requested_scene(None, plain, ROBOT.chain, HOME).ids) == 3, "nothing names it"


def test_what_is_odd_about_a_scene_is_told_where_it_is_used() -> None:
    text = MOVEIT + (
        "allowed_collision_matrix:\n  entry_names: [mug, panda_hand, gripper]\n"
        "  entry_values: [[false, true, true], [true, false, true], [true, true, false]]\n"
        "is_diff: true\n"
    )
    request: dict[str, Any] = {
        "robot": "panda", "joints": HOME.tolist(), "scene": {"moveit": text},
    }  # fmt: skip
    content = check(builtin_reference("panda"), None, json.dumps(request).encode())
    assert isinstance(content, bytes)
    answer = json.loads(content)
    assert answer["notes"] == [
        "fields of the planning scene that are not obeyed: is_diff",
        "the scene lets 'gripper' touch others: no link or obstacle has such a name",
    ]
    plain = {"obstacles": SOLIDS, "allowed_collisions": [["mgu", "panda_hand"]]}
    body = CheckRequest.model_validate({**request, "scene": plain, "attached": [PART]})
    around = requested_scene(None, body, ROBOT.chain, HOME)
    (note,) = attach(ROBOT, around, body.attached, None).notes
    assert "'mgu'" in note


def scene_of(obstacles: list[dict[str, Any]]) -> SceneBody:
    """A scene on the wire."""
    return SceneBody.model_validate({"obstacles": obstacles})


def sphere_of(cell: RobotInScene, name: str) -> tuple[Any, float]:
    """The bounding sphere of the only piece of an attached object, in its joint's frame."""
    (index,) = [i for i, link in enumerate(cell.robot.links) if link == name]
    return cell.robot.pieces[index].bounding_sphere()


def test_an_obstacle_may_be_taken_at_a_pose_or_with_another_shape() -> None:
    pose = {"position": [0.0, 0.0, 0.1]}
    at_pose = held(taken(grasp_joints=None, pose=pose))
    assert "cup" in at_pose.robot.names
    assert "cup" not in at_pose.scene.ids
    smaller = held(taken(shape={"type": "sphere", "radius": 0.01}))
    radii = [sphere_of(cell, "cup")[1] for cell in (at_pose, smaller)]
    assert radii == pytest.approx([0.03, 0.01])


def test_the_scene_of_a_request_is_stored_inline_or_empty() -> None:
    def requested(reference: Reference | None, source: Any, frame: str | None = None) -> Scene:
        body = CheckRequest.model_validate(
            {"robot": "panda", "scene": source, "frame": frame, "joints": [0.0] * 7}
        )
        return requested_scene(reference, body, ROBOT.chain, np.zeros(7))

    assert requested(None, None).obstacles == ()
    assert requested(None, "looked-up").obstacles == ()
    inline = {"obstacles": [{"id": "a", "shape": PART["shape"], "pose": PART["pose"]}]}
    assert requested(None, inline).ids == ("a",)
    lost = Reference("scene", "lost", "0" * 64, "/nowhere")
    with pytest.raises(NotPrepared):
        requested(lost, "lost")
    tool = forward(ROBOT.chain, np.zeros(7))
    (there,) = requested(None, inline, "tool").obstacles
    (here,) = requested(None, inline).obstacles
    np.testing.assert_allclose(there.T_world_obstacle, tool @ here.T_world_obstacle, atol=1e-12)
    named = {"frame": "panda_link0", **inline}
    np.testing.assert_allclose(
        requested(None, named, "tool").obstacles[0].T_world_obstacle, here.T_world_obstacle
    )
