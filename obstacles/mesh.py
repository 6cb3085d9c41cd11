"""Triangle meshes: read from bytes, and covered by convex pieces."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinematics.chain import Array, frozen
from kinematics.errors import InvalidScene
from obstacles.hull import convex_hull

MAX_FACES = 200_000


@dataclass(frozen=True, slots=True, eq=False)
class ConvexPart:
    """One convex piece of a mesh: the hull of ``vertices`` (k, 3) grown by ``rounding`` [m]."""

    vertices: Array
    rounding: float


def checked_mesh(vertices: Array, faces: ArrayLike) -> tuple[Array, NDArray[np.int64]]:
    """Check the triangles of a mesh and answer it read-only.

    Raises:
        InvalidScene: No triangles, not triples of whole numbers, or an index out of range.
    """
    given = np.asarray(faces)
    if given.ndim != 2 or given.shape[1] != 3 or not len(given):
        raise InvalidScene(f"mesh faces: shape {given.shape}, needed are rows [i, j, k]")
    if given.dtype.kind not in "iu":
        raise InvalidScene("mesh faces: not whole numbers")
    if len(given) > MAX_FACES:
        raise InvalidScene(f"mesh faces: {len(given)} triangles, at most {MAX_FACES} are taken")
    if given.min() < 0 or given.max() >= len(vertices):
        raise InvalidScene(
            f"mesh faces: an index is not among the {len(vertices)} vertices",
            hint=f"Indices run from 0 to {len(vertices) - 1}.",
        )
    indices = np.array(given, dtype=np.int64)
    indices.setflags(write=False)
    return vertices, indices


def convex_pieces(vertices: Array, faces: NDArray[np.int64]) -> tuple[ConvexPart, ...]:
    """Convex pieces whose union covers the mesh."""
    used = vertices[np.unique(faces)]
    return (ConvexPart(frozen(convex_hull(used).vertices), 0.0),)
