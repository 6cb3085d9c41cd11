"""Mesh files: what was written is read back by another library."""

import io

import numpy as np
import pytest
import trimesh

from obstacles.convex.triangles import Triangles, join, piece_triangles
from obstacles.meshes.writer import glb, stl
from obstacles.shapes.shape import Box

BOX = join(piece_triangles(piece) for piece in Box([0.1, 0.2, 0.3]).pieces())
SHIFTED = Triangles(BOX.vertices + np.array([1.0, 2.0, 3.0]), BOX.faces)


def test_an_stl_comes_back_with_its_normals() -> None:
    mesh = trimesh.load(io.BytesIO(stl(SHIFTED)), file_type="stl")
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(0.006, rel=1e-5)
    assert mesh.bounds == pytest.approx(np.array([[0.95, 1.9, 2.85], [1.05, 2.1, 3.15]]), abs=1e-6)
    normals = np.frombuffer(stl(SHIFTED)[84:], np.uint8).reshape(-1, 50)[:, :12]
    assert normals.copy().view("<f4") == pytest.approx(mesh.face_normals, abs=1e-6)


def test_a_glb_comes_back_with_y_up() -> None:
    content = glb(SHIFTED, "box")
    assert len(content) % 4 == 0
    loaded = trimesh.load(io.BytesIO(content), file_type="glb", process=False)
    (mesh,) = loaded.geometry.values()
    assert mesh.volume == pytest.approx(0.006, rel=1e-5)
    x, y, z = SHIFTED.vertices.T
    np.testing.assert_allclose(mesh.vertices, np.column_stack([x, z, -y]), rtol=1e-6)
    np.testing.assert_array_equal(mesh.faces, SHIFTED.faces)
