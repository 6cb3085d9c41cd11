"""How often a mesh winds around a point: whether it bounds a solid, and on which side that lies.

The winding number of a mesh around p is the sum of the solid angles of its triangles over 4 pi,

    tan(w / 2) = det(a, b, c) / (|a||b||c| + (a.b)|c| + (b.c)|a| + (c.a)|b|),

a whole number everywhere if it is closed. Sources: "The solid angle of a plane triangle", IEEE
Transactions on Biomedical Engineering, 1983; "Robust inside-outside segmentation using generalized
winding numbers", ACM Transactions on Graphics, 2013.
"""

import math

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from kinematics.arrays import Array
from kinematics.compiled.kernel import kernel
from obstacles.mesh import Faces

#: Points at which the winding number is looked at, and the part of the mesh's diagonal that they
#: keep from it: nearer, a crack of the file's last digits would count.
_PROBES, _AWAY = 96, 0.01
#: How far from whole the winding number may be, at all but one of twenty points: a link with a
#: screw's hole is a solid, a tube without a lid is none.
_WHOLE, _MOST = 0.05, 0.95


@kernel
def winding_numbers(points: Array, vertices: Array, faces: Faces, numbers: Array) -> None:
    """Write how often a mesh winds around each of ``points`` (m, 3) into ``numbers`` (m,)."""
    for m in range(points.shape[0]):
        total = 0.0
        for f in range(faces.shape[0]):
            i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
            ax, ay = vertices[i, 0] - points[m, 0], vertices[i, 1] - points[m, 1]
            az = vertices[i, 2] - points[m, 2]
            bx, by = vertices[j, 0] - points[m, 0], vertices[j, 1] - points[m, 1]
            bz = vertices[j, 2] - points[m, 2]
            cx, cy = vertices[k, 0] - points[m, 0], vertices[k, 1] - points[m, 1]
            cz = vertices[k, 2] - points[m, 2]
            a = math.sqrt(ax * ax + ay * ay + az * az)
            b = math.sqrt(bx * bx + by * by + bz * bz)
            c = math.sqrt(cx * cx + cy * cy + cz * cz)
            volume = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
            ab, bc = ax * bx + ay * by + az * bz, bx * cx + by * cy + bz * cz
            ca = cx * ax + cy * ay + cz * az
            total += math.atan2(volume, a * b * c + ab * c + bc * a + ca * b)
        numbers[m] = total / (2.0 * math.pi)


@kernel
def _clearances(points: Array, vertices: Array, faces: Faces, squares: Array) -> None:
    """Squares of the distances of points to the nearest corner or middle of a triangle, about."""
    for m in range(points.shape[0]):
        best = np.inf
        for f in range(faces.shape[0]):
            for corner in range(4):
                square = 0.0
                for axis in range(3):
                    if corner < 3:
                        at = vertices[faces[f, corner], axis]
                    else:
                        at = vertices[faces[f, 0], axis] + vertices[faces[f, 1], axis]
                        at = (at + vertices[faces[f, 2], axis]) / 3.0
                    square += (at - points[m, axis]) ** 2
                best = min(best, square)
        squares[m] = best


def is_solid(vertices: Array, faces: Faces) -> bool:
    """Whether a connected mesh bounds a solid, small holes aside.

    Args:
        vertices: Shape (k, 3).
        faces: Shape (f, 3), all turned the same way round.
    """
    own = vertices[np.unique(faces)]
    low, high = own.min(axis=0), own.max(axis=0)
    points = np.random.default_rng(0).uniform(low, high, (_PROBES, 3))
    squares = np.empty(_PROBES)
    _clearances(points, vertices, faces, squares)
    points = points[squares > (_AWAY * float(np.linalg.norm(high - low))) ** 2]
    numbers = np.empty(len(points))
    winding_numbers(points, vertices, faces, numbers)
    if not (np.abs(numbers) > 0.5).any():
        return _is_closed(faces)
    return bool((np.abs(numbers - np.round(numbers)) <= _WHOLE).mean() >= _MOST)


def _is_closed(faces: Faces) -> bool:
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    return bool((counts == 2).all())


def oriented(faces: Faces) -> Faces:
    """Triangles with neighbours oriented alike, as most of them are.

    Args:
        faces: Of one connected mesh, corners that lie in one place numbered alike, shape (f, 3).
    """
    edges = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    _, turns = np.unique(edges, axis=0, return_counts=True)
    if (turns == 1).all():
        return faces
    owner = np.repeat(np.arange(len(faces)), 3)
    forward = edges[:, 0] < edges[:, 1]
    order = np.lexsort(np.sort(edges, axis=1).T)
    edge, owner, forward = np.sort(edges, axis=1)[order], owner[order], forward[order]
    same = (edge[1:] == edge[:-1]).all(axis=1)
    a, b, alike = owner[:-1][same], owner[1:][same], (forward[1:] == forward[:-1])[same]
    size = len(faces)
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(size, size)).tocsr()
    across = {(int(i), int(j)): bool(k) for i, j, k in zip(a, b, alike, strict=True)}
    turned = np.zeros(size, dtype=np.bool_)
    count, label = connected_components(graph, directed=False)
    for name in range(count):
        members = np.flatnonzero(label == name)
        walk, before = breadth_first_order(graph, members[0], directed=False)
        for face in walk[1:]:
            last = int(before[face])
            flip = across.get((last, int(face)), across.get((int(face), last), False))
            turned[face] = turned[last] ^ flip
        if 2 * int(turned[members].sum()) > len(members):
            turned[members] = ~turned[members]
    return np.where(turned[:, None], faces[:, ::-1], faces)
