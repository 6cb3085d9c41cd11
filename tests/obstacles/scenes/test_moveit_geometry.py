"""Geometry files of MoveIt, written here in the order in which MoveIt writes them."""

import contextlib

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinematics.errors import InvalidScene
from obstacles.scenes.moveit import scene_from_moveit
from obstacles.scenes.moveit_geometry import is_geometry_text
from obstacles.shapes.shape import Box, Compound, Cone, Cylinder, HalfSpace, Mesh, Sphere

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
0 0 0
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


def test_shapes_of_older_files_are_where_their_own_poses_are() -> None:
    table, lamp = scene_from_moveit(OLD).obstacles
    assert [item.id for item in (table, lamp)] == ["table top", "post"]
    assert isinstance(table.shape, Box)
    assert isinstance(lamp.shape, Compound)
    post, cap = lamp.shape.solids
    assert isinstance(post, Cylinder)
    assert isinstance(cap, Cone)
    np.testing.assert_array_equal(table.shape.size, [0.6, 1.2, 0.04])
    assert (post.radius, post.height) == (0.05, 0.8)
    assert (cap.radius, cap.height) == (0.1, 0.3)
    turned = Rotation.from_euler("z", np.pi / 4).as_matrix()
    np.testing.assert_allclose(table.T_world_obstacle[:3, :3], turned, atol=1e-6)
    np.testing.assert_array_equal(lamp.T_world_obstacle, np.eye(4))
    np.testing.assert_array_equal(lamp.shape.poses[1][:3, 3], [0.4, 0.3, 0.95])
    assert {item.frame for item in (table, lamp)} == {None}


def test_shapes_of_newer_files_are_placed_by_their_objects() -> None:
    ball, wedge = scene_from_moveit(NEW.encode()).obstacles
    assert [item.id for item in (ball, wedge)] == ["Ball_0", "wedge"]
    assert isinstance(ball.shape, Compound)
    sphere, ground = ball.shape.solids
    assert isinstance(sphere, Sphere)
    assert isinstance(ground, HalfSpace)
    assert sphere.radius == 0.125
    # 0.1 m along x of an object that is turned by a quarter about z.
    center = (ball.T_world_obstacle @ ball.shape.poses[0])[:3, 3]
    np.testing.assert_allclose(center, [0.5, -0.15, 1.0], atol=1e-7)
    # 2 z - 0.5 <= 0, seen from the object: up to z = 0.25 above it.
    assert (ground.normal[2], ground.offset) == (1.0, 0.25)
    assert isinstance(wedge.shape, Compound), "its solid stands above the origin of the object"
    ((solid,), (T,)) = wedge.shape.solids, wedge.shape.poses
    assert isinstance(solid, Mesh)
    np.testing.assert_array_equal(solid.vertices[3], [0.0, 0.0, 0.1])
    np.testing.assert_array_equal(solid.faces[0], [0, 2, 1])
    np.testing.assert_array_equal((wedge.T_world_obstacle @ T)[:3, 3], [0.0, 0.0, 2.0])


def test_a_file_says_the_same_as_the_yaml_of_its_scene() -> None:
    yaml = """
world:
  collision_objects:
    - id: Ball_0
      pose: {position: [0.5, -0.25, 1], orientation: [0, 0, 0.7071068, 0.7071068]}
      primitives: [{type: sphere, dimensions: [0.125]}]
      primitive_poses: [{position: [0.1, 0, 0], orientation: [0, 0, 0, 1]}]
      planes: [{coef: [0, 0, 2, -0.5]}]
      plane_poses: [{position: [0, 0, 0], orientation: [0, 0, 0, 1]}]
"""
    shorter = NEW[: NEW.index("* wedge")] + ".\n"
    assert scene_from_moveit(shorter).content_hash == scene_from_moveit(yaml).content_hash


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
