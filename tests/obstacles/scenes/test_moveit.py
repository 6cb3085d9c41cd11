"""MoveIt planning scenes and geometry files: what is read, and what is refused."""

import contextlib
import copy
from datetime import date
from typing import Any

import pytest

from kinematics.errors import InvalidScene
from obstacles.scenes import moveit
from obstacles.scenes.moveit import scene_from_moveit
from obstacles.scenes.moveit_geometry import is_geometry_text
from obstacles.shapes.shape import HalfSpace, Mesh

SCENE = """
name: ""
robot_model_name: arm
fixed_frame_transforms:
  - header: {frame_id: world}
    child_frame_id: world
    transform: {translation: [0, 0, 0], rotation: [0, 0, 0, 1]}
  - header: {frame_id: desk}
    child_frame_id: world
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
    assert is_kept == [True, True, True, True, False], "meshes are read anew"
    assert [a is b for a, b in zip(first.obstacles, other.obstacles, strict=True)] == [
        True, True, False, True, False,
    ]  # fmt: skip
    moveit._KNOWN.clear()
    assert scene_from_moveit(moved).content_hash == other.content_hash


def test_objects_of_an_earlier_text_are_kept_where_frames_stand_elsewhere() -> None:
    raised = SCENE.replace("translation: [0, 0, 1]", "translation: [0, 0, 2]")
    first, other = scene_from_moveit(SCENE), scene_from_moveit(raised)
    assert first.obstacle("can") is other.obstacle("can")
    heights = [scene.fixed_frames["desk"][1][2, 3] for scene in (first, other)]
    assert heights == [1.0, 2.0]


def test_objects_that_differ_by_anything_are_told_apart() -> None:
    """Values that are equal to Python are not the same: 1, 1.0 and true; a date is none of them."""
    values: list[Any] = [1, 1.0, True, "1", None, 0.0, -0.0, [1], {"1": 1}, date(2026, 1, 1)]
    keys = [moveit._content({"id": value}) for value in values]
    assert len(set(keys)) == len(values)
    assert keys == [moveit._content(copy.deepcopy({"id": value})) for value in values]
    a, b = "".join(["na", "me"]), "".join(["n", "ame"])
    assert moveit._content([a, a, "name"]) == moveit._content(["name", b, a])


def test_a_date_is_no_name() -> None:
    with pytest.raises(InvalidScene, match=r"world\.collision_objects\[0\]\.id"):
        scene_from_moveit(SCENE.replace("id: crate", "id: 2026-01-01"))


def test_what_is_kept_of_objects_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    moveit._KNOWN.clear()
    monkeypatch.setattr(moveit, "_KNOWN_OBJECTS", 20)
    for n in range(2 * moveit._KNOWN_OBJECTS):
        scene_from_moveit(SCENE.replace("id: 7", f"id: {n}"))
        assert len(moveit._KNOWN) <= moveit._KNOWN_OBJECTS


def test_reads_planes_and_meshes() -> None:
    scene = scene_from_moveit(SCENE)
    assert scene.ids == ("crate", "can", "7", "floor", "wedge")
    assert scene.allowed_collisions == {("arm", "hand"), ("can", "hand")}
    floor, wedge = (obstacle.shape for obstacle in scene.obstacles[-2:])
    assert isinstance(floor, HalfSpace)
    assert (floor.normal[2], floor.offset) == (1.0, -0.5)
    assert isinstance(wedge, Mesh)
    assert len(wedge.faces) == 4


def test_what_is_odd_is_told_once_for_all_objects() -> None:
    notes = scene_from_moveit(SCENE).notes
    assert notes == (
        "fields of the planning scene that are not obeyed: robot_state.joint_state.position",
        "world.collision_objects[5] removes 'gone', which is not there",
        (
            "collision object(s) 'crate', '7', 'floor', 'wedge': no frame (header.frame_id): taken "
            "in the robot's root frame, where MoveIt refuses it"
        ),
    )
    flat = SCENE.replace("orientation: {x: 0, y: 0, z: 0, w: 1}", "orientation: {}")
    turned = flat.replace("orientation: [0.6, 0, 0, 0.8001]", "orientation: [0, 0, 3, 4]")
    first = "position: [1, 2, 3], orientation: "
    told = scene_from_moveit(turned.replace(f"{first}[0, 0, 0, 1]", f"{first}[0, 0, 0, 0]")).notes
    assert (
        "collision object(s) 'crate': an orientation of zeros: no rotation, as MoveIt takes it"
        in told
    )
    assert any(line.startswith("collision object(s) 'crate': an orientation that") for line in told)
    half = SCENE.replace("- [true, true, false, false]", "- [false, true, false, false]")
    (line,) = (line for line in scene_from_moveit(half).notes if "halves" in line)
    assert "hand and arm" in line


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


def test_an_empty_world_is_an_empty_scene() -> None:
    for text in ("world: {}", "world: {collision_objects: []}", "name: empty"):
        assert scene_from_moveit(text).obstacles == ()


@pytest.mark.parametrize(
    ("form", "ids"),
    [
        ("world: {collision_objects: [A, B]}", ["a", "b"]),
        ("world: {collision_objects: [A, A]}", ["a"]),
        ("collision_objects: [A]\noctomap: {octomap: {data: []}}", ["a"]),  # PlanningSceneWorld
        ("scene: {world: {collision_objects: [A]}}", ["a"]),  # of the service get_planning_scene
        ("world: {collision_objects: [A, B, {id: a, operation: 1}]}", ["b"]),
        ('world: {collision_objects: [A, {id: a, operation: "\\x01"}]}', []),  # ros2 topic echo
        ("world: {collision_objects: [A, B, {operation: 1}]}", []),
        ("name: x\nworld: {collision_objects: [A]}\n---\n", ["a"]),
    ],
)
def test_objects_are_those_that_are_left_at_the_end(form: str, ids: list[str]) -> None:
    for letter in "AB":
        item = f"{{id: {letter.lower()}, header: {{frame_id: world}}, {BOX}, {HERE}}}"
        form = form.replace(letter, item)
    assert list(scene_from_moveit(form).ids) == ids


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
    (world(f"{BOX}, primitive_poses: [{{}}, {{}}]"), "1 primitives, but 2 primitive_poses"),
    (world(f"{BOX}, primitve_poses: [{{}}]"), "unknown primitve_poses"),
    (world(f"{BOX}, {HERE}, operation: 3"), "operation 3"),
    (world(f"{BOX}, {HERE}, operation: 5"), "operation"),
    (world(f"{BOX}, {HERE}, header: {{frame: a}}"), "unknown frame"),
    (world(f"{BOX}, {HERE}, header: {{frame_id: tool}}"), "'tool'"),
    (world(f"{BOX}, {HERE}, subframe_names: [a]"), "subframe_names"),
    ("wrold: {collision_objects: []}", "unknown wrold"),
    ("scene: {a: 1}", "unknown a"),
    ("{name: a}\n---\n{name: b}\n---\n", "2 documents"),
    (("robot_state: {multi_dof_joint_state: {joint_names: [base], transforms: "
     "[{translation: [0, 0, 1]}]}}"), "joint 'base' has moved the robot"),
    (world(f"primitives: [{{type: torus, dimensions: [1]}}], {HERE}"), "type 'torus'"),
    (world(f"primitives: [{{type: true, dimensions: [1]}}], {HERE}"), "primitives[0]"),
    (world(f"primitives: [{{type: box, dimensions: [1, 1]}}], {HERE}"), "primitives[0].dimensions"),
    (world(f"primitives: [{{type: box, dimensions: [1, 1, .nan]}}], {HERE}"), "dimensions[2]"),
    (world(f"primitives: [{{type: box, dimensions: [1, 1, x]}}], {HERE}"), "dimensions[2]"),
    (world(f"primitives: [{{type: box, dimensions: [1, 1, 0]}}], {HERE}"), "along z"),
    (world(f"primitives: [{{type: box, dimensions: [1, 1, true]}}], {HERE}"), "dimensions[2]"),
    (world(f"{BOX}, primitive_poses: [{{position: [0, 0]}}]"), "primitive_poses[0].position"),
    (world(f"{BOX}, primitive_poses: [{{orientation: [0, 0, 1e-99, 0]}}]"), "orientation"),
    (world(f"{BOX}, primitive_poses: [{{orientation: {{z: 0.7}}}}]"), "w is left out"),
    (world(f"{BOX}, primitive_poses: [{{rotation: [0, 0, 0, 1]}}]"), "unknown rotation"),
    (world(f"{BOX}, {HERE}, pose: 3"), "pose"),
    (world("meshes: [{vertices: [], triangles: []}], mesh_poses: [{}]"), "meshes[0]"),
    (world("meshes: [{vertices: [[0, 0, 0]], triangles: [[0, 0, 1]]}], mesh_poses: [{}]"), "index"),
    (world("meshes: [{vertices: [[0, 0, 0]], triangles: [[0, 0]]}], mesh_poses: [{}]"), "les[0]"),
    (world("planes: [{coef: [0, 0, 0, 1]}], plane_poses: [{}]"), "planes[0]"),
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
    for text in (
        bomb,
        "a: &a [*a]",
        "name: &a x\nrobot_model_name: *b",
        "[" * 100_000,
        "{a: " * 100_000,
        "- " * 100_000,
    ):
        with pytest.raises(InvalidScene):
            scene_from_moveit(text)
    with pytest.raises(InvalidScene, match="at most"):
        scene_from_moveit(b"#" * (16 * 2**20 + 1))


#: As older versions write it: shapes have their poses in the planning frame.
OLD = """kitchen (noname)+
* table top
1
box
0.6 1.2 0.04
0.7 0 0.38
0 0 0.3826834 0.9238795
0 0 0 0
* post
2
cylinder
0.05 0.8
0.4 0.3 0.4
0 0 0 1
0.5 0.5 0.5 1
cone
0.1 0.3
0.4 0.3 0.95
0 1 0 0
0 0 0 0
.
"""
#: As newer ones do: objects have a pose, and subframes.
NEW = """
* Ball_0
0.5 -0.25 1
0 0 0.7071068 0.7071068
2
sphere
0.125
0.1 0 0
0 0 0 1
0 1 0 1
plane
0 0 2 -0.5
0 0 0
0 0 0 1
0 0 0 0
2
handle
0 0 0.1
0 0 0 1
lid
0 0 0
1 0 0 0
* wedge
0 0 1
0 0 0 1
1
mesh
4 4
0 0 0
1e-1 0 0
0 .1 0
0 0 1.0E-1
0 2 1
0 1 3
0 3 2
1 2 3
0 0 2
0 0 0 1
0 0 0 0
0
.
"""


#: What the files above say.
SAME = {
    OLD: """
world:
  collision_objects:
    - id: table top
      primitives: [{type: box, dimensions: [0.6, 1.2, 0.04]}]
      primitive_poses:
        - {position: [0.7, 0, 0.38], orientation: [0, 0, 0.3826834, 0.9238795]}
    - id: post
      primitives: [{type: cylinder, dimensions: [0.8, 0.05]}, {type: cone, dimensions: [0.3, 0.1]}]
      primitive_poses:
        - {position: [0.4, 0.3, 0.4], orientation: [0, 0, 0, 1]}
        - {position: [0.4, 0.3, 0.95], orientation: [0, 1, 0, 0]}
""",
    NEW: """
world:
  collision_objects:
    - id: Ball_0
      pose: {position: [0.5, -0.25, 1], orientation: [0, 0, 0.7071068, 0.7071068]}
      primitives: [{type: sphere, dimensions: [0.125]}]
      primitive_poses: [{position: [0.1, 0, 0], orientation: [0, 0, 0, 1]}]
      planes: [{coef: [0, 0, 2, -0.5]}]
      plane_poses: [{position: [0, 0, 0], orientation: [0, 0, 0, 1]}]
    - id: wedge
      pose: {position: [0, 0, 1], orientation: [0, 0, 0, 1]}
      meshes:
        - vertices: [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]
          triangles: [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
      mesh_poses: [{position: [0, 0, 2], orientation: [0, 0, 0, 1]}]
""",
}


@pytest.mark.parametrize("text", [OLD, NEW], ids=["old", "new"])
def test_a_file_says_the_same_as_the_yaml_of_its_scene(text: str) -> None:
    assert scene_from_moveit(text).content_hash == scene_from_moveit(SAME[text]).content_hash


def test_line_ends_and_files_without_objects() -> None:
    windows = OLD.replace("\n", "\r\n")
    assert scene_from_moveit(windows).content_hash == scene_from_moveit(OLD).content_hash
    assert scene_from_moveit("empty\n.\n").obstacles == ()


def test_an_object_that_comes_twice_is_refused() -> None:
    again = OLD[OLD.index("* table") : OLD.index("* post")]
    with pytest.raises(InvalidScene, match="table top"):
        scene_from_moveit(OLD.replace("* post", again + "* post"))


def test_yaml_is_never_taken_for_a_file() -> None:
    assert is_geometry_text(OLD)
    for text in ("", "name: a\nworld: {}", "- a\n- b", "name: a\n.\nb: 2", "a\n*b", "* a\n1\n"):
        assert not is_geometry_text(text)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (".\n", "", "ends where '\\*' or '.' is needed"),
        ("0.6 1.2 0.04", "0.6 1.2", "line 9: the colour: '\\*' is no finite number"),
        ("0.6 1.2 0.04", "0.6 -1.2 0.04", "line 5"),
        ("0.6 1.2", "nan 1.2", "line 5: the size of a box: 'nan'"),
        ("0.6 1.2", "1e999 1.2", "no finite number"),
        ("0.6 1.2", "0_6 1.2", "no finite number"),
        ("0 1 0 0", "0 1 1 0", "line 19: quaternion"),
        ("box", "octree", "object 'table top' has a shape 'octree'"),
        ("* post\n2", "* post\n0", "object 'post' has no shape"),
        ("* post\n2", "* post\n3", "shape '\\.'"),
        ("* post\n2", "* post\n-1", "no whole number"),
        ("* post", "*  ", "line 10"),
        ("* post", "+ post", "in place of"),
        (".\n", ".\n* more\n", "behind the end"),
    ],
)
def test_faults_are_told_with_their_line(old: str, new: str, words: str) -> None:
    assert old in OLD
    with pytest.raises(InvalidScene, match=words):
        scene_from_moveit(OLD.replace(old, new, 1) if old != ".\n" else OLD[:-2] + new)


@pytest.mark.parametrize("text", [OLD, NEW])
def test_cut_and_changed_files_never_escape(text: str) -> None:
    data = text.encode()
    for end in range(len(data) - 2):
        with pytest.raises(InvalidScene):
            scene_from_moveit(data[:end])
    for i in range(len(data)):
        changed = data[:i] + bytes([(data[i] * 7 + i) % 256]) + data[i + 1 :]
        with contextlib.suppress(InvalidScene):
            scene_from_moveit(changed)
