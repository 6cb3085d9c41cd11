"""Scenes: immutable, named, hashed by content, and put into the root frame."""

import math
import pickle
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinematics.errors import InvalidLinkName, InvalidObjectName, InvalidScene
from kinematics.forward import forward
from kinematics.pose import from_matrix, from_rpy, transform
from kinematics.robots import builtin_chain
from obstacles.collision.checker import Checker
from obstacles.scenes.moveit import scene_from_moveit
from obstacles.scenes.placement import in_frame, only_frame, place, with_objects
from obstacles.scenes.scene import AllowedContact, Obstacle, Scene
from obstacles.shapes.shape import Box, PointCloud, Sphere
from planning.problem import JointGoal, Problem
from tests.obstacles.solids import random_transform
from tests.planning.scenes import builtin

UNIT = Box(np.array([1.0, 1.0, 1.0]))


def test_pieces_are_in_the_world_and_know_their_obstacle() -> None:
    T = random_transform(np.random.default_rng(0))
    cloud = PointCloud(np.array([[1.0, 0, 0], [0, 1, 0]]), 0.1)
    scene = Scene((Obstacle("a", UNIT, margin=0.02), Obstacle("b", cloud, T)))
    arrays, owners, margins = scene.pieces()
    assert owners.tolist() == [0, 1, 1]
    assert margins.tolist() == [0.02, 0.0, 0.0]
    np.testing.assert_allclose(arrays.centers[1:], cloud.points @ T[:3, :3].T + T[:3, 3])


def test_an_id_may_occur_once() -> None:
    with pytest.raises(InvalidScene, match="'a'"):
        Scene((Obstacle("a", UNIT), Obstacle("b", UNIT), Obstacle("a", Sphere(1.0))))


@pytest.mark.parametrize("name", ["", "x" * 300, 3, None])
def test_refuses_a_name(name: Any) -> None:
    with pytest.raises(InvalidScene, match="obstacle id"):
        Obstacle(name, UNIT)


@pytest.mark.parametrize("margin", [-0.1, np.nan, np.inf])
def test_refuses_a_margin(margin: float) -> None:
    with pytest.raises(InvalidScene, match="margin"):
        Obstacle("a", UNIT, margin=margin)


def test_an_unknown_obstacle_is_told_with_those_there_are() -> None:
    scene = Scene((Obstacle("table", UNIT),))
    assert scene.obstacle("table").id == "table"
    with pytest.raises(InvalidObjectName) as error:
        scene.obstacle("tabel")
    assert "table" in str(error.value.hint)


def test_allowed_pairs_have_no_order() -> None:
    scene = Scene((), frozenset({("b", "a")}))
    assert scene.allows("a", "b")
    assert scene.allows("b", "a")
    assert not scene.allows("a", "c")
    assert scene == Scene((), frozenset({("a", "b")}))
    with pytest.raises(InvalidScene):
        Scene((), frozenset({("a",)}))


def test_the_hash_follows_the_content() -> None:
    base = Scene((Obstacle("a", UNIT), Obstacle("b", Sphere(1.0))))
    same = Scene((Obstacle("a", Box(np.ones(3)), np.eye(4)), Obstacle("b", Sphere(1.0))))
    assert base == same
    assert hash(base) == hash(same)
    assert pickle.loads(pickle.dumps(base)) == base
    others = [
        Scene((Obstacle("a", UNIT), Obstacle("c", Sphere(1.0)))),
        Scene((Obstacle("a", UNIT), Obstacle("b", Sphere(1.5)))),
        Scene((Obstacle("a", UNIT), Obstacle("b", Sphere(1.0), np.eye(4), 0.1))),
        Scene((Obstacle("a", UNIT, transform(None, [0, 0, 1e-9])), Obstacle("b", Sphere(1.0)))),
        Scene(base.obstacles, frozenset({("a", "b")})),
    ]
    assert len({scene.content_hash for scene in [base, *others]}) == len(others) + 1


@pytest.mark.parametrize("place", [(0, 0), (1, 2), (0, 3), (2, 3)])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e308, 2e4])
def test_poses_that_are_no_rigid_motions_are_refused(place: tuple[int, int], value: float) -> None:
    T = np.eye(4)
    T[place] = value
    with pytest.raises(InvalidScene):
        Obstacle("a", Sphere(0.1), T)


def test_mirrors_are_refused_and_rotations_keep_their_bits() -> None:
    with pytest.raises(InvalidScene):
        Obstacle("a", Sphere(0.1), np.diag([1.0, 1.0, -1.0, 1.0]))
    for R in Rotation.random(200, random_state=2).as_matrix():
        T = transform(from_matrix(R), [0.1, 0.2, 0.3])
        placed = Obstacle("a", Sphere(0.1), T).T_world_obstacle
        assert placed.tobytes() == T.tobytes()
        assert not placed.flags.writeable


@pytest.mark.parametrize("depth", [-1e-9, -1.0, float("nan"), float("-inf")])
def test_a_depth_of_contact_is_a_number_from_zero_on(depth: float) -> None:
    with pytest.raises(InvalidScene, match="touch_depth"):
        Scene(contacts={("a", "b"): AllowedContact("request", depth)})


CHAIN = builtin_chain("panda")
Q = np.array([0.1, -0.7, 0.2, -2.0, 0.1, 1.5, 0.4])
T = transform(from_rpy([0.1, 0.2, 0.3]), [0.1, 0.0, 0.05])
ROOT = Obstacle("root", Sphere(0.1), T)
TOOL = Obstacle("tool", Sphere(0.1), T, 0.01, "tool")


def test_only_what_names_a_frame_moves() -> None:
    scene = Scene((ROOT, TOOL), frozenset({("root", "panda_hand")}))
    assert scene.frames == {"tool"}
    placed = place(scene, CHAIN, Q)
    assert placed.frames == frozenset()
    assert placed.obstacles[0] is ROOT
    np.testing.assert_allclose(
        placed.obstacles[1].T_world_obstacle, forward(CHAIN, Q) @ T, atol=1e-15
    )
    assert placed.obstacles[1].margin == 0.01
    assert placed.allowed_collisions == scene.allowed_collisions
    assert place(placed, CHAIN) is placed


def test_a_scene_with_frames_has_a_hash_of_its_own_and_survives_pickling() -> None:
    scene = Scene((TOOL,))
    copy = pickle.loads(pickle.dumps(scene))
    assert copy == scene
    assert copy.frames == {"tool"}
    assert scene != Scene((Obstacle("tool", Sphere(0.1), T, 0.01),))


def test_a_default_frame_is_for_those_that_name_none() -> None:
    scene = in_frame(Scene((ROOT, TOOL)), "panda_link0")
    assert [obstacle.frame for obstacle in scene.obstacles] == ["panda_link0", "tool"]
    with pytest.raises(InvalidScene, match="several frames"):
        only_frame(scene)
    assert only_frame(Scene((TOOL,))) == "tool"
    assert only_frame(Scene((ROOT,))) is None


def test_checkers_and_proofs_refuse_what_is_not_placed() -> None:
    robot, scene = builtin("panda"), Scene((TOOL,))
    with pytest.raises(InvalidScene, match="root frame"):
        Checker.of(robot, scene).valid(Q)
    problem = Problem(robot, scene, Q, (JointGoal(Q),))
    assert problem.scene.frames == frozenset()
    with pytest.raises(InvalidLinkName, match="'tool'"):
        place(scene, CHAIN)


def transforms(*entries: tuple[str, str, str]) -> str:
    """A MoveIt scene with a ball in the frame FRAME, and transforms (frame, child, translation)."""
    listed = "".join(
        f"  - header: {{frame_id: {frame}}}\n    child_frame_id: {child}\n"
        f"    transform: {{translation: {translation}, rotation: [0, 0, 0, 1]}}\n"
        for frame, child, translation in entries
    )
    return (
        f"fixed_frame_transforms:\n{listed}world:\n  collision_objects:\n    - id: ball\n"
        "      header: {frame_id: FRAME}\n"
        "      primitives: [{type: sphere, dimensions: [0.1]}]\n"
        "      primitive_poses: [{position: [0, 3, 0]}]\n"
    )


@pytest.mark.parametrize(
    ("frame", "position"),
    [
        ("panda_link0", [0, 3, 0]),
        ("/panda_link0", [0, 3, 0]),
        ("desk", [0, 3, 1]),
        ("/desk", [0, 3, 1]),
        ("world", [0, 3, -0.9]),  # the file says where it is, before any custom of ours
    ],
)
def test_frames_of_a_moveit_scene_are_given_in_the_planning_frame(
    frame: str, position: list[float]
) -> None:
    # moveit/moveit, moveit_core/transforms: copyTransforms writes the planning frame as child.
    text = transforms(
        ("panda_link0", "panda_link0", "[0, 0, 0]"),
        ("desk", "panda_link0", "[0, 0, 1]"),
        ("world", "panda_link0", "[0, 0, -0.9]"),
    )
    scene = scene_from_moveit(text.replace("FRAME", frame))
    (ball,) = place(pickle.loads(pickle.dumps(scene)), CHAIN).obstacles
    np.testing.assert_allclose(ball.T_world_obstacle[:3, 3], position)
    (kept,) = place(in_frame(scene, "panda_link1"), CHAIN).obstacles
    np.testing.assert_allclose(kept.T_world_obstacle[:3, 3], position)


def test_frames_that_tf_has_the_other_way_round_are_told() -> None:
    text = transforms(("panda_link0", "desk", "[0, 0, 1]"), ("desk", "shelf", "[1, 0, 0]"))
    with pytest.raises(
        InvalidScene, match=r"'desk' .*in 'shelf' .*not the planning frame"
    ) as error:
        place(scene_from_moveit(text.replace("FRAME", "desk")), CHAIN)
    assert "not the other way round as tf does" in (error.value.hint or "")
    with pytest.raises(InvalidLinkName, match=r"'shelf'.*child_frame_id"):
        place(scene_from_moveit(text.replace("FRAME", "shelf")), CHAIN)
    (ball,) = place(scene_from_moveit(text.replace("FRAME", "panda_link0")), CHAIN).obstacles
    np.testing.assert_allclose(ball.T_world_obstacle[:3, 3], [0, 3, 0])
    tf = transforms(("panda_link0", "world", "[0, 0, 0.9]"))
    with pytest.raises(InvalidScene, match="pose of a link in 'world', as tf does"):
        place(scene_from_moveit(tf.replace("FRAME", "world")), CHAIN)


def test_a_frame_of_a_file_is_part_of_its_scene() -> None:
    first, second = (
        scene_from_moveit(transforms(("desk", "panda_link0", T)).replace("FRAME", "desk"))
        for T in ("[0, 0, 1]", "[0, 0, 2]")
    )
    assert first.content_hash != second.content_hash
    assert place(first, CHAIN).content_hash != place(second, CHAIN).content_hash


def test_solids_are_one_object_where_they_are_named_as_one() -> None:
    solids = [Obstacle(f"mug/{k}", Sphere(0.1 + k), T + 0.0, 0.01 * k) for k in range(3)]
    scene = Scene((ROOT, solids[2], solids[0], solids[1]))
    assert with_objects(scene, ["root", "mug/0", "cup"]) is scene
    one = with_objects(scene, ["root", "mug"])
    assert one.ids == ("root", "mug")
    mug = one.obstacle("mug")
    assert mug.margin == 0.02
    np.testing.assert_array_equal(mug.T_world_obstacle, T)
    assert [piece.offset_radius for piece in mug.pieces()] == [0.1, 1.1, 2.1]
    centers = [piece.T_owner_piece[:3, 3] for piece in mug.pieces()]
    np.testing.assert_allclose(centers, [T[:3, 3]] * 3, atol=1e-12)
    assert with_objects(Scene((ROOT, *solids[1:])), ["mug"]).ids == ("root", "mug/1", "mug/2")


def test_what_is_in_the_root_frame_by_name_keeps_every_bit() -> None:
    pose = transform(from_rpy([0.3, -0.2, 0.9]), [0.4, -0.1, 0.2])
    bare = Scene((Obstacle("a", Sphere(0.1), pose, 0.02),))
    named = in_frame(bare, CHAIN.root_link)
    assert named.content_hash != bare.content_hash
    placed = place(named, CHAIN)
    assert placed.content_hash == bare.content_hash
    assert placed.obstacles[0].T_world_obstacle.tobytes() == pose.tobytes()
    with pytest.raises(InvalidScene, match="frame of obstacle 'a'"):
        in_frame(bare, "")
