"""Scenes as workers keep them: a text that comes again is not read again."""

import numpy as np
import pytest

from armwright_wire.scenes.scene import Scene
from kinematics.errors import InvalidLinkName
from kinematics.forward import forward
from kinematics.robots import builtin_chain
from obstacles.scenes.placement import in_frame, place
from service.storage.caches import worker_cache
from service.translate import poses

TEXT = """
world:
  collision_objects:
    - id: box
      pose: {position: [0.5, 0.0, %s], orientation: [0.0, 0.0, 0.0, 1.0]}
      primitives: [{type: box, dimensions: [0.1, 0.2, 0.3]}]
      primitive_poses: [{position: [0.0, 0.0, 0.0], orientation: [0.0, 0.0, 0.0, 1.0]}]
"""


def test_the_text_of_a_scene_is_read_once(monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[str] = []
    original = poses.scene

    def note(source: Scene) -> object:
        read.append(source.moveit or "")
        return original(source)

    monkeypatch.setattr(poses, "scene", note)
    first = Scene(moveit=TEXT % "0.25")
    made = worker_cache.scene(first)
    assert made == original(first)
    assert worker_cache.scene(Scene(moveit=TEXT % "0.25")) is made
    assert len(read) == 1
    # Whatever else a scene says is part of what it is known by.
    others = [
        Scene(moveit=TEXT % "0.5"),
        Scene(moveit=TEXT % "0.25", frame="panda_link0"),
        Scene(moveit=TEXT % "0.25", allowed_collisions=[["box", "panda_hand"]]),
    ]
    for number, other in enumerate(others):
        assert worker_cache.scene(other) == original(other)
        assert len(read) == 2 + number


def text_in(*frames: str) -> str:
    """A scene with a box in each frame."""
    boxes = "".join(
        f"\n    - id: box_{frame}\n      header: {{frame_id: {frame}}}"
        "\n      primitives: [{type: box, dimensions: [0.1, 0.2, 0.3]}]"
        "\n      primitive_poses: [{position: [0.4, 0.1, 0.2], orientation: [0, 0, 0, 1]}]"
        for frame in frames
    )
    return f"world:\n  collision_objects:{boxes}\n"


def test_a_scene_that_is_kept_is_kept_in_the_root_frame_too() -> None:
    panda, ur5e = builtin_chain("panda"), builtin_chain("ur5e")
    source = Scene(moveit=text_in("panda_link0", "world"))
    placed = worker_cache.placed_scene(source, None, panda, None)
    assert placed == place(poses.scene(source), panda)
    assert worker_cache.placed_scene(source, None, panda, np.zeros(7)) is placed
    # Another robot has other frames.
    with pytest.raises(InvalidLinkName, match="panda_link0"):
        worker_cache.placed_scene(source, None, ur5e, None)
    # Obstacles that name no frame are in that of the request.
    rootless = Scene(moveit=TEXT % "0.75")
    for frame in (None, "panda_link0", "world"):
        expected = poses.scene(rootless)
        if frame is not None:
            expected = place(in_frame(expected, frame), panda)
        assert worker_cache.placed_scene(rootless, frame, panda, None) == expected


def test_what_is_at_the_tool_is_placed_for_each_request() -> None:
    panda = builtin_chain("panda")
    sphere = {"type": "sphere", "radius": 0.1}
    poses_of = {"at": {"position": [0.1, 0.2, 0.3], "frame": "tool"}, "by": {"position": [1, 0, 0]}}
    obstacles = [{"id": name, "shape": sphere, "pose": pose} for name, pose in poses_of.items()]
    source = Scene.model_validate({"obstacles": obstacles})
    drawn = np.random.default_rng(3).uniform(-1.0, 1.0, (4, 7))
    for q in drawn:
        placed = worker_cache.placed_scene(source, None, panda, q)
        expected = forward(panda, q) @ poses.scene(source).obstacles[0].T_world_obstacle
        np.testing.assert_allclose(placed.obstacles[0].T_world_obstacle, expected, atol=1e-12)
    with pytest.raises(InvalidLinkName, match="where the tool is"):
        worker_cache.placed_scene(source, None, panda, None)


def test_inline_obstacles_are_made_once() -> None:
    def body(height: float) -> Scene:
        sphere = {"type": "sphere", "radius": 0.1}
        pose = {"position": [0.5, 0.0, height]}
        return Scene.model_validate({"obstacles": [{"id": "a", "shape": sphere, "pose": pose}]})

    made = worker_cache.scene(body(0.25))
    assert worker_cache.scene(body(0.25)) is made
    other = worker_cache.scene(body(0.5))
    assert other == poses.scene(body(0.5)) != made


def test_another_text_with_the_same_obstacles_is_the_same_scene() -> None:
    panda = builtin_chain("panda")
    first, second = (f"name: {name}\n{text_in('panda_link0')}" for name in ("one", "two"))
    made = worker_cache.scene(Scene(moveit=first))
    assert worker_cache.scene(Scene(moveit=second)) is made
    placed = worker_cache.placed_scene(Scene(moveit=first), None, panda, None)
    assert worker_cache.placed_scene(Scene(moveit=second), None, panda, None) is placed


def test_nothing_around_a_robot_is_always_the_same() -> None:
    assert worker_cache.scene(None) is worker_cache.scene(None)
    assert not worker_cache.scene(None).obstacles
