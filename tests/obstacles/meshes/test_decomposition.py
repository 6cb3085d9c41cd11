"""Convex pieces of meshes: they cover the mesh, and not much more."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.optimize import nnls

from kinematics.arrays import Array
from obstacles.convex.hull import convex_hull
from obstacles.kept_files import keep_files_in, written_files
from obstacles.meshes import decomposition
from obstacles.meshes.convex_cover import ConvexPart
from obstacles.meshes.decomposition import convex_pieces, overhang
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


def test_overhang_is_what_the_hull_has_too_much() -> None:
    body = ell()
    vertices, faces = np.array(body.vertices), np.array(body.faces, dtype=np.int64)
    # The middle of the hull's slanted face, (0.6, 0.6), is 0.4 m above each arm.
    found = overhang(convex_hull(vertices), vertices, faces)
    assert found == pytest.approx(0.4, rel=0.02)
    box = trimesh.creation.box([1.0, 1.0, 1.0])
    vertices, faces = np.array(box.vertices), np.array(box.faces, dtype=np.int64)
    assert overhang(convex_hull(vertices), vertices, faces) < 1e-12
