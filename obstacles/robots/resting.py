"""Places where an object rests: one of its faces down on the flat top of a support.

A face carries the object where its centre of mass is above it, well inside of its edges: uniform
density is taken. Objects roll or tip over on the others.
"""

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from kinematics.arrays import Array, typed
from kinematics.errors import InvalidOption
from kinematics.pose import align_z, rotation_z, transform
from obstacles.convex.piece import convex_hull
from obstacles.robots.grasps import surface_of
from obstacles.scenes.scene import Obstacle
from obstacles.shapes.shape import Capsule, HalfSpace, Mesh, PointCloud, Shape, Sphere

#: Faces that an object is put on at most: those that it stands on most firmly.
_FACES = 6
#: Least tilt at which an object tips over, as a tangent: a drawn cylinder rolls over its facets.
_FIRM = 0.15
#: Normals and heights nearer than this are of one face [1, m].
_SAME = 1e-6


@typed
def resting_places(
    shape: Shape, supports: Sequence[Obstacle], samples: tuple[int, int] = (3, 3), angles: int = 4
) -> Array:
    """Poses T_root_object of an object that rests on supports, shape (k, 4, 4); k may be 0.

    Args:
        shape: The object in its own frame.
        supports: Obstacles with a flat top.
        samples: Spots along x and y of each top.
        angles: Turns at each spot.

    Raises:
        InvalidOption: A shape has no faces, or a support no flat top.
    """
    if isinstance(shape, HalfSpace | PointCloud | Sphere | Capsule):
        what = type(shape).__name__.lower()
        raise InvalidOption(f"a {what} has no face that it rests on", hint="Give poses.")
    vertices = surface_of(shape).vertices
    found = []
    for support, (down, middle) in product(supports, _faces(vertices)):
        top, height = _top(support)
        low, high = top.points.min(axis=0), top.points.max(axis=0)
        for i, j, k in product(range(samples[0]), range(samples[1]), range(angles)):
            R = rotation_z(2.0 * np.pi * k / angles) @ align_z(-down).T
            spot = low + (high - low) * (np.array([i, j]) + 0.5) / samples
            placed = vertices @ R.T
            lowest = placed[:, 2].min()
            shift = np.array([*(spot - (R @ middle)[:2]), height - lowest])
            foot = placed[placed[:, 2] < lowest + _SAME, :2] + shift[:2]
            if (foot @ top.equations[:, :2].T + top.equations[:, 2] <= _SAME).all():
                found.append(transform(R, shift))
    return np.array(found).reshape(-1, 4, 4)


def _faces(vertices: Array) -> Iterator[tuple[Array, Array]]:
    """Outward normals of the faces that carry an object, the firmest first, and its middle."""
    hull = convex_hull(vertices)
    corners = hull.vertices[hull.triangles]
    volumes = np.linalg.det(corners)
    middle = (volumes[:, None] * corners.sum(axis=1)).sum(axis=0) / (4.0 * volumes.sum())
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    normals = normals[lengths > 0.0] / lengths[lengths > 0.0, None]
    firm: list[tuple[float, Array]] = []
    for normal in normals:
        if any(other @ normal > 1.0 - _SAME for _, other in firm):
            continue
        heights = hull.vertices @ normal
        face = hull.vertices[heights > heights.max() - _SAME]
        try:
            outline = ConvexHull(face @ align_z(normal)[:, :2]).equations
        except QhullError:
            continue
        inside = -(outline[:, :2] @ (middle @ align_z(normal)[:, :2]) + outline[:, 2]).max()
        firm.append((float(inside) / float(heights.max() - normal @ middle), normal))
    firm.sort(key=lambda one: -one[0])
    return ((normal, middle) for tilt, normal in firm[:_FACES] if tilt > _FIRM)


def _top(support: Obstacle) -> tuple[ConvexHull, float]:
    """Outline of the flat top of an obstacle, and its height [m].

    Raises:
        InvalidOption: It has none, or its shape may be hollow.
    """
    if not isinstance(support.shape, HalfSpace | Mesh | PointCloud):
        T = support.T_world_obstacle
        vertices = surface_of(support.shape).vertices @ T[:3, :3].T + T[:3, 3]
        height = float(vertices[:, 2].max())
        top = vertices[vertices[:, 2] > height - _SAME, :2]
        try:
            return ConvexHull(top), height
        except (QhullError, ValueError):
            pass
    raise InvalidOption(
        f"support {support.id!r} has no flat top that is known to carry something",
        hint="Give poses on it.",
        name=support.id,
    )
