"""Files of prepared robots and scenes: they go with their documents, and their room is bounded."""

import os
from pathlib import Path
from typing import Any

import httpx

from service.storage.caches import prepared_files
from service.storage.caches.cache_key import Reference
from tests.service.conftest import Served
from tests.service.robots import HOME, answer, bench, scene
from tests.service.test_meshes import elbow, obj

#: The file that hangs on a chain's name and limits, not on solids alone.
GRID = 1
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


def test_meshes_go_with_their_reference_and_with_nothing_else(tmp_path: Path) -> None:
    parts = prepared_files.decompositions(str(tmp_path))
    parts.mkdir()
    files = [parts / f"{name}.npz" for name in "abc"]
    for file in files:
        file.write_bytes(b"x")
    reference = Reference("robot", "r", "hash", str(tmp_path))
    prepared_files.prepared_file(reference).write_bytes(b"x")
    prepared_files.note_meshes(reference, files[:2])
    prepared_files.forget(reference)
    assert [file for file in tmp_path.rglob("*") if file.is_file()] == [files[2]]
    prepared_files.forget(reference)


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
