"""Files of prepared robots and scenes: they go with their documents, and their room is bounded."""

import os
from pathlib import Path
from typing import Any

import httpx

from service.storage import prepared_files
from service.storage.cache_key import Reference
from tests.service.conftest import Served
from tests.service.robots import HOME, answer, bench, scene
from tests.service.test_meshes import elbow


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
