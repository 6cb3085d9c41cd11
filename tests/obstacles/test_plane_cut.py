"""Triangles cut by planes keep area and side; the cheapest cut is the cheapest one tried."""

import numpy as np
import pytest
import trimesh

from kinematics.arrays import Array
from obstacles.plane_cut import (
    cheapest_cut,
    cut_triangles,
    growing_volumes,
    hull_volume,
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


def edges_of(triangles: Array) -> Array:
    return np.asarray(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2, 3))


def cut(triangles: Array, axis: int, at: float) -> tuple[Array, Array]:
    bodies = np.zeros(len(triangles), dtype=np.int64)
    (below, _), (above, _) = cut_triangles(triangles, bodies, axis, at)
    return below, above


def left(triangles: Array, axis: int, at: float) -> float:
    """Volume of the hulls of both sides of a cut [m^3], by definition."""
    return sum(hull_volume(side.reshape(-1, 3)) for side in cut(triangles, axis, at))


def normals(triangles: Array) -> Array:
    n = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return np.asarray(n / np.linalg.norm(n, axis=1, keepdims=True))


def test_areas_are_those_of_herons_formula() -> None:
    triangles = np.random.default_rng(1).normal(size=(50, 3, 3))
    a, b, c = (np.linalg.norm(triangles[:, i] - triangles[:, i - 1], axis=1) for i in range(3))
    s = (a + b + c) / 2.0
    np.testing.assert_allclose(
        triangle_areas(triangles), np.sqrt(s * (s - a) * (s - b) * (s - c)), atol=1e-10
    )
    assert triangle_areas(np.zeros((1, 3, 3)))[0] == 0.0


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


@pytest.mark.parametrize(
    "heights", [(0, 0, 1), (0, 1, 2), (-1, 0, 1), (0, 0, 0), (-1, 0, 0), (-2, -1, 0)]
)
def test_corners_in_the_plane_are_no_crossings(heights: tuple[int, ...]) -> None:
    triangle = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]])
    for turn in range(3):
        triangle[0, :, 2] = np.roll(heights, turn)
        below, above = cut(triangle, 2, 0.0)
        assert len(below) + len(above) == (2 if min(heights) < 0 < max(heights) else 1)
        total = triangle_areas(below).sum() + triangle_areas(above).sum()
        assert total == pytest.approx(triangle_areas(triangle)[0])
        # A triangle in the plane belongs to one side only.
        if not any(heights):
            assert len(below) == 1


def test_neighbours_are_cut_at_the_same_points() -> None:
    """To the last bit: a closed surface stays closed, but for where the plane goes through."""
    mesh = trimesh.creation.icosphere(subdivisions=2).apply_transform(
        trimesh.transformations.random_rotation_matrix(np.array([0.2, 0.4, 0.7]))
    )
    for side, at in zip(cut(triangles_of(mesh), 0, 0.1), (0.1, 0.1), strict=True):
        edges = edges_of(side)
        directed = {(a.tobytes(), b.tobytes()) for a, b in edges}
        open_edges = [(a, b) for a, b in edges if (b.tobytes(), a.tobytes()) not in directed]
        assert open_edges
        for a, b in open_edges:
            assert a[0] == b[0] == at


def test_every_part_keeps_the_name_of_its_body() -> None:
    random = np.random.default_rng(4)
    triangles = random.normal(size=(40, 3, 3)) + 10.0 * np.arange(40)[:, None, None] * [0, 1, 0]
    names = np.arange(40)
    for side, numbers in cut_triangles(triangles, names, 0, 0.0):
        assert len(side) == len(numbers)
        # Bodies stand ten metres apart along y.
        np.testing.assert_array_equal(np.round(side[:, 0, 1] / 10.0).clip(0, 39) - numbers, 0)


def test_the_cheapest_cut_of_an_l_is_at_its_notch() -> None:
    triangles = triangles_of(L_SHAPE)
    points = triangles.reshape(-1, 3)
    for axis in (0, 1):
        at, volume = cheapest_cut(edges_of(triangles), points, axis, np.array([0.5, 1.01, 2.0]))
        assert at == 1.01
        assert volume == pytest.approx(5.01)
    # Across its thickness no cut helps: both sides are as hollow as the whole.
    _, volume = cheapest_cut(edges_of(triangles), points, 2, np.array([0.3, 0.5]))
    assert volume == pytest.approx(hull_volume(points))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_cheapest_cut_is_the_cheapest_of_all_places(axis: int) -> None:
    random = np.random.default_rng(5)
    for mesh in (
        cup(),
        L_SHAPE,
        trimesh.creation.torus(1.0, 0.3, major_sections=16, minor_sections=8),
    ):
        turn = trimesh.transformations.random_rotation_matrix(random.random(3))
        triangles = triangles_of(mesh.copy().apply_transform(turn))
        points = np.unique(triangles.reshape(-1, 3), axis=0)
        places = np.linspace(points[:, axis].min(), points[:, axis].max(), 8)[1:-1]
        at, volume = cheapest_cut(edges_of(triangles), points, axis, places)
        each = [left(triangles, axis, place) for place in places]
        # Hulls of many points are looked at from 206 sides only: nearly the volume.
        assert volume == pytest.approx(min(each), rel=0.01)
        assert left(triangles, axis, at) == pytest.approx(min(each), rel=0.01)


def test_volumes_grow_slab_by_slab_to_that_of_all() -> None:
    random = np.random.default_rng(6)
    slabs = [random.normal(size=(k, 3)) for k in (3, 1, 40, 0, 400)]
    volumes = growing_volumes(slabs)
    assert volumes[0] == 0.0
    assert volumes == sorted(volumes)
    for k, volume in enumerate(volumes):
        assert volume == pytest.approx(hull_volume(np.vstack(slabs[: k + 1])), rel=0.02)


@pytest.mark.parametrize(
    "points",
    [
        np.zeros((0, 3)),
        np.zeros((1, 3)),
        np.eye(3),
        np.random.default_rng(7).normal(size=(9, 3)) * [1, 1, 0],
    ],
    ids=["none", "one", "three", "flat"],
)
def test_what_is_flat_has_no_volume(points: Array) -> None:
    assert hull_volume(points) == 0.0
