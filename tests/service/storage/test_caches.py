"""Caches: prepared values on disk, values used last, records never older than what was written."""

from collections import OrderedDict
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box
from service.storage.caches import disk_cache, prepared_files
from service.storage.caches.cache_key import NotPrepared, Reference
from service.storage.caches.disk_cache import PreparedRobot
from service.storage.caches.recent import Recent
from tests.planning.scenes import builtin


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


def test_what_was_asked_for_last_stays() -> None:
    cache = Recent(2)
    for key in "ab":
        cache.put(key, key.upper())
    assert cache.get("a", lambda: "made anew") == "A"
    cache.put("c", "C")
    assert [key in cache for key in "abc"] == [True, False, True]


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
