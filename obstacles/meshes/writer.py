"""Files of triangle meshes by trimesh: binary STL, and binary glTF 2.0 (GLB)."""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from obstacles.convex.triangles import Triangles


def stl(surface: Triangles) -> bytes:
    """A surface as a binary STL, in metres.

    Args:
        surface: The triangles.
    """
    import trimesh  # noqa: PLC0415  a tenth of a second, for files only

    content = trimesh.Trimesh(surface.vertices, surface.faces, process=False).export(
        file_type="stl"
    )
    header = b"Armwright, metres"
    return header + bytes(content)[len(header) :]


def glb(surface: Triangles, name: str, colours: NDArray[np.uint8] | None = None) -> bytes:
    """A surface as a GLB, in metres, with y up as glTF has it.

    Args:
        surface: The triangles.
        name: Name of the mesh.
        colours: Red, green, blue and opacity of each vertex, shape (k, 4); None for none.
    """
    import trimesh  # noqa: PLC0415  a tenth of a second, for files only

    # glTF's y is our z, its z is our -y.
    turned = surface.vertices @ np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    mesh = trimesh.Trimesh(turned, surface.faces, vertex_colors=colours, process=False)
    scene = trimesh.Scene()
    scene.add_geometry(mesh, node_name=name, geom_name=name)
    named = partial(dict.update, asset={"version": "2.0", "generator": "Armwright"})
    return bytes(scene.export(file_type="glb", tree_postprocessor=named))
