"""Scenes as workers keep them: a text that comes again is not read again."""

import pytest

from service.schemas.scene import Scene
from service.storage import worker_cache
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
