"""Files of triangle meshes: binary STL, and binary glTF 2.0 (GLB)."""

import json
import struct

import numpy as np
from numpy.typing import NDArray

from obstacles.convex.triangles import Triangles

#: Length of the header of a binary STL [byte].
_STL_HEADER = 80
#: "glTF", and the kinds of its chunks, as numbers of four characters.
_GLTF, _JSON_CHUNK, _BINARY_CHUNK = 0x46546C67, 0x4E4F534A, 0x004E4942
_GLTF_VERSION = 2
#: Numbers of glTF: types of components, targets of buffers, and the mode of triangles.
_FLOAT, _UNSIGNED_INT, _UNSIGNED_BYTE = 5126, 5125, 5121
_VERTEX_BUFFER, _INDEX_BUFFER = 34962, 34963
_TRIANGLES = 4


def stl(surface: Triangles) -> bytes:
    """A surface as a binary STL, in metres.

    Args:
        surface: The triangles.
    """
    corners = surface.vertices[surface.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    rows = np.zeros(len(corners), record)
    rows["normal"] = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0.0)
    rows["corners"] = corners
    header = b"Armwright, metres".ljust(_STL_HEADER, b"\0")
    return header + struct.pack("<I", len(rows)) + rows.tobytes()


def glb(surface: Triangles, name: str, colours: NDArray[np.uint8] | None = None) -> bytes:
    """A surface as a GLB, in metres, with y up as glTF has it.

    Args:
        surface: The triangles.
        name: Name of the mesh.
        colours: Red, green, blue and opacity of each vertex, shape (k, 4); None for none.
    """
    # glTF's y is our z, its z is our -y.
    turned = surface.vertices @ np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    points = turned.astype("<f4")
    indices = surface.faces.astype("<u4").reshape(-1)
    binary = indices.tobytes() + points.tobytes()
    attributes, views, accessors = {"POSITION": 1}, [], []
    if colours is not None:
        attributes["COLOR_0"] = 2
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": colours.nbytes,
                      "target": _VERTEX_BUFFER})  # fmt: skip
        accessors.append({"bufferView": 2, "componentType": _UNSIGNED_BYTE, "normalized": True,
                          "count": len(colours), "type": "VEC4"})  # fmt: skip
        binary += colours.tobytes()
    document = {
        "asset": {"version": "2.0", "generator": "Armwright"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": name}],
        "meshes": [
            {
                "name": name,
                "primitives": [{"attributes": attributes, "indices": 0, "mode": _TRIANGLES}],
            }
        ],
        "buffers": [{"byteLength": len(binary)}],
        "bufferViews": [
            {"buffer": 0, "byteLength": indices.nbytes, "target": _INDEX_BUFFER},
            {
                "buffer": 0,
                "byteOffset": indices.nbytes,
                "byteLength": points.nbytes,
                "target": _VERTEX_BUFFER,
            },
            *views,
        ],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": _UNSIGNED_INT,
                "count": len(indices),
                "type": "SCALAR",
            },
            {
                "bufferView": 1,
                "componentType": _FLOAT,
                "count": len(points),
                "type": "VEC3",
                "min": points.min(axis=0).tolist(),
                "max": points.max(axis=0).tolist(),
            },
            *accessors,
        ],
    }
    text = json.dumps(document).encode()
    chunks = _chunk(_JSON_CHUNK, text, b" ") + _chunk(_BINARY_CHUNK, binary, b"\0")
    return struct.pack("<III", _GLTF, _GLTF_VERSION, 12 + len(chunks)) + chunks


def _chunk(kind: int, content: bytes, filler: bytes) -> bytes:
    """A chunk of a GLB, filled up to a multiple of four bytes."""
    filled = content + filler * (-len(content) % 4)
    return struct.pack("<II", len(filled), kind) + filled
