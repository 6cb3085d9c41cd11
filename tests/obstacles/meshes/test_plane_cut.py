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
    used_surface,
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
    for side in cut_surface(surface_of(triangles, names), 0, 0.0):
        corners = side.vertices[side.faces[:, 0]]
        assert len(corners) == len(side.names)
        # Bodies stand ten metres apart along y.
        np.testing.assert_array_equal(np.round(corners[:, 1] / 10.0).clip(0, 39) - side.names, 0)


def test_a_side_has_only_points_that_it_uses() -> None:
    mesh = trimesh.creation.icosphere(subdivisions=2)
    names = np.zeros(len(mesh.faces), dtype=np.int64)
    whole = Surface(np.array(mesh.vertices), np.array(mesh.faces, dtype=np.int64), names)
    for side in (*cut_surface(whole, 2, 0.2), used_surface(whole._replace(faces=whole.faces[:9]))):
        np.testing.assert_array_equal(np.unique(side.faces), np.arange(len(side.vertices)))
    kept = used_surface(whole)
    np.testing.assert_array_equal(kept.vertices[kept.faces], whole.vertices[whole.faces])


def test_the_cheapest_cut_of_an_l_is_beside_its_notch() -> None:
    vertices, faces = np.array(L_SHAPE.vertices), np.array(L_SHAPE.faces, dtype=np.int64)
    _, at, saved = cheapest_cut(vertices, faces)
    # Twelve places on 3 m: the notch is at 1 m.
    assert 1.0 < at < 1.0 + 3.0 / 13.0
    whole = convex_hull(vertices).volume
    assert saved == pytest.approx(whole - left(vertices[faces], 0, at), rel=1e-4)


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


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_convex_body_and_a_flat_one_are_not_worth_a_cut(axis: int) -> None:
    ball = trimesh.creation.icosphere(subdivisions=3)
    vertices, faces = np.array(ball.vertices), np.array(ball.faces, dtype=np.int64)
    assert cheapest_cut(vertices, faces)[2] < 0.02 * ball.volume
    vertices[:, axis] = 0.5
    assert cheapest_cut(vertices, faces)[2] < 1e-4
