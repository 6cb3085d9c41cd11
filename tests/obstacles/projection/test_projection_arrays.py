"""Obstacles packed for projections: kinds, sizes and balls, whose each is, and what encloses."""

import tracemalloc

import numpy as np
import pytest
import trimesh

from kinematics.arrays import Array, Indices
from obstacles.projection.projection import (
    ProjectionArrays,
    pack_obstacles,
)
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import (
    Box,
    Mesh,
    Shape,
    Sphere,
)
from tests.obstacles.arms import cup, mesh_shape
from tests.obstacles.solids import random_transform


def packed(*shapes: Shape, seed: int = 1) -> tuple[ProjectionArrays, Scene]:
    random = np.random.default_rng(seed)
    scene = Scene(
        Obstacle(f"o{k}", shape, random_transform(random)) for k, shape in enumerate(shapes)
    )
    return pack_obstacles(scene.obstacles), scene


def hull_of(arrays: ProjectionArrays, i: int) -> tuple[Array, Indices]:
    corners = arrays.corners[arrays.corner_starts[i] : arrays.corner_starts[i + 1]]
    triangles = arrays.triangles[arrays.triangle_starts[i] : arrays.triangle_starts[i + 1]]
    return corners, triangles


def test_what_encloses_a_mesh_are_its_covers_together() -> None:
    arrays, scene = packed(Sphere(0.1), mesh_shape(cup()), Box(np.ones(3)))
    first, last = arrays.enclosing[1]
    assert (first, last) == (1, 1 + scene.obstacles[1].count)
    for k in (0, 2):
        assert arrays.enclosing[k, 0] == arrays.enclosing[k, 1]
        assert not arrays.around[k].any()
    x, y, z, radius = arrays.around[1]
    T = scene.obstacles[1].T_world_obstacle
    corners = np.array(cup().vertices) @ T[:3, :3].T + T[:3, 3]
    assert np.linalg.norm(corners - [x, y, z], axis=1).max() <= radius + 1e-9
    # Their triangles are the mesh's, whole.
    area = 0.0
    for i in range(first, last):
        own, faces = hull_of(arrays, i)
        area += trimesh.Trimesh(own, faces, process=False).area
    assert area == pytest.approx(cup().area, rel=1e-6)


def test_loose_triangles_take_memory_by_their_number_not_its_square() -> None:
    random, count = np.random.default_rng(3), 2000
    middles = random.uniform(-1.0, 1.0, (count, 1, 3))
    corners = (middles + 0.01 * random.normal(size=(count, 3, 3))).reshape(-1, 3)
    scene = Scene(
        [Obstacle("loose", Mesh(corners, np.arange(3 * count).reshape(-1, 3)), np.eye(4))]
    )
    tracemalloc.start()
    try:
        arrays = pack_obstacles(scene.obstacles)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert len(arrays.triangles) >= count
    assert peak < 50e6, "a square matrix of its corners has 288 MB"
