"""Convex pieces of meshes: they cover the mesh, and little more."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.optimize import nnls

from kinematics.arrays import Array, Indices
from obstacles.convex.piece import convex_hull
from obstacles.convex.triangles import Triangles
from obstacles.kept_files import keep_files_in, written_files
from obstacles.meshes import decomposition
from obstacles.meshes.decomposition import ConvexPart, convex_pieces, cut_bodies
from obstacles.meshes.plane_cut import (
    Surface,
    cheapest_cut,
    cut_surface,
    triangle_areas,
)
from obstacles.robots.visual_geometry import thin_out
from tests.obstacles.arms import cup, in_cup
from tests.obstacles.bodies import hollow_box


def ell(arm: float = 1.0, thickness: float = 0.2) -> trimesh.Trimesh:
    """An L-shaped bar: one body, closed, not convex."""
    outline = np.array([[0, 0], [arm, 0], [arm, thickness], [thickness, thickness],
                        [thickness, arm], [0, arm]])  # fmt: skip
    below = np.column_stack([outline, np.zeros(6)])
    above = below + np.array([0.0, 0.0, thickness])
    cap = np.array([[0, 1, 3], [1, 2, 3], [0, 3, 4], [0, 4, 5]])
    sides = [[i, (i + 1) % 6, (i + 1) % 6 + 6] for i in range(6)]
    sides += [[i, (i + 1) % 6 + 6, i + 6] for i in range(6)]
    faces = np.vstack([cap[:, ::-1], cap + 6, sides])
    return trimesh.Trimesh(np.vstack([below, above]), faces, process=False)


def table() -> trimesh.Trimesh:
    """A top and four legs that touch it: five closed convex bodies."""
    top = trimesh.creation.box([1.0, 0.6, 0.05])
    legs = [
        trimesh.creation.box([0.05, 0.05, 0.7]).apply_translation([x, y, -0.375])
        for x in (-0.45, 0.45)
        for y in (-0.25, 0.25)
    ]
    joined = trimesh.util.concatenate([top, *legs])
    assert isinstance(joined, trimesh.Trimesh)
    return joined


def pieces_of(body: trimesh.Trimesh) -> tuple[ConvexPart, ...]:
    return convex_pieces(np.array(body.vertices), np.array(body.faces, dtype=np.int64))


def outside_of(point: Array, part: ConvexPart) -> float:
    """Distance to a part: its corners' convex combinations nearest to the point, by scipy."""
    weight = 1e4  # that the weights sum to one
    corners = part.vertices - point
    matrix = np.vstack([corners.T, np.full(len(corners), weight)])
    weights, _ = nnls(matrix, np.array([0.0, 0.0, 0.0, weight]))
    return float(np.linalg.norm(corners.T @ (weights / weights.sum()))) - part.offset_radius


def surface(body: trimesh.Trimesh, count: int) -> Array:
    random = np.random.default_rng(7)
    corners = np.array(body.vertices)[np.array(body.faces)]
    areas = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    chosen = random.choice(len(areas), count, p=areas / areas.sum())
    weights = random.dirichlet([1.0, 1.0, 1.0], count)
    inner = np.einsum("nk,nkd->nd", weights, corners[chosen])
    return np.vstack([inner, body.vertices])


@pytest.mark.parametrize("body", [
    trimesh.creation.box([1.0, 2.0, 3.0]),
    trimesh.creation.cylinder(0.3, 1.0, sections=32),
    trimesh.creation.icosphere(2),
])  # fmt: skip
def test_a_convex_mesh_is_its_hull(body: trimesh.Trimesh) -> None:
    (part,) = pieces_of(body)
    assert part.offset_radius == 0.0
    assert convex_hull(part.vertices).volume == pytest.approx(body.volume)


def test_a_fine_convex_mesh_is_covered_and_keeps_its_triangles() -> None:
    """One with more corners than a piece may have."""
    body = trimesh.creation.icosphere(5)
    (part,) = pieces_of(body)
    assert len(part.vertices) <= 192
    assert part.offset_radius < 0.06
    assert len(part.triangles) == len(body.faces)
    assert part.filled
    for point in np.array(body.vertices)[::40]:
        assert outside_of(point, part) <= 1e-7


@pytest.mark.parametrize("depth", [0.003, 0.02])
def test_a_dent_in_a_mesh_of_many_corners_is_seen(depth: float) -> None:
    body = trimesh.creation.icosphere(4)
    vertices = np.array(body.vertices)
    vertices[100] *= 1.0 - depth
    parts = convex_pieces(vertices, np.array(body.faces))
    assert sum(len(part.triangles) for part in parts) > 0


def test_pieces_cover_a_mesh_that_is_not_convex_and_little_more() -> None:
    body = ell()
    parts = pieces_of(body)
    assert len(parts) >= 2
    points = surface(body, 300)
    assert max(min(outside_of(p, part) for part in parts) for p in points) <= 1e-6
    # The hull would fill the corner between the arms, to 0.5 m deep.
    assert min(outside_of(np.array([0.5, 0.5, 0.1]), part) for part in parts) > 0.25
    assert sum(convex_hull(part.vertices).volume for part in parts) < 1.15 * body.volume
    assert max(part.offset_radius for part in parts) < 5e-3


def ring() -> trimesh.Trimesh:
    return trimesh.creation.torus(0.5, 0.1, major_sections=32, minor_sections=16)


def room() -> trimesh.Trimesh:
    """A box with walls: its inner side is turned inside out."""
    return trimesh.util.concatenate(hollow_box(2.0, 1.8))


def spiky(seed: int) -> trimesh.Trimesh:
    """A ball with random bumps and dents."""
    body = trimesh.creation.icosphere(2)
    random = np.random.default_rng(seed)
    body.vertices *= random.uniform(0.4, 1.0, (len(body.vertices), 1))
    return body


def lower_half(body: trimesh.Trimesh) -> trimesh.Trimesh:
    """The triangles below z = 0: a surface with an edge."""
    heights = np.array(body.triangles)[:, :, 2]
    return trimesh.Trimesh(body.vertices, np.array(body.faces)[heights.max(axis=1) <= 1e-9])


def windings(points: Array, triangles: Array) -> Array:
    """Solid angles over 4 pi, by numpy."""
    a, b, c = (triangles[None, :, k] - points[:, None] for k in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=2) for v in (a, b, c))
    volume = np.einsum("mfk,mfk->mf", a, np.cross(b, c))
    flat = la * lb * lc + (a * b).sum(2) * lc + (b * c).sum(2) * la + (c * a).sum(2) * lb
    return np.asarray(np.arctan2(volume, flat).sum(axis=1) / (2.0 * np.pi))


@pytest.mark.parametrize("body", [ell(), ring(), room(), spiky(0), spiky(1), table()])
def test_what_a_mesh_encloses_is_covered_and_its_triangles_are_all_there(
    body: trimesh.Trimesh,
) -> None:
    parts = pieces_of(body)
    random = np.random.default_rng(3)
    low, high = np.array(body.bounds)
    points = random.uniform(low, high, (400, 3))
    inside = points[np.abs(windings(points, np.array(body.triangles))) > 0.5][:120]
    assert len(inside) > 10
    assert max(min(outside_of(p, part) for part in parts) for p in inside) <= 1e-6
    kept = [part.triangles for part in parts if len(part.triangles)]
    for part in parts:
        for corner in part.triangles.reshape(-1, 3)[::29]:
            assert outside_of(corner, part) <= 1e-6
    if kept:
        areas = [np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]) for t in kept]
        total = sum(0.5 * np.linalg.norm(area, axis=1).sum() for area in areas)
        assert total == pytest.approx(body.area)
        np.testing.assert_allclose(
            windings(points[:100], np.vstack(kept)),
            windings(points[:100], np.array(body.triangles)), atol=1e-6,
        )  # fmt: skip


@pytest.mark.parametrize(("body", "filled"), [
    (ring(), True),
    (room(), True),
    (lower_half(trimesh.creation.icosphere(3)), False),
    (trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2], [0, 1, 3]]), False),
])  # fmt: skip
def test_only_what_is_closed_is_filled(body: trimesh.Trimesh, filled: bool) -> None:
    assert [part.filled for part in pieces_of(body)] == [filled] * len(pieces_of(body))


def test_pieces_that_were_kept_are_read_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    body = ell(0.8)
    keep_files_in(tmp_path / "cache")
    try:
        pieces_of(ell(0.7))
        assert not (tmp_path / "cache").exists(), "kept only where somebody will remove it"
        with written_files() as written:
            first = pieces_of(body)
        decomposition._stored_pieces.cache_clear()
        monkeypatch.setattr(decomposition, "_decompose", None)
        for a, b in zip(first, pieces_of(body), strict=True):
            np.testing.assert_array_equal(a.vertices, b.vertices)
            assert a.offset_radius == b.offset_radius
        monkeypatch.undo()
        decomposition._stored_pieces.cache_clear()
        (file,) = (tmp_path / "cache").iterdir()
        assert written == [file]
        file.write_bytes(b"cut short")
        assert len(pieces_of(body)) == len(first)
    finally:
        keep_files_in(None)


RING = trimesh.creation.annulus(0.5, 1.0, 0.4, sections=16)


def parts_of(*bodies: trimesh.Trimesh, filled: bool = True) -> list[ConvexPart]:
    whole = trimesh.util.concatenate(bodies)
    starts = np.cumsum([0, *(len(body.vertices) for body in bodies)])
    faces = [np.array(body.faces) + first for body, first in zip(bodies, starts, strict=False)]
    return cut_bodies(np.array(whole.vertices), faces, float(whole.scale), filled)


@cache
def cup_parts() -> list[ConvexPart]:
    return parts_of(cup())


def heights(part: ConvexPart, points: Array) -> Array:
    """How far points (m, 3) are beyond a part, by the highest of its planes [m], at most."""
    planes = convex_hull(part.vertices).planes
    outside = (points @ planes[:, :3].T - planes[:, 3]).max(axis=1)
    return np.asarray(outside - part.offset_radius)


def within(points: Array, body: trimesh.Trimesh) -> int:
    """How many of the points are in the box around a body."""
    low, high = body.bounds[0] - 1e-12, body.bounds[1] + 1e-12
    return int(((low <= points) & (points <= high)).all(axis=1).sum())


def covered(parts: list[ConvexPart], points: Array) -> Array:
    return np.asarray(np.min([heights(part, points) for part in parts], axis=0) <= 1e-9)


def total(parts: list[ConvexPart]) -> float:
    return sum(convex_hull(part.vertices).volume for part in parts)


@cache
def ring_parts() -> list[ConvexPart]:
    return parts_of(RING)


@pytest.mark.parametrize(("mesh", "parts"), [(cup(), cup_parts), (RING, ring_parts)])
def test_parts_hold_their_triangles_and_together_all_of_the_surface(
    mesh: trimesh.Trimesh, parts: Callable[[], list[ConvexPart]]
) -> None:
    assert 2 <= len(parts()) <= 12
    area = sum(triangle_areas(part.triangles).sum() for part in parts())
    assert area == pytest.approx(mesh.area, rel=1e-6)
    for part in parts():
        assert heights(part, part.triangles.reshape(-1, 3)).max() <= 1e-9
        assert part.filled


def test_the_solid_is_covered_and_the_hollow_is_not() -> None:
    parts = cup_parts()
    points = np.random.default_rng(1).uniform(-0.2, 0.2, (3000, 3))
    solid = in_cup(points)
    assert covered(parts, points[solid]).all()
    # Cuts are tried at twelve places a side, not at the walls themselves.
    assert covered(parts, points[~solid]).mean() < 0.15
    assert total(parts) < 1.2 * cup().volume


def test_a_ring_is_cut_although_no_single_cut_helps() -> None:
    parts = ring_parts()
    assert len(parts) > 2
    assert total(parts) < 0.8 * convex_hull(RING.vertices).volume
    assert not covered(parts, np.zeros((1, 3))).any()


def test_every_body_of_a_part_has_an_anchor_on_it() -> None:
    small = [
        trimesh.creation.box(bounds=[[0.01 * k, 0.0, 0.0], [0.01 * k + 0.009, 1.0, 1.0]])
        for k in range(4)
    ]
    for part in parts_of(*small):
        anchored = [within(part.anchors, body) for body in small]
        there = [within(part.triangles.reshape(-1, 3), body) for body in small]
        assert [count > 0 for count in anchored] == [count > 0 for count in there]
        assert max(anchored) == 1


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


@pytest.mark.parametrize("most", [400, 2_000])
def test_a_ball_stays_round(most: int) -> None:
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.5)
    coarse = thin_out(Triangles(np.array(ball.vertices), np.array(ball.faces)), most)
    assert most / 4 < len(coarse.faces) <= most
    side = np.linalg.norm(np.ptp(coarse.vertices[coarse.faces], axis=1), axis=1).max()
    distances = np.abs(np.linalg.norm(coarse.vertices, axis=1) - 0.5)
    assert distances.max() < side
    made = trimesh.Trimesh(coarse.vertices, coarse.faces, process=False)
    assert made.volume == pytest.approx(ball.volume, rel=0.15)
    assert made.is_winding_consistent


def test_what_has_few_triangles_stays_as_it_is() -> None:
    box = trimesh.creation.box()
    surface = Triangles(np.array(box.vertices), np.array(box.faces))
    assert thin_out(surface, 12) is surface


def test_the_coarsest_form_is_answered_where_nothing_fits() -> None:
    ball = trimesh.creation.icosphere(subdivisions=4)
    coarse = thin_out(Triangles(np.array(ball.vertices), np.array(ball.faces)), 1)
    assert 1 < len(coarse.faces) < 1_000
