"""Triangles for display, thinned out: corners that are near each other become one."""

import numpy as np

from obstacles.convex.triangles import Triangles

#: Cells along the longest side of a surface: the first try, and the coarsest.
_FINEST, _COARSEST = 512, 4


def thin_out(surface: Triangles, most: int) -> Triangles:
    """A surface with at most so many triangles, unless its coarsest form has more.

    All corners in a cell of a grid become their mean, and triangles that collapse go (vertex
    clustering of Rossignac and Borrel). Nothing is known of what it covers: for display only.

    Args:
        surface: The surface.
        most: Triangles at most.
    """
    if len(surface.faces) <= most:
        return surface
    cells = _FINEST
    coarse = _clustered(surface, cells)
    while len(coarse.faces) > most and cells > _COARSEST:
        cells = max(_COARSEST, int(0.8 * cells))
        coarse = _clustered(surface, cells)
    return coarse


def _clustered(surface: Triangles, cells: int) -> Triangles:
    low = surface.vertices.min(axis=0)
    side = max(float((surface.vertices.max(axis=0) - low).max()), 1e-9) / cells
    places = np.floor((surface.vertices - low) / side).astype(np.int64)
    _, cell = np.unique(places @ [1 << 40, 1 << 20, 1], return_inverse=True)
    cell = cell.reshape(-1)
    counts = np.bincount(cell)
    vertices = np.column_stack(
        [np.bincount(cell, surface.vertices[:, i]) / counts for i in range(3)]
    )
    faces = cell[surface.faces]
    kept = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    return Triangles(vertices, np.unique(faces[kept], axis=0))
