"""Caches, prepared files and scenes as workers keep them."""

import base64
import os
from collections import OrderedDict
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from armwright_wire.scenes.scene import Scene as SentScene
from kinematics.errors import InvalidLinkName
from kinematics.robots import builtin_chain
from obstacles.scenes.placement import in_frame, place
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box
from service.storage.caches import disk_cache, prepared_files, worker_cache
from service.storage.caches.cache_key import NotPrepared, Reference
from service.storage.caches.disk_cache import PreparedRobot
from service.storage.caches.recent import Recent
from service.translate import poses
from tests.planning.scenes import builtin
from tests.service.conftest import Served
from tests.service.robots import HOME, answer, bench, scene
from tests.service.test_check import Mesh, elbow


def random_scene(count: int = 100) -> Scene:
    rng = np.random.default_rng(5)
    obstacles = []
    for i, R in enumerate(Rotation.random(count, rng).as_matrix()):
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = R, rng.uniform(-2.0, 2.0, 3)
        obstacles.append(Obstacle(f"box {i}", Box(rng.uniform(0.1, 1.0, 3)), T, 0.01))
    return Scene(tuple(obstacles), frozenset({("box 0", "box 1")}))


def stored(folder: Path, name: str = "random") -> Reference:
    return Reference("scene", name, prepared_files.document_hash(name.encode()), str(folder))


def read_scene(reference: Reference) -> Scene:
    return disk_cache.read_scene_and_size(reference)[0]


def test_a_scene_comes_back_equal_in_every_bit(tmp_path: Path) -> None:
    scene = random_scene()
    disk_cache.write(stored(tmp_path), scene)
    back = read_scene(stored(tmp_path))
    assert back.content_hash == scene.content_hash
    assert back.allowed_collisions == scene.allowed_collisions
    for before, after in zip(scene.obstacles, back.obstacles, strict=True):
        assert after.id == before.id
        assert after.margin == before.margin
        assert after.T_world_obstacle.tobytes() == before.T_world_obstacle.tobytes()
        assert not after.T_world_obstacle.flags.writeable


def test_a_robot_comes_back_equal(tmp_path: Path) -> None:
    geometry = builtin("planar_rr")
    reference = Reference("robot", "arm", "0" * 64, str(tmp_path / "new" / "folder"))
    disk_cache.write(reference, PreparedRobot.of(geometry, b'{"name": "arm"}'))
    back = disk_cache.read_robot(reference)
    assert back.answer == b'{"name": "arm"}'
    assert back.geometry.content_hash == geometry.content_hash
    assert back.chain.content_hash == geometry.chain.content_hash


def test_nothing_unusable_is_trusted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    reference = stored(tmp_path)
    with pytest.raises(NotPrepared) as missing:
        read_scene(reference)
    assert missing.value.reference == reference
    disk_cache.write(reference, random_scene(2))
    (file,) = tmp_path.iterdir()
    content = file.read_bytes()
    file.write_bytes(content[: len(content) // 2])
    with pytest.raises(NotPrepared):
        read_scene(reference)
    for bit in range(0, 8 * len(content), 97):
        flipped = bytearray(content)
        flipped[bit // 8] ^= 1 << bit % 8
        file.write_bytes(flipped)
        with pytest.raises(NotPrepared):
            read_scene(reference)
    file.write_bytes(content)
    assert len(read_scene(reference).obstacles) == 2
    monkeypatch.setattr(disk_cache, "_format", lambda: "of another version")
    with pytest.raises(NotPrepared):
        read_scene(reference)


def test_forgetting_removes_the_file_and_may_be_repeated(tmp_path: Path) -> None:
    disk_cache.write(stored(tmp_path), random_scene(1))
    disk_cache.write(stored(tmp_path, "other"), random_scene(1))
    for _ in range(2):
        prepared_files.forget(stored(tmp_path))
    assert len(list(tmp_path.iterdir())) == 1
    assert read_scene(stored(tmp_path, "other")).ids


COUNT, BYTES = 4, 100


@given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 150)), max_size=60))
def test_bytes_and_numbers_are_bounded(puts: list[tuple[int, int]]) -> None:
    cache = Recent(COUNT, BYTES, int)
    model: OrderedDict[int, int] = OrderedDict()
    for key, size in puts:
        cache.put(key, size)
        model[key] = size
        model.move_to_end(key)
        while len(model) > COUNT or (len(model) > 1 and sum(model.values()) > BYTES):
            model.popitem(last=False)
        assert key in cache, "the last one stays, whatever it has"
        assert {k for k in range(10) if k in cache} == set(model)
        assert cache.weight == sum(model.values())


#: The file that hangs on a chain's name and limits, not on solids alone.
GRID = 1


def obj(form: Mesh) -> str:
    lines = [f"v {x} {y} {z}" for x, y, z in form[0]]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in form[1]]
    return base64.b64encode("\n".join(lines).encode()).decode()


#: An elbow that no other test has: the files of its solids are not there.
LARGE_ELBOW = [[1.37 * x for x in corner] for corner in elbow()[0]], elbow()[1]
ELBOW_ROBOT = {
    "name": "elbow_robot",
    "urdf": """<robot name="e"><link name="base"/>
      <link name="arm"><collision><geometry><mesh filename="elbow.obj"/></geometry></collision>
      </link>
      <joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
        <limit lower="-2" upper="2" velocity="1" effort="1"/></joint></robot>""",
    "meshes": {"elbow.obj": obj(LARGE_ELBOW)},
}


def size(folder: Path) -> int:
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())


def elbow_at(x: float) -> dict[str, Any]:
    vertices, faces = elbow()
    shape = {"type": "mesh", "vertices": [[a + x, b, c] for a, b, c in vertices], "faces": faces}
    return {"id": "elbow", "shape": shape, "pose": {"position": [0.0, 0.0, 2.0]}}


def test_nothing_stays_of_what_was_deleted(served: Served) -> None:
    client, folder = served.client, served.data / "prepared"
    before = size(folder)
    for i in range(5):
        answer(client.post("/v1/robots", json=bench(f"gone_{i}")), 201)
        document = {"name": f"gone_{i}", **scene(elbow_at(0.001 * i))}
        answer(client.post("/v1/scenes", json=document), 201)
        answer(client.put("/v1/scenes/gone_0", json=scene(elbow_at(0.1 + 0.001 * i))))
        inline = {"robot": "panda", "joints": HOME, "scene": scene(elbow_at(0.2 + 0.001 * i))}
        answer(client.post("/v1/check", json=inline))
    assert size(folder) > before
    for i in range(5):
        for kind in ("robots", "scenes"):
            assert client.delete(f"/v1/{kind}/gone_{i}").status_code == 204
    assert size(folder) == before


def test_files_that_another_needs_stay_until_it_goes_too(tmp_path: Path) -> None:
    parts = prepared_files.decompositions(str(tmp_path))
    parts.mkdir()
    files = [parts / f"{name}.npz" for name in "abc"]
    for file in files:
        file.write_bytes(b"x")
    robot, scene = (Reference(kind, "x", kind, str(tmp_path)) for kind in ("robot", "scene"))
    prepared_files.note_meshes(robot, files[:2])
    prepared_files.note_meshes(scene, files[1:])
    prepared_files.forget(robot)
    assert sorted(parts.iterdir()) == files[1:]
    prepared_files.forget(scene)
    assert list(parts.iterdir()) == []


def test_files_of_a_robot_stay_when_its_limits_change(served: Served) -> None:
    """They were removed with the robot as it was: each worker computed them anew, for seconds."""
    client, folder = served.client, served.data / "prepared"
    parts = folder / "decompositions"
    before = {file.name for file in parts.glob("*")}
    answer(client.post("/v1/robots", json=ELBOW_ROBOT), 201)
    made = {file.name for file in parts.glob("*")} - before
    assert any(name.endswith(".npz") for name in made)
    for acceleration in (3.0, 4.0):
        change = {"joint_limits": {"*": {"acceleration": acceleration}}}
        answer(client.patch("/v1/robots/elbow_robot", json=change))
        left = {file.name for file in parts.glob("*")}
        assert len(made & left) >= len(made) - GRID
    answer(client.post("/v1/robots", json={**ELBOW_ROBOT, "name": "elbow_twin"}), 201)
    assert client.delete("/v1/robots/elbow_robot").status_code == 204
    left = {file.name for file in parts.glob("*")}
    assert len(made & left) >= len(made) - GRID
    assert client.delete("/v1/robots/elbow_twin").status_code == 204
    assert {file.name for file in parts.glob("*")} == before


def test_what_was_written_first_goes_first(tmp_path: Path) -> None:
    for age in range(6):
        file = tmp_path / f"{age}.scene"
        file.write_bytes(b"x" * 100)
        os.utime(file, (1000.0 - age, 1000.0 - age))
    assert prepared_files.trim(str(tmp_path), 350) == 300
    assert sorted(file.name for file in tmp_path.iterdir()) == ["0.scene", "1.scene", "2.scene"]
    assert prepared_files.trim(str(tmp_path / "none"), 0) == 0


def test_what_was_trimmed_is_built_again(served: Served, client: httpx.Client) -> None:
    answer(client.post("/v1/robots", json=bench("trimmed")), 201)
    joints = {"joints": [0.1, 0.2]}
    first = answer(client.post("/v1/robots/trimmed/fk", json=joints))
    prepared_files.trim(str(served.data / "prepared"), 0)
    assert answer(client.post("/v1/robots/trimmed/fk", json=joints)) == first


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

    def note(source: SentScene) -> object:
        read.append(source.moveit or "")
        return original(source)

    monkeypatch.setattr(poses, "scene", note)
    first = SentScene(moveit=TEXT % "0.25")
    made = worker_cache.scene(first)
    assert made == original(first)
    assert worker_cache.scene(SentScene(moveit=TEXT % "0.25")) is made
    assert len(read) == 1
    # Whatever else a scene says is part of what it is known by.
    others = [
        SentScene(moveit=TEXT % "0.5"),
        SentScene(moveit=TEXT % "0.25", frame="panda_link0"),
        SentScene(moveit=TEXT % "0.25", allowed_collisions=[["box", "panda_hand"]]),
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
    source = SentScene(moveit=text_in("panda_link0", "world"))
    placed = worker_cache.placed_scene(source, None, panda, None)
    assert placed == place(poses.scene(source), panda)
    assert worker_cache.placed_scene(source, None, panda, np.zeros(7)) is placed
    # Another robot has other frames.
    with pytest.raises(InvalidLinkName, match="panda_link0"):
        worker_cache.placed_scene(source, None, ur5e, None)
    # Obstacles that name no frame are in that of the request.
    rootless = SentScene(moveit=TEXT % "0.75")
    for frame in (None, "panda_link0", "world"):
        expected = poses.scene(rootless)
        if frame is not None:
            expected = place(in_frame(expected, frame), panda)
        assert worker_cache.placed_scene(rootless, frame, panda, None) == expected


def test_inline_obstacles_are_made_once() -> None:
    def body(height: float) -> SentScene:
        sphere = {"type": "sphere", "radius": 0.1}
        pose = {"position": [0.5, 0.0, height]}
        return SentScene.model_validate({"obstacles": [{"id": "a", "shape": sphere, "pose": pose}]})

    made = worker_cache.scene(body(0.25))
    assert worker_cache.scene(body(0.25)) is made
    other = worker_cache.scene(body(0.5))
    assert other == poses.scene(body(0.5)) != made


def test_another_text_with_the_same_obstacles_is_the_same_scene() -> None:
    panda = builtin_chain("panda")
    first, second = (f"name: {name}\n{text_in('panda_link0')}" for name in ("one", "two"))
    made = worker_cache.scene(SentScene(moveit=first))
    assert worker_cache.scene(SentScene(moveit=second)) is made
    placed = worker_cache.placed_scene(SentScene(moveit=first), None, panda, None)
    assert worker_cache.placed_scene(SentScene(moveit=second), None, panda, None) is placed
