"""Scenes put into the root frame: which obstacles move, and what is refused."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinematics.errors import InvalidLinkName, InvalidScene
from kinematics.forward import forward
from kinematics.pose import from_rpy, transform
from kinematics.robots import builtin_chain
from obstacles.checker import Checker
from obstacles.moveit import scene_from_moveit
from obstacles.placement import in_frame, only_frame, place
from obstacles.scene import Obstacle, Scene
from obstacles.shapes import Sphere
from planning.problem import JointGoal, Problem
from tests.planning.scenes import builtin

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


def test_a_scene_is_the_same_whichever_name_of_the_root_it_is_given_in() -> None:
    rotations = Rotation.random(50, random_state=0).as_matrix()
    obstacles = [Obstacle(f"{k}", Sphere(0.1), transform(R)) for k, R in enumerate(rotations)]
    scene = Scene(tuple(obstacles))
    again = Scene(tuple(replace(obstacle) for obstacle in obstacles))
    named = place(in_frame(scene, CHAIN.root_link), CHAIN)
    assert again.content_hash == named.content_hash == scene.content_hash


def test_transforms_of_a_moveit_scene_lead_to_a_frame_or_the_root() -> None:
    text = """
fixed_frame_transforms:
  - header: {frame_id: rail}
    child_frame_id: desk
    transform: {translation: [0, 0, 1], rotation: [0, 0, 0, 1]}
  - header: {frame_id: FRAME}
    child_frame_id: rail
    transform: {translation: [2, 0, 0], rotation: [0, 0, 0, 1]}
world:
  collision_objects:
    - id: ball
      header: {frame_id: /desk}
      primitives: [{type: sphere, dimensions: [0.1]}]
      primitive_poses: [{position: [0, 3, 0]}]
"""
    for name, expected in (("hall", "hall"), ("rail", None), ("''", None)):
        (ball,) = scene_from_moveit(text.replace("FRAME", name)).obstacles
        assert ball.frame == expected
        np.testing.assert_allclose(ball.T_world_obstacle[:3, 3], [2, 3, 1])
    with pytest.raises(InvalidScene, match="circle"):
        scene_from_moveit(text.replace("FRAME", "desk"))


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
