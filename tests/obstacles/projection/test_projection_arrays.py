"""Obstacles packed for projections: kinds, sizes and balls, whose each is, and what encloses."""

import tracemalloc

import numpy as np
import pytest
import trimesh

from kinematics.arrays import Array, Indices
from obstacles.projection.projection_arrays import (
    BOX,
    CONE,
    CYLINDER,
    HALFSPACE,
    HULL,
    ProjectionArrays,
    convex_parts,
    pack_obstacles,
)
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import (
    Box,
    Capsule,
    Cone,
    Convex,
    Cylinder,
    HalfSpace,
    Mesh,
    PointCloud,
    Shape,
    Sphere,
)
from tests.obstacles.arms import cup, mesh_shape
from tests.obstacles.outline import offset, owned, rim
from tests.obstacles.solids import random_transform

FLAT = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
KINDS = [
    (Box(np.array([0.2, 0.4, 0.6])), BOX),
    (Sphere(0.1), HULL),
    (Capsule(0.1, 0.2), HULL),
    (Cylinder(0.1, 0.2), CYLINDER),
    (Cone(0.1, 0.2), CONE),
    (HalfSpace(np.array([0.0, 0.0, 1.0]), 0.1), HALFSPACE),
    (Convex(np.random.default_rng(0).normal(size=(20, 3))), HULL),
    (Convex(FLAT), HULL),
    (PointCloud(np.eye(3), 0.1), HULL),
]


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


@pytest.mark.parametrize(("shape", "kind"), KINDS, ids=lambda x: type(x).__name__)
def test_every_shape_has_its_kind_and_pose(shape: Shape, kind: int) -> None:
    arrays, scene = packed(shape)
    pieces = scene.obstacles[0].pieces()
    assert arrays.kinds.tolist() == [kind] * len(pieces)
    for i, piece in enumerate(pieces):
        np.testing.assert_allclose(arrays.poses[i], piece.T_owner_piece)
        if kind == BOX:
            np.testing.assert_array_equal(arrays.sizes[i, [0, 1, 3]], [0.1, 0.2, 0.3])
        else:
            expected = [piece.radius, piece.half_height, offset(piece)]
            np.testing.assert_allclose(arrays.sizes[i, :3], expected)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_pieces_belong_to_their_obstacles_in_order_clouds_among_them(order: int) -> None:
    shapes = [shape for shape, _ in KINDS] + [mesh_shape(cup()), PointCloud(np.eye(3), 0.2)]
    shuffled = [shapes[k] for k in np.random.default_rng(order).permutation(len(shapes))]
    arrays, scene = packed(*shuffled)
    counts = np.bincount(arrays.owners, minlength=len(shuffled))
    assert (np.diff(arrays.owners) >= 0).all()
    for k, obstacle in enumerate(scene.obstacles):
        assert counts[k] == obstacle.count
        own, _ = packed_alone(obstacle)
        first = int(np.flatnonzero(arrays.owners == k)[0])
        for i in range(len(own.kinds)):
            assert arrays.kinds[first + i] == own.kinds[i]
            np.testing.assert_allclose(arrays.balls[first + i], own.balls[i])
            for ours, alone in zip(hull_of(arrays, first + i), hull_of(own, i), strict=True):
                np.testing.assert_array_equal(ours, alone)


def packed_alone(obstacle: Obstacle) -> tuple[ProjectionArrays, Obstacle]:
    return pack_obstacles([obstacle]), obstacle


def test_balls_hold_their_pieces_where_they_are() -> None:
    arrays, scene = packed(*(shape for shape, _ in KINDS if not isinstance(shape, HalfSpace)))
    pieces = [piece for obstacle in scene.obstacles for piece in obstacle.pieces()]
    for piece, (x, y, z, radius) in zip(pieces, arrays.balls, strict=True):
        away = np.linalg.norm(owned(piece, rim(piece)) - [x, y, z], axis=1) + offset(piece)
        assert away.max() <= radius + 1e-9


def test_a_solid_hull_has_an_inside_and_a_flat_one_a_direction_across() -> None:
    arrays, _ = packed(KINDS[6][0], Convex(FLAT), Convex(FLAT[:2]), Sphere(0.1))
    assert arrays.solid.tolist() == [True, False, False, False]
    np.testing.assert_allclose(np.abs(arrays.across[1]), [0.0, 0.0, 1.0], atol=1e-12)
    # Across a segment along x: any direction at right angles.
    assert abs(arrays.across[2, 0]) < 1e-12
    np.testing.assert_allclose(np.linalg.norm(arrays.across, axis=1), 1.0)


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


def test_an_open_mesh_encloses_nothing() -> None:
    opened = cup()
    opened.update_faces(np.arange(len(opened.faces)) > 1)
    arrays, _ = packed(mesh_shape(opened))
    assert arrays.enclosing[0, 0] == arrays.enclosing[0, 1]


def test_parts_that_are_inside_of_others_are_left_out() -> None:
    """Beside covers a mesh can have convex bodies: one in a wall is not looked at by itself."""
    inside = trimesh.creation.box([0.02] * 3).apply_translation([0.0, 0.0, -0.3])
    beside = trimesh.creation.box([0.02] * 3).apply_translation([0.0, 0.0, 0.3])
    block = cup(-0.4)
    for body, counted in ((inside, 0), (beside, 1)):
        mesh = mesh_shape(trimesh.util.concatenate([block, body]))
        pieces, filled = convex_parts(Obstacle("mesh", mesh))
        assert all(piece.surface is not None for piece in pieces[:filled])
        assert len(pieces) - filled == counted


def test_nothing_packs_to_nothing() -> None:
    arrays = pack_obstacles([])
    assert len(arrays.kinds) == len(arrays.owners) == 0
    assert arrays.enclosing.shape == (0, 2)
    assert arrays.corner_starts.tolist() == [0]


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
