"""How often a mesh winds around a point, and its triangles turned alike.

The winding number of a mesh around p is the sum of the solid angles of its triangles over 4 pi,

    tan(w / 2) = det(a, b, c) / (|a||b||c| + (a.b)|c| + (b.c)|a| + (c.a)|b|),

a whole number everywhere if it is closed. Sources: "The solid angle of a plane triangle", IEEE
Transactions on Biomedical Engineering, 1983; "Robust inside-outside segmentation using generalized
winding numbers", ACM Transactions on Graphics, 2013.
"""

import math

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from obstacles.meshes.mesh import Faces


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


def _edge_keys(faces: Faces, directed: bool) -> NDArray[np.int64]:
    """A number for each side of each triangle, (3 f,): sides between the same corners have one.

    Args:
        faces: Shape (f, 3).
        directed: Whether sides that run opposite ways have different ones.
    """
    begins, ends = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    if not directed:
        begins, ends = np.minimum(begins, ends), np.maximum(begins, ends)
    return np.asarray(begins * (int(faces.max(initial=0)) + 1) + ends)


def oriented(faces: Faces) -> Faces:
    """Triangles with neighbours oriented alike, as most of them are.

    Neighbours have an edge that no third triangle has.

    Args:
        faces: Corners that lie in one place numbered alike, shape (f, 3).
    """
    sides = np.sort(_edge_keys(faces, directed=True))
    if (sides[1:] != sides[:-1]).all():  # no two triangles run the same way along an edge
        return faces
    keys = _edge_keys(faces, directed=False)
    order = np.argsort(keys, kind="stable")
    owner = order // 3
    forward = (faces < np.roll(faces, -1, axis=1)).reshape(-1)[order]
    same = np.pad(np.diff(keys[order]) == 0, 1)
    same = same[1:-1] & ~same[:-2] & ~same[2:]
    pairs = np.column_stack([owner[:-1][same], owner[1:][same]])
    turned = np.zeros(len(faces), dtype=np.bool_)
    _turn_alike(pairs, (forward[1:] == forward[:-1])[same], turned)
    return np.where(turned[:, None], faces[:, ::-1], faces)


@kernel
def _turn_alike(pairs: Indices, alike: NDArray[np.bool_], turned: NDArray[np.bool_]) -> None:
    """Write which triangles to turn for neighbours to be oriented alike, at most half of them.

    Args:
        pairs: Triangles with an edge in common, shape (p, 2).
        alike: Whether both run the same way along it, shape (p,).
        turned: All False before, shape (f,).
    """
    size, count = turned.shape[0], pairs.shape[0]
    first = np.zeros(size + 1, dtype=np.int64)
    for p in range(count):
        first[pairs[p, 0] + 1] += 1
        first[pairs[p, 1] + 1] += 1
    for f in range(size):
        first[f + 1] += first[f]
    last, own = first[:-1].copy(), np.empty(2 * count, dtype=np.int64)
    for p in range(count):
        for side in range(2):
            f = pairs[p, side]
            own[last[f]] = p
            last[f] += 1
    found = np.zeros(size, dtype=np.bool_)
    walk = np.empty(size, dtype=np.int64)
    for start in range(size):
        if found[start]:
            continue
        found[start], walk[0] = True, start
        at, end, turns = 0, 1, 0
        while at < end:
            f = walk[at]
            at += 1
            turns += turned[f]
            for entry in range(first[f], first[f + 1]):
                p = own[entry]
                other = pairs[p, 0] + pairs[p, 1] - f
                if not found[other]:
                    found[other], walk[end] = True, other
                    turned[other] = turned[f] != alike[p]
                    end += 1
        if 2 * turns > end:
            for entry in range(end):
                turned[walk[entry]] = not turned[walk[entry]]
