"""Convex pieces of meshes: they cover the mesh, and not much more."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.optimize import nnls

from kinematics.chain import Array
from obstacles import decomposition
from obstacles.decomposition import ConvexPart, convex_pieces, keep_decompositions, overhang
from obstacles.hull import convex_hull


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
    return float(np.linalg.norm(corners.T @ (weights / weights.sum()))) - part.rounding


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
    assert part.rounding == 0.0
    assert convex_hull(part.vertices).volume == pytest.approx(body.volume)


def test_unmerged_and_turned_triangles_do_not_matter() -> None:
    body = trimesh.creation.icosphere(2)
    random = np.random.default_rng(0)
    soup = np.array(body.vertices)[np.array(body.faces)]
    soup[::2] = soup[::2, ::-1]
    soup = random.permutation(soup)
    (part,) = convex_pieces(soup.reshape(-1, 3), np.arange(3 * len(soup)).reshape(-1, 3))
    assert convex_hull(part.vertices).volume == pytest.approx(body.volume)


def test_a_fine_convex_mesh_is_thinned_and_grown_to_hold_it() -> None:
    body = trimesh.creation.icosphere(4)
    (part,) = pieces_of(body)
    assert len(part.vertices) <= 192
    assert 0.0 < part.rounding < 0.05
    for point in np.array(body.vertices)[::40]:
        assert outside_of(point, part) <= 1e-7


def test_closed_convex_bodies_are_a_hull_each() -> None:
    body = table()
    parts = pieces_of(body)
    volumes = sorted(convex_hull(part.vertices).volume for part in parts)
    np.testing.assert_allclose(volumes, [0.05 * 0.05 * 0.7] * 4 + [1.0 * 0.6 * 0.05])
    assert max(part.rounding for part in parts) == 0.0


def test_pieces_cover_a_mesh_that_is_not_convex_and_little_more() -> None:
    body = ell()
    parts = pieces_of(body)
    assert len(parts) >= 2
    points = surface(body, 300)
    assert max(min(outside_of(p, part) for part in parts) for p in points) <= 1e-6
    # The hull would fill the corner between the arms, to 0.5 m deep.
    assert min(outside_of(np.array([0.5, 0.5, 0.1]), part) for part in parts) > 0.25
    assert sum(convex_hull(part.vertices).volume for part in parts) < 1.15 * body.volume
    assert max(part.rounding for part in parts) < 5e-3


def test_the_same_mesh_gives_the_same_pieces() -> None:
    body = ell(0.9)
    first = pieces_of(body)
    decomposition._kept.cache_clear()
    for a, b in zip(first, pieces_of(body), strict=True):
        np.testing.assert_array_equal(a.vertices, b.vertices)
        assert a.rounding == b.rounding


def test_kept_pieces_are_read_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    body = ell(0.8)
    keep_decompositions(tmp_path / "cache")
    try:
        first = pieces_of(body)
        decomposition._kept.cache_clear()
        monkeypatch.setattr(decomposition, "_decompose", None)
        for a, b in zip(first, pieces_of(body), strict=True):
            np.testing.assert_array_equal(a.vertices, b.vertices)
            assert a.rounding == b.rounding
        monkeypatch.undo()
        decomposition._kept.cache_clear()
        (file,) = (tmp_path / "cache").iterdir()
        file.write_bytes(b"cut short")
        assert len(pieces_of(body)) == len(first)
    finally:
        keep_decompositions(None)


def test_a_flat_mesh_is_its_flat_hull() -> None:
    square = np.array([[0.0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])
    (part,) = convex_pieces(square, np.array([[0, 1, 2], [0, 2, 3]]))
    assert len(part.vertices) == 4
    assert part.rounding == 0.0


def test_overhang_is_what_the_hull_has_too_much() -> None:
    body = ell()
    vertices, faces = np.array(body.vertices), np.array(body.faces, dtype=np.int64)
    # The middle of the hull's slanted face, (0.6, 0.6), is 0.4 m above each arm.
    found = overhang(convex_hull(vertices), vertices, faces)
    assert found == pytest.approx(0.4, rel=0.02)
    box = trimesh.creation.box([1.0, 1.0, 1.0])
    vertices, faces = np.array(box.vertices), np.array(box.faces, dtype=np.int64)
    assert overhang(convex_hull(vertices), vertices, faces) < 1e-12
