"""Triangles cut by planes keep area and side; the cheapest cut is the cheapest one tried."""

import numpy as np
import pytest
import trimesh

from kinematics.arrays import Array, Indices
from obstacles.convex.hull import convex_hull
from obstacles.meshes.plane_cut import (
    Surface,
    cheapest_cut,
    cut_surface,
    triangle_areas,
)
from tests.obstacles.arms import cup

#: An L of two bars, 3 x 1 and 1 x 3, 1 thick: its corner is at the origin.
L_SHAPE = trimesh.util.concatenate(
    [
        trimesh.creation.box(bounds=[[0, 0, 0], [3, 1, 1]]),
        trimesh.creation.box(bounds=[[0, 1, 0], [1, 3, 1]]),
    ]
)


def triangles_of(mesh: trimesh.Trimesh) -> Array:
    return np.array(mesh.triangles)


def surface_of(triangles: Array, names: Indices | None = None) -> Surface:
    faces = np.arange(3 * len(triangles)).reshape(-1, 3)
    names = np.zeros(len(triangles), dtype=np.int64) if names is None else names
    return Surface(triangles.reshape(-1, 3), faces, names)


def cut(triangles: Array, axis: int, at: float) -> tuple[Array, Array]:
    below, above = cut_surface(surface_of(triangles), axis, at)
    return below.vertices[below.faces], above.vertices[above.faces]


def left(triangles: Array, axis: int, at: float) -> float:
    """Volume of the hulls of both sides of a cut [m^3], by definition."""
    return sum(convex_hull(side.reshape(-1, 3)).volume for side in cut(triangles, axis, at))


def normals(triangles: Array) -> Array:
    n = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return np.asarray(n / np.linalg.norm(n, axis=1, keepdims=True))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_both_sides_have_the_area_and_stay_on_their_side(axis: int) -> None:
    random = np.random.default_rng(2)
    triangles = random.normal(size=(80, 3, 3))
    for at in random.uniform(-1.0, 1.0, 5):
        below, above = cut(triangles, axis, at)
        assert below[:, :, axis].max() <= at
        assert above[:, :, axis].min() >= at
        both = triangle_areas(below).sum() + triangle_areas(above).sum()
        assert both == pytest.approx(triangle_areas(triangles).sum())
        assert (triangle_areas(np.vstack([below, above])) > 0.0).all()


def test_parts_lie_in_the_triangle_they_come_from_and_face_as_it_does() -> None:
    random = np.random.default_rng(3)
    for triangle in random.normal(size=(60, 1, 3, 3)):
        at = float(random.uniform(triangle[..., 1].min(), triangle[..., 1].max()))
        parts = np.vstack(cut(triangle, 1, at))
        assert 2 <= len(parts) <= 3
        np.testing.assert_allclose(
            normals(parts), np.tile(normals(triangle), (len(parts), 1)), atol=1e-6
        )
        weights = np.linalg.lstsq(
            np.vstack([triangle[0].T, np.ones(3)]),
            np.vstack([parts.reshape(-1, 3).T, np.ones(3 * len(parts))]), rcond=None,
        )[0]  # fmt: skip
        assert weights.min() >= -1e-9


def test_every_part_keeps_the_name_of_its_body() -> None:
    random = np.random.default_rng(4)
    triangles = random.normal(size=(40, 3, 3)) + 10.0 * np.arange(40)[:, None, None] * [0, 1, 0]
    names = np.arange(40)
    for side in cut_surface(surface_of(triangles, names), 0, 0.0):
        corners = side.vertices[side.faces[:, 0]]
        assert len(corners) == len(side.names)
        # Bodies stand ten metres apart along y.
        np.testing.assert_array_equal(np.round(corners[:, 1] / 10.0).clip(0, 39) - side.names, 0)


@pytest.mark.parametrize("seed", range(6))
def test_the_cheapest_cut_is_the_cheapest_of_all_places(seed: int) -> None:
    random = np.random.default_rng(seed)
    for mesh in (
        cup(),
        L_SHAPE,
        trimesh.creation.torus(1.0, 0.3, major_sections=16, minor_sections=8),
    ):
        turn = trimesh.transformations.random_rotation_matrix(random.random(3))
        triangles = triangles_of(mesh.copy().apply_transform(turn))
        points = triangles.reshape(-1, 3)
        axis, at, saved = cheapest_cut(points, np.arange(len(points)).reshape(-1, 3))
        places = np.linspace(points.min(axis=0), points.max(axis=0), 14)[1:-1]
        each = [left(triangles, k, place) for k in range(3) for place in places[:, k]]
        whole = convex_hull(points).volume
        # Hulls of many points are looked at from 206 sides only: nearly the volume.
        assert saved == pytest.approx(whole - min(each), abs=0.01 * whole)
        assert left(triangles, axis, at) == pytest.approx(min(each), abs=0.01 * whole)
