"""MoveIt planning scenes: what is read, and what is refused with its place."""

import copy
import json
from datetime import date
from typing import Any

import numpy as np
import pytest

from kinematics.errors import InvalidScene
from kinematics.pose import from_quaternion, from_rpy, to_quaternion, transform
from obstacles import moveit
from obstacles.moveit import scene_from_moveit
from obstacles.shapes import Box, Cone, Cylinder, HalfSpace, Mesh, Sphere

SCENE = """
name: ""
robot_model_name: arm
fixed_frame_transforms:
  - child_frame_id: world
    transform: {translation: [0, 0, 0], rotation: [0, 0, 0, 1]}
  - child_frame_id: desk
    transform: {translation: [0, 0, 1], rotation: [0, 0, 0.7071068, 0.7071068]}
allowed_collision_matrix:
  entry_names: [hand, arm, crate, can]
  entry_values:
    - [false, true, false, true]
    - [true, true, false, false]
    - [false, false, false, false]
    - [true, false, false, false]
robot_state:
  joint_state: {name: [j], position: [0]}
world:
  collision_objects:
    - id: crate
      primitives:
        - {type: box, dimensions: [0.1, 0.2, 0.3]}
        - {type: sphere, dimensions: [0.25]}
      primitive_poses:
        - {position: [1, 2, 3], orientation: [0, 0, 0, 1]}
        - {position: [0, 0, 1e-01], orientation: [0.6, 0, 0, 0.8001]}
    - id: can
      header: {frame_id: desk}
      pose: {position: {x: 1, y: 0, z: 0}, orientation: {x: 0, y: 0, z: 0, w: 1}}
      primitives: [{type: cylinder, dimensions: [0.14, 0.03]}]
      primitive_poses: [{position: [0, 0, 1e-05]}]
    - id: 7
      pose: {position: [1, 0, 0]}
      primitives: [{type: 4, dimensions: [0.4, 0.1]}]
    - id: floor
      planes: [{coef: [0, 0, 2, 1]}]
      plane_poses: [{}]
    - id: wedge
      meshes:
        - vertices: [[0, 0, 0], {x: 1, y: 0, z: 0}, [0, 1, 0], [0, 0, 1]]
          triangles: [[0, 2, 1], {vertex_indices: [0, 1, 3]}, [0, 3, 2], [1, 2, 3]]
      mesh_poses: [{}]
    - {id: gone, operation: 1}
"""


def test_objects_that_another_text_told_already_are_those_obstacles() -> None:
    moveit._KNOWN.clear()
    first = scene_from_moveit(SCENE)
    text = SCENE.replace("position: [0]}", "position: [1]}")
    moved = text.replace("[1, 0, 0]}", "[1, 0, 0.5]}")
    again, other = scene_from_moveit(text), scene_from_moveit(moved)
    assert again.content_hash == first.content_hash
    is_kept = [a is b for a, b in zip(first.obstacles, again.obstacles, strict=True)]
    assert is_kept == [True, True, True, True, True, False], "meshes are read anew"
    assert [a is b for a, b in zip(first.obstacles, other.obstacles, strict=True)] == [
        True, True, True, False, True, False,
    ]  # fmt: skip
    moveit._KNOWN.clear()
    assert scene_from_moveit(moved).content_hash == other.content_hash


def test_objects_are_read_anew_where_frames_stand_elsewhere() -> None:
    raised = SCENE.replace("translation: [0, 0, 1]", "translation: [0, 0, 2]")
    first, other = scene_from_moveit(SCENE), scene_from_moveit(raised)
    distance = other.obstacle("can").T_world_obstacle - first.obstacle("can").T_world_obstacle
    np.testing.assert_allclose(distance[:3, 3], [0.0, 0.0, 1.0], atol=1e-12)


def test_objects_that_differ_by_anything_are_told_apart() -> None:
    """Values that are equal to Python are not the same: 1, 1.0 and true; a date is none of them."""
    values: list[Any] = [1, 1.0, True, "1", None, 0.0, -0.0, [1], {"1": 1}, date(2026, 1, 1)]
    keys = [moveit._content({"id": value}) for value in values]
    assert len(set(keys)) == len(values)
    assert keys == [moveit._content(copy.deepcopy({"id": value})) for value in values]
    a, b = "".join(["na", "me"]), "".join(["n", "ame"])
    assert moveit._content([a, a, "name"]) == moveit._content(["name", b, a])


def test_a_date_in_an_object_is_read_over() -> None:
    dated = SCENE.replace(
        "- {id: gone, operation: 1}", "- {id: gone, operation: 1, on: 2026-01-01}"
    )
    assert dated != SCENE
    assert scene_from_moveit(dated).content_hash == scene_from_moveit(SCENE).content_hash


def test_what_is_kept_of_objects_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    moveit._KNOWN.clear()
    monkeypatch.setattr(moveit, "_KNOWN_OBJECTS", 20)
    for n in range(2 * moveit._KNOWN_OBJECTS):
        scene_from_moveit(SCENE.replace("id: 7", f"id: {n}"))
        assert len(moveit._KNOWN) <= moveit._KNOWN_OBJECTS


def test_reads_every_solid() -> None:
    scene = scene_from_moveit(SCENE)
    assert scene.ids == ("crate/0", "crate/1", "can", "7", "floor", "wedge")
    box, ball, can, cone, floor, wedge = (obstacle.shape for obstacle in scene.obstacles)
    assert isinstance(box, Box)
    np.testing.assert_allclose(box.size, [0.1, 0.2, 0.3])
    assert isinstance(ball, Sphere)
    assert ball.radius == 0.25
    assert isinstance(can, Cylinder)
    assert (can.height, can.radius) == (0.14, 0.03)
    assert isinstance(cone, Cone)
    assert (cone.height, cone.radius) == (0.4, 0.1)
    assert isinstance(floor, HalfSpace)
    assert (floor.normal[2], floor.offset) == (1.0, -0.5)
    assert isinstance(wedge, Mesh)
    assert len(wedge.faces) == 4


def test_places_them() -> None:
    scene = scene_from_moveit(SCENE.encode())
    np.testing.assert_allclose(
        scene.obstacle("crate/0").T_world_obstacle, transform(None, [1, 2, 3])
    )
    tilted = scene.obstacle("crate/1").T_world_obstacle
    np.testing.assert_allclose(
        to_quaternion(tilted[:3, :3]), np.array([0.6, 0, 0, 0.8001]) / np.hypot(0.6, 0.8001)
    )
    # The object's pose in its frame, and its frame in the world.
    desk = transform(from_rpy([0.0, 0.0, np.pi / 2]), [0.0, 0.0, 1.0])
    expected = desk @ transform(None, [1.0, 0.0, 1e-5])
    np.testing.assert_allclose(scene.obstacle("can").T_world_obstacle, expected, atol=1e-7)
    np.testing.assert_allclose(scene.obstacle("7").T_world_obstacle, transform(None, [1, 0, 0]))
    np.testing.assert_allclose(from_quaternion([0, 0, 0, 1]), np.eye(3))


def test_allows_the_true_pairs() -> None:
    assert scene_from_moveit(SCENE).allowed_collisions == {("arm", "hand"), ("can", "hand")}


def test_allows_every_part_of_an_object_and_defaults() -> None:
    text = SCENE.replace(
        "    - [false, true, false, true]", "    - [false, true, true, true]"
    ).replace("    - [false, false, false, false]\n", "    - [true, false, false, false]\n", 1)
    text = text.replace(
        "robot_state:",
        "  default_entry_names: [wedge]\n  default_entry_values: [true]\nrobot_state:",
    )
    allowed = scene_from_moveit(text).allowed_collisions
    assert {("crate/0", "hand"), ("crate/1", "hand")} <= allowed
    assert {("hand", "wedge"), ("arm", "wedge"), ("crate/0", "wedge"), ("7", "wedge")} <= allowed


@pytest.mark.parametrize(
    ("first", "second", "allowed"),
    [
        (True, True, True),
        (True, False, False),
        (False, True, False),
        (False, False, False),
    ],
)
def test_a_default_of_false_decides_over_one_of_true(
    first: bool, second: bool, allowed: bool
) -> None:
    # moveit_core/collision_detection: getDefaultEntry of two names is NEVER where either is NEVER.
    defaults = {"entry_names": [], "entry_values": [], "default_entry_names": ["a", "b"]}
    text = json.dumps(
        {
            "world": {
                "collision_objects": [
                    {
                        "id": name,
                        "primitives": [{"type": "sphere", "dimensions": [0.1]}],
                        "primitive_poses": [{"position": [0, 0, 0]}],
                    }
                    for name in "ab"
                ]
            },
            "allowed_collision_matrix": {**defaults, "default_entry_values": [first, second]},
        }
    )
    found = {frozenset(pair) for pair in scene_from_moveit(text).allowed_collisions}
    assert found == ({frozenset("ab")} if allowed else set())


@pytest.mark.parametrize(
    ("fields", "place"),
    [
        ("link_padding: [{link_name: arm, padding: 0.01}]", "link_padding[0] ('arm')"),
        (
            "link_scale: [{link_name: a, scale: 1}, {link_name: b, scale: 1.1}]",
            "link_scale[1] ('b')",
        ),
    ],
)
def test_refuses_padded_links(fields: str, place: str) -> None:
    with pytest.raises(InvalidScene) as raised:
        scene_from_moveit(fields)
    assert place in str(raised.value)
    assert raised.value.hint is not None
    assert "margin" in raised.value.hint


def test_takes_links_that_are_neither_padded_nor_scaled() -> None:
    text = (
        "link_padding: [{link_name: arm, padding: 0.0}]\nlink_scale: [{link_name: arm, scale: 1.0}]"
    )
    assert scene_from_moveit(text).obstacles == ()


def test_an_empty_world_is_an_empty_scene() -> None:
    for text in ("world: {}", "world: {collision_objects: []}", "name: empty"):
        assert scene_from_moveit(text).obstacles == ()


def world(fields: str, name: str = "a") -> str:
    return f"world: {{collision_objects: [{{id: {name}, {fields}}}]}}"


BOX = "primitives: [{type: box, dimensions: [1, 1, 1]}]"
HERE = "primitive_poses: [{position: [0, 0, 0]}]"


@pytest.mark.parametrize(("text", "place"), [
    ("", "planning scene"),
    ("[1, 2]", "planning scene"),
    ("{", "YAML"),
    ("a: 1\na: 2", "occurs twice"),
    ("a: !!python/object/apply:os.system [ls]", "YAML"),
    ("a: 2001-99-99", "YAML"),
    ("world: 3", "world"),
    ("world: {collision_objects: 3}", "world"),
    ("world: {collision_objects: [3]}", "world.collision_objects[0]"),
    (world(f"{BOX}, {HERE}", "yes"), "world.collision_objects[0].id"),
    (world(f"{BOX}, {HERE}", ""), "world.collision_objects[0].id"),
    (world("primitives: []"), "('a'): it has no solid"),
    (world(BOX), "1 primitives, but 0 primitive_poses"),
    (world(f"primitives: [{{type: torus, dimensions: [1]}}], {HERE}"), "type 'torus'"),
    (world(f"primitives: [{{type: true, dimensions: [1]}}], {HERE}"), "primitives[0]"),
    (world(f"primitives: [{{type: box, dimensions: [1, 1]}}], {HERE}"), "primitives[0].dimensions"),
    (world(f"primitives: [{{type: box, dimensions: [1, 1, .nan]}}], {HERE}"), "dimensions[2]"),
    (world(f"primitives: [{{type: box, dimensions: [1, 1, x]}}], {HERE}"), "dimensions[2]"),
    (world(f"primitives: [{{type: box, dimensions: [1, 1, 0]}}], {HERE}"), "along z"),
    (world(f"primitives: [{{type: box, dimensions: [1, 1, true]}}], {HERE}"), "dimensions[2]"),
    (world(f"{BOX}, primitive_poses: [{{position: [0, 0]}}]"), "primitive_poses[0].position"),
    (world(f"{BOX}, primitive_poses: [{{orientation: [0, 0, 0, 2]}}]"), "orientation"),
    (world(f"{BOX}, primitive_poses: [{{rotation: [0, 0, 0, 1]}}]"), "unknown rotation"),
    (world(f"{BOX}, {HERE}, pose: 3"), "pose"),
    (world("meshes: [{vertices: [], triangles: []}], mesh_poses: [{}]"), "meshes[0]"),
    (world("meshes: [{vertices: [[0, 0, 0]], triangles: [[0, 0, 1]]}], mesh_poses: [{}]"), "index"),
    (world("meshes: [{vertices: [[0, 0, 0]], triangles: [[0, 0]]}], mesh_poses: [{}]"), "les[0]"),
    (world("planes: [{coef: [0, 0, 0, 1]}], plane_poses: [{}]"), "planes[0]"),
    (f"world: {{collision_objects: [{{id: a, {BOX}, {HERE}}}, {{id: a, {BOX}, {HERE}}}]}}", "'a'"),
    ("world: {octomap: {octomap: {data: [1, 2]}}}", "octomap"),
    ("robot_state: {attached_collision_objects: [{link_name: hand}]}", "attached"),
    ("allowed_collision_matrix: {entry_names: [a, b], entry_values: [[true]]}", "entry_values"),
    ("allowed_collision_matrix: {entry_names: [a], entry_values: [[1]]}", "entry_values[0]"),
    ("fixed_frame_transforms: [{child_frame_id: a}]", "fixed_frame_transforms[0].transform"),
])  # fmt: skip
def test_tells_where_it_is_malformed(text: str, place: str) -> None:
    with pytest.raises(InvalidScene) as error:
        scene_from_moveit(text)
    assert place in str(error.value)


def test_refuses_what_a_short_text_could_grow_into() -> None:
    bomb = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "\n".join(
        f"{chr(98 + i)}: &{chr(98 + i)} [{', '.join([f'*{chr(97 + i)}'] * 9)}]" for i in range(20)
    )
    for text in (bomb, "a: &a [*a]", "[" * 100_000, "{a: " * 100_000, "- " * 100_000):
        with pytest.raises(InvalidScene):
            scene_from_moveit(text)
    with pytest.raises(InvalidScene, match="at most"):
        scene_from_moveit(b"#" * (16 * 2**20 + 1))
