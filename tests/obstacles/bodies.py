"""Meshes of several bodies, closed and open, of which is known where they are solid."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import trimesh

from kinematics.arrays import Array, Indices
from obstacles.shapes.shape import Mesh


class Assembly(NamedTuple):
    """A mesh of several bodies.

    Args:
        vertices: Shape (k, 3) [m].
        faces: Shape (f, 3).
        inside: A point deep in its solid, shape (3,).
        free: A point that is not, with room about it, shape (3,).
    """

    vertices: Array
    faces: Indices
    inside: Array
    free: Array

    def shape(self) -> Mesh:
        """The mesh as an obstacle's shape."""
        return Mesh(self.vertices, self.faces)


def moved(mesh: trimesh.Trimesh, by: Iterable[float]) -> trimesh.Trimesh:
    """A mesh elsewhere."""
    other = mesh.copy()
    other.apply_translation(np.array(list(by)))
    return other


def ell(size: float) -> trimesh.Trimesh:
    """A prism over an L, its corner about the origin, its arms along x and y."""
    outline = size * np.array([[0, 0], [1, 0], [1, 0.4], [0.4, 0.4], [0.4, 1], [0, 1]])
    n = len(outline)
    levels = [np.column_stack([outline, np.full(n, z)]) for z in (0.0, 0.4 * size)]
    flat = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]
    faces = [face[::-1] for face in flat] + [[i + n for i in face] for face in flat]
    for i in range(n):
        j = (i + 1) % n
        faces += [[i, j, j + n], [i, j + n, i + n]]
    mesh = trimesh.Trimesh(np.vstack(levels) - 0.2 * size, faces, process=False)
    assert mesh.is_watertight
    assert mesh.volume > 0.0
    return mesh


def bowl(radius: float) -> trimesh.Trimesh:
    """The lower half of a sphere, without a lid."""
    ball = trimesh.creation.icosphere(2, radius=radius)
    return trimesh.Trimesh(ball.vertices, ball.faces[ball.triangles_center[:, 2] < 0.0])


def sheet(half: float) -> trimesh.Trimesh:
    """A square without thickness."""
    corners = half * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    return trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)


def cracked() -> trimesh.Trimesh:
    """A cylinder whose halves meet in a circle of other corners each, of which some are common."""
    halves = []
    for sections, sign in ((32, 1.0), (48, -1.0)):
        half = trimesh.creation.cylinder(0.1, 0.3, sections=sections)
        half.apply_translation([0.0, 0.0, 0.15 * sign])
        inner = np.abs(half.triangles_center[:, 2]) < 1e-9
        halves.append(trimesh.Trimesh(half.vertices, half.faces[~inner], process=False))
    mesh = trimesh.util.concatenate(halves)
    mesh.merge_vertices()
    return mesh


def small_torus() -> trimesh.Trimesh:
    """A ring of 6 cm."""
    return trimesh.creation.torus(0.02, 0.008, major_sections=8, minor_sections=6)


def hollow_box(outside: float = 1.2, inside: float = 0.6) -> list[trimesh.Trimesh]:
    """A box with a cavity, both about the origin, by their sizes [m]."""
    outer, inner = trimesh.creation.box([outside] * 3), trimesh.creation.box([inside] * 3)
    inner.invert()
    return [outer, inner]


#: Bodies about the origin, a point inside of them, and one that is free.
HOSTS = {
    "box": ([trimesh.creation.box([1.0] * 3)], [0, 0, 0], [0.9, 0, 0]),
    "L": ([ell(1.0)], [0.6, 0, 0], [0.5, 0.5, 0]),
    "torus": ([trimesh.creation.torus(0.6, 0.2)], [0.6, 0, 0], [0, 0, 0]),
    "box with a cavity": (hollow_box(), [0.45, 0, 0], [0, 0, 0]),
    "shell in a shell": (
        [trimesh.creation.icosphere(3, radius=r) for r in (0.7, 0.3)], [0, 0, 0], [1, 0, 0],
    ),
}  # fmt: skip


def assembly(random: np.random.Generator, host: str) -> Assembly:
    """One of ``HOSTS`` among many small bodies and open surfaces, written in one of many ways."""
    bodies, inside, free = HOSTS[host]
    bodies = list(bodies)
    makers = (
        lambda: trimesh.creation.box([0.05] * 3), small_torus, lambda: sheet(0.04),
        lambda: bowl(0.04),
    )  # fmt: skip
    kinds = makers[:1] if random.random() < 0.3 else makers
    for i in range(int(random.choice([0, 4, 63, 90]))):
        place = [3.0 + 0.12 * (i % 20), -1.0 + 0.12 * (i // 20), random.uniform(-1.0, 1.0)]
        bodies.append(moved(kinds[random.integers(len(kinds))](), place))
    if random.random() < 0.5:
        bodies.append(moved(sheet(9.0), [0.0, 0.0, -4.0]))
    if random.random() < 0.3:
        bodies.append(moved(bowl(1.5), [0.0, 0.0, -2.2]))
    mesh = trimesh.util.concatenate([bodies[i] for i in random.permutation(len(bodies))])
    written = _written(random, np.array(mesh.vertices), np.array(mesh.faces))
    return Assembly(*written, np.array(inside, dtype=float), np.array(free, dtype=float))


def _written(random: np.random.Generator, vertices: Array, faces: Indices) -> tuple[Array, Indices]:
    """The same mesh inside out, in part twice, with a fin, or as triangles without neighbours."""
    way = random.integers(6)
    if way == 0:
        return vertices, faces[:, ::-1]
    if way == 1:
        return vertices, np.vstack([faces, faces[random.random(len(faces)) < 0.3]])
    if way == 2:
        a, b, _ = faces[0]
        tip = 3.0 * vertices[[a, b]].mean(axis=0) + [0.0, 0.0, 0.1]
        return np.vstack([vertices, tip]), np.vstack([faces, [a, b, len(vertices)]])
    if way == 3:
        soup = vertices[faces].reshape(-1, 3).astype(np.float32).astype(np.float64)
        return soup, np.arange(len(soup)).reshape(-1, 3)
    return vertices, faces
