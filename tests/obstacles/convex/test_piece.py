"""Pieces, their triangles, hulls and covering spheres beside Qhull and quadratic programs."""

import itertools
import math
from typing import NamedTuple

import numpy as np
import pytest
from scipy.optimize import minimize_scalar, nnls
from scipy.spatial import ConvexHull, HalfspaceIntersection

from kinematics.arrays import Array, Indices
from kinematics.errors import InvalidScene
from obstacles.convex.closest_point import (
    hull_distances,
    mesh_distances,
    nearest_on_triangle,
)
from obstacles.convex.growing_hull import hull_volumes
from obstacles.convex.piece import Piece, PieceKind, convex_hull, corners_and_volume
from obstacles.convex.sphere_cover import cut_cell
from obstacles.convex.sphere_set import SphereSet, sphere_set
from obstacles.convex.triangles import Triangles, join, piece_triangles
from obstacles.shapes.shape import (
    Box,
    Capsule,
    Cone,
    Convex,
    Cylinder,
    HalfSpace,
    Mesh,
    Shape,
    Sphere,
)
from tests.obstacles.outline import convex_pieces, offset, owned, points_inside, rim
from tests.obstacles.solids import KINDS, NO_VERTICES, random_solid, random_transform

FLOOR = HalfSpace(np.array([0.0, 0.0, 1.0]), -0.3).pieces()[0]


def test_the_ball_holds_every_point_and_touches_the_outermost() -> None:
    random = np.random.default_rng(1)
    for _ in range(10):
        for piece in convex_pieces(random):
            center, radius = piece.bounding_sphere()
            away = np.linalg.norm(points_inside(piece, random) - center, axis=1)
            assert away.max() <= radius + 1e-12
            outermost = np.linalg.norm(owned(piece, rim(piece)) - center, axis=1).max()
            assert outermost + offset(piece) == pytest.approx(radius, abs=1e-9)


@pytest.mark.parametrize(
    ("height", "radius"),
    [(0.1, 1.0), (0.8, 1.0), (1.0, 1.0), (1.0, 0.9), (2.0, 0.1)],
    ids=["flat", "blunt", "square", "just pointed", "needle"],
)
def test_the_ball_of_a_cone_is_the_least_one(height: float, radius: float) -> None:
    """Of a flat cone the ball about its base; of a pointed one that through apex and rim."""
    cone = Cone(radius, height).pieces()[0]
    center, least = cone.bounding_sphere()
    # By symmetry the best centre is on the axis: a fine search along it.
    best = minimize_scalar(
        lambda z: max(np.hypot(radius, z + height / 2.0), abs(height / 2.0 - z)),
        bounds=(-height, height), method="bounded", options={"xatol": 1e-12},
    )  # fmt: skip
    assert least == pytest.approx(best.fun, abs=1e-7)
    assert center == pytest.approx([0.0, 0.0, best.x], abs=1e-6)


def test_the_box_holds_the_piece_and_touches_it_on_all_sides() -> None:
    random = np.random.default_rng(2)
    for _ in range(10):
        for piece in convex_pieces(random):
            box, outline = piece.local_box(), rim(piece)
            wide = np.ptp(outline, axis=0) / 2.0 + offset(piece)
            np.testing.assert_allclose(box[3:], wide, atol=1e-4)
            np.testing.assert_allclose(
                box[:3], (outline.min(axis=0) + outline.max(axis=0)) / 2.0, atol=1e-4
            )
            T = np.linalg.inv(piece.T_owner_piece)
            inside = points_inside(piece, random) @ T[:3, :3].T + T[:3, 3]
            assert (np.abs(inside - box[:3]) <= box[3:] + 1e-12).all()


def test_a_halfspace_is_in_no_ball_and_ends_at_its_face() -> None:
    center, radius = FLOOR.bounding_sphere()
    assert radius == np.inf
    assert center[2] == pytest.approx(-0.3)
    assert np.isinf(FLOOR.local_box()[3:]).all()


CORNERS = np.array([[0, 0, 0], [0.3, 0, 0], [0, 0.3, 0], [0, 0, 0.3]], dtype=float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


def volume(surface: Triangles) -> float:
    """Volume enclosed by a surface, positive where its triangles face outward [m^3]."""
    a, b, c = (surface.vertices[surface.faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


@pytest.mark.parametrize(
    ("shape", "expected", "least"),
    [
        (Box([0.1, 0.2, 0.3]), 0.006, 1.0),
        (Sphere(0.2), 4.0 / 3.0 * math.pi * 0.008, 0.9),
        (Cylinder(0.1, 0.4), math.pi * 0.004, 0.99),
        (Cone(0.1, 0.3), math.pi * 0.001, 0.99),
        (Capsule(0.1, 0.4), math.pi * 0.004 + 4.0 / 3.0 * math.pi * 0.001, 0.9),
        (Convex(CORNERS), 0.0045, 1.0),
        (Mesh(CORNERS, FACES), 0.0045, 1.0),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, Shape) else "",
)
def test_a_surface_encloses_its_solid(shape: Shape, expected: float, least: float) -> None:
    surface = join(piece_triangles(piece) for piece in shape.pieces())
    assert least * expected * (1 - 1e-6) <= volume(surface) <= expected * (1 + 1e-6)
    edges = np.sort(surface.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    counts = np.unique(edges, axis=0, return_counts=True)[1]
    assert (counts == 2).all()


def test_a_half_space_is_a_square_on_its_plane() -> None:
    (piece,) = HalfSpace([0.0, 0.6, 0.8], 0.5).pieces()
    surface = piece_triangles(piece)
    assert surface.vertices @ [0.0, 0.6, 0.8] == pytest.approx(np.full(4, 0.5))


def test_parts_keep_their_triangles_and_share_their_corners() -> None:
    (piece,) = Box([0.1, 0.2, 0.3]).pieces()
    one = piece_triangles(piece)
    both = join([one, Triangles(one.vertices + np.array([0.1, 0.0, 0.0]), one.faces)])
    assert len(both.faces) == 2 * len(one.faces)
    assert len(both.vertices) == 12
    assert volume(both) == pytest.approx(2 * 0.006)


def samples(piece: Piece, random: np.random.Generator, count: int) -> Array:
    """Points of a piece in its own frame, many of them on its edges and corners, shape (m, 3)."""
    if piece.kind == PieceKind.POLYTOPE:
        weights = random.dirichlet(np.full(len(piece.vertices), 0.1), count)
        points = np.vstack([weights @ piece.vertices, piece.vertices])
    else:
        turn, up = random.uniform(0.0, 2.0 * np.pi, count), random.uniform(-1.0, 1.0, count)
        up[: count // 2] = np.sign(up[: count // 2])
        widest = np.ones(count) if piece.kind == PieceKind.CYLINDER else 0.5 * (1.0 - up)
        r = piece.radius * widest * np.sqrt(random.uniform(0.0, 1.0, count))
        r[::2] = piece.radius * widest[::2]
        points = np.column_stack([r * np.cos(turn), r * np.sin(turn), piece.half_height * up])
    out = random.normal(size=points.shape)
    return np.asarray(
        points + piece.offset_radius * out / np.linalg.norm(out, axis=1, keepdims=True)
    )


def heights(piece: Piece, points: Array) -> Array:
    """How far out points (m, 3) are beyond the nearest of a solid core's planes or mantle [m]."""
    if piece.kind == PieceKind.POLYTOPE:
        planes = ConvexHull(piece.vertices).equations
        return np.asarray((points @ planes[:, :3].T + planes[:, 3]).max(axis=1))
    r, z = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
    radius, half = piece.radius, piece.half_height
    if piece.kind == PieceKind.CYLINDER:
        return np.asarray(np.maximum(r - radius, np.abs(z) - half))
    slope = np.hypot(2.0 * half, radius)
    return np.asarray(np.maximum((2.0 * half * r + radius * (z - half)) / slope, -half - z))


def depth(piece: Piece, points: Array) -> Array:
    """How deep points (m, 3) in its frame are in a piece, negative outside [m], shape (m,)."""
    if len(piece.vertices) in (1, 2):
        a, b = piece.vertices[0], piece.vertices[-1]
        along = (b - a) / max(float((b - a) @ (b - a)), 1e-300)
        share = np.clip((points - a) @ along, 0.0, 1.0)
        away = np.linalg.norm(points - a - share[:, None] * (b - a), axis=1)
        return np.asarray(piece.offset_radius - away)
    return piece.offset_radius - heights(piece, points)


def local(piece: Piece, found: SphereSet) -> Array:
    """The centres in the frame of the piece."""
    T = piece.T_owner_piece
    return np.asarray((found.centers - T[:3, 3]) @ T[:3, :3])


def balls_about(found: SphereSet, centers: Array, point: Array) -> bool:
    """Whether the outer balls that hold a point lead from the first to a finest one."""
    inside = np.linalg.norm(centers - point, axis=1) <= found.outer
    k = 0
    while k < len(inside):
        if not inside[k]:
            k = int(found.skips[k])
        elif found.skips[k] == k + 1:
            return True
        else:
            k += 1
    return False


def check(piece: Piece, found: SphereSet, random: np.random.Generator, count: int = 150) -> None:
    centers = local(piece, found)
    for point in samples(piece, random, count):
        assert balls_about(found, centers, point)
    assert (found.inner <= depth(piece, centers) + 1e-12).all()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("most", [1, 5, 32])
def test_spheres_hold_the_piece_and_lie_in_it(kind: str, most: int) -> None:
    random = np.random.default_rng(len(kind) + most)
    for _ in range(6):
        piece, _ = random_solid(random, kind, random_transform(random))
        found = sphere_set(piece, most)
        assert len(found.finest) <= most
        check(piece, found, random)


@pytest.mark.parametrize("kind", KINDS)
def test_excess_is_how_far_they_reach_beyond(kind: str) -> None:
    random = np.random.default_rng(len(kind))
    piece, _ = random_solid(random, kind, random_transform(random))
    found = sphere_set(piece)
    centers, outer = local(piece, found)[found.finest], found.outer[found.finest]
    out = random.normal(size=(len(outer), 300, 3))
    out /= np.linalg.norm(out, axis=2, keepdims=True)
    beyond = -depth(piece, (centers[:, None] + outer[:, None, None] * out).reshape(-1, 3))
    assert beyond.max() <= found.excess + 1e-9
    # A ball's own bracket is as wide as rounding.
    assert beyond.max() > 0.7 * found.excess or kind == "sphere"
    inner = np.maximum(found.inner[found.finest], 0.0)
    points = samples(piece, random, 300)
    away = np.linalg.norm(points[:, None] - centers, axis=2) - inner
    assert away.min(axis=1).max() <= found.excess + 1e-9


@pytest.mark.parametrize("rounding", [0.0, 0.02])
def test_flat_and_thin_pieces(rounding: float) -> None:
    random = np.random.default_rng(7)
    for rank, count in itertools.product((1, 2, 3), (3, 12)):
        points = random.normal(size=(count, 3)) * 0.2
        points[:, rank:] *= 0.0 if rank < 3 else 1e-4
        piece = Piece(PieceKind.POLYTOPE, random_transform(random), points, offset_radius=rounding)
        found = sphere_set(piece)
        centers = local(piece, found)
        for point in samples(piece, random, 200):
            assert balls_about(found, centers, point)
        assert (found.inner <= rounding + 1e-12).all() or rank == 3


def test_blades_needles_and_discs() -> None:
    random = np.random.default_rng(8)
    for scale in ((1.0, 0.3, 1e-3), (1.0, 1e-3, 1e-3), (1e-6, 1.0, 1.0), (1e3, 1e3, 1e3)):
        points = random.normal(size=(40, 3)) * scale
        piece = Piece(PieceKind.POLYTOPE, np.eye(4), points)
        centers = local(piece, found := sphere_set(piece, 16))
        size = np.abs(points).max()
        for point in samples(piece, random, 100):
            assert balls_about(found, centers, point * (1.0 - 1e-12 * size))
    for radius, half in ((1.0, 1e-3), (1e-3, 1.0)):
        for kind in (PieceKind.CYLINDER, PieceKind.CONE):
            disc = Piece(kind, random_transform(random), NO_VERTICES, radius, half)
            check(disc, sphere_set(disc), random)


def test_a_capsule_in_closed_form() -> None:
    ends = np.array([[0.0, 0.0, -0.2], [0.0, 0.0, 0.2]])
    found = sphere_set(Piece(PieceKind.POLYTOPE, np.eye(4), ends, offset_radius=0.05), 5, 0.0)
    t = found.excess
    spacing = 2.0 * np.sqrt((0.05 + t) ** 2 - 0.05**2)
    assert 2.0 * t + 4.0 * spacing == pytest.approx(0.4, abs=1e-6)
    assert found.inner == pytest.approx(np.full(9, 0.05))


def test_a_ball_is_its_own_bracket() -> None:
    piece = Piece(PieceKind.POLYTOPE, np.eye(4), np.array([[0.1, 0.2, 0.3]]), offset_radius=0.07)
    found = sphere_set(piece)
    assert found.centers == pytest.approx(np.array([[0.1, 0.2, 0.3]]))
    assert found.excess < 1e-8


def test_a_halfspace_has_none() -> None:
    with pytest.raises(InvalidScene, match="half-space"):
        sphere_set(Piece(PieceKind.HALFSPACE, np.eye(4), NO_VERTICES))


def test_encloses_every_point_and_faces_out() -> None:
    random = np.random.default_rng(0)
    for scale in (1e-3, 1.0, 1e3):
        for _ in range(20):
            points = scale * random.normal(size=(random.integers(4, 100), 3)) * [1.0, 0.3, 2.0]
            hull = convex_hull(points)
            assert hull.solid
            assert hull.volume == pytest.approx(ConvexHull(points).volume)
            heights = points @ hull.planes[:, :3].T - hull.planes[:, 3]
            assert heights.max() <= 1e-12 * scale
            corners = hull.vertices[hull.triangles]
            normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            assert (np.einsum("ij,ij->i", normals, hull.planes[:, :3]) > 0.0).all()


@pytest.mark.parametrize("jitter", [0.0, 1e-14])
def test_flat_sets_have_no_inside(jitter: float) -> None:
    random = np.random.default_rng(0)
    axes = np.linalg.qr(random.normal(size=(3, 3)))[0]
    disc = random.normal(size=(40, 3)) * [1.0, 1.0, jitter]
    line = random.normal(size=(40, 3)) * [1.0, jitter, jitter]
    polygon, segment = convex_hull(disc @ axes + 1.0), convex_hull(line @ axes + 1.0)
    assert not polygon.solid
    assert polygon.volume == 0.0
    area = _area(polygon.vertices[polygon.triangles])
    assert area == pytest.approx(ConvexHull(disc[:, :2]).volume)
    assert len(segment.vertices) == 2
    assert np.linalg.norm(np.diff(segment.vertices, axis=0)) == pytest.approx(np.ptp(line[:, 0]))


def _area(corners: Array) -> float:
    edges = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return float(np.linalg.norm(edges, axis=1).sum() / 2.0)


def many_points(kind: str, random: np.random.Generator) -> Array:
    """More points than are given to qhull as they are."""
    points = random.normal(size=(4000, 3))
    if kind == "sphere":
        points /= np.linalg.norm(points, axis=1, keepdims=True)
    if kind == "box":
        points = np.clip(points, -0.5, 0.5)
    if kind == "thin":
        points[:, 2] *= 1e-7
    if kind == "flat":
        points[:, 2] = 0.25
    return points


@pytest.mark.parametrize("kind", ["normal", "sphere", "box", "thin", "flat"])
def test_of_many_points_no_corner_is_missing(kind: str) -> None:
    random = np.random.default_rng(4)
    for _ in range(3):
        points = many_points(kind, random)
        hull = convex_hull(points)
        corners, volume_of_hull = corners_and_volume(points)
        if kind == "flat":
            assert not hull.solid
            assert volume_of_hull == 0.0
            expected = points[ConvexHull(points[:, :2]).vertices]
        else:
            qhull = ConvexHull(points)
            expected = points[qhull.vertices]
            assert volume_of_hull == pytest.approx(qhull.volume, rel=1e-12)
            assert (points @ hull.planes[:, :3].T - hull.planes[:, 3]).max() <= 1e-12
        for found in (hull.vertices, corners):
            assert {tuple(p) for p in found} == {tuple(p) for p in expected}


def draw(kind: str, random: np.random.Generator) -> Array:
    points = random.normal(size=(random.integers(5, 200), 3))
    if kind == "sphere":
        return np.asarray(points / np.linalg.norm(points, axis=1, keepdims=True))
    if kind == "grid":
        return np.round(2.0 * points) / 2.0
    if kind == "prism":
        turn = random.integers(0, 24, len(points)) * np.pi / 12.0
        return np.column_stack([np.cos(turn), np.sin(turn), random.integers(0, 3, len(points))])
    return points


@pytest.mark.parametrize("kind", ["normal", "sphere", "grid", "prism"])
def test_volumes_of_more_and_more_points_are_those_of_their_hulls(kind: str) -> None:
    random = np.random.default_rng(1)
    for _ in range(150):
        points = draw(kind, random)
        ends = [*np.unique(random.integers(4, len(points), 5)).tolist(), len(points)]
        volumes = hull_volumes(points, np.array(ends))
        expected = [convex_hull(points[:end]).volume for end in ends]
        np.testing.assert_allclose(volumes, expected, rtol=1e-3, atol=1e-4 * expected[-1])
        assert volumes.tolist() == sorted(volumes)


@pytest.mark.parametrize("rank", [0, 1, 2])
def test_what_is_flat_has_no_volume(rank: int) -> None:
    random = np.random.default_rng(3)
    axes = np.linalg.qr(random.normal(size=(3, 3)))[0]
    points = random.normal(size=(30, rank)) @ axes[:rank] + 1.0
    assert hull_volumes(points, np.array([3, 30])).tolist() == [0.0, 0.0]


class Polytope(NamedTuple):
    """A convex polytope.

    Args:
        corners: Shape (v, 3) [m].
        edges: Pairs of corners, diagonals of faces among them, shape (e, 2).
        planes: Unit normal and offset of each face, n.x <= o inside, shape (f, 4).
    """

    corners: Array
    edges: Indices
    planes: Array


def polytope(points: Array) -> Polytope:
    """The hull of points (k, 3) that are not flat."""
    hull = ConvexHull(points)
    number = np.full(len(points), -1)
    number[hull.vertices] = np.arange(len(hull.vertices))
    triangles = number[hull.simplices]
    pairs = np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    planes = np.column_stack([hull.equations[:, :3], -hull.equations[:, 3]])
    edges = np.unique(np.sort(pairs, axis=1), axis=0).astype(np.int64)
    return Polytope(points[hull.vertices].copy(), edges, np.unique(planes, axis=0))


def random_polytope(random: np.random.Generator, count: int = 20) -> Polytope:
    """The hull of ``count`` random points, longer along some axes."""
    return polytope(random.normal(size=(count, 3)) * random.uniform(0.1, 1.0, 3))


def volume_of_hull(points: Array) -> float:
    """Volume of the hull of points [m^3], 0 where they are too few."""
    return float(ConvexHull(points).volume) if len(points) > 3 else 0.0


CUBE = polytope(np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float))


def true_edges(points: Array) -> set[frozenset[int]]:
    """Edges of the hull of points between faces that are not in one plane."""
    hull = ConvexHull(points)
    edges = set()
    for f, triangle in enumerate(hull.simplices):
        for side, g in enumerate(hull.neighbors[f]):
            if hull.equations[f, :3] @ hull.equations[g, :3] < 1.0 - 1e-6:
                edges.add(frozenset(int(k) for k in np.delete(triangle, side)))
    return edges


def random_plane(random: np.random.Generator, cell: Polytope) -> tuple[Array, float]:
    n = random.normal(size=3)
    n /= np.linalg.norm(n)
    heights = cell.corners @ n
    return n, float(random.uniform(heights.min(), heights.max()))


def is_a_cell(points: Array, edges: Indices) -> bool:
    """Whether the edges name points, and all edges of their hull are among them."""
    named = {frozenset(map(int, edge)) for edge in edges}
    return bool(edges.min() >= 0 and edges.max() < len(points)) and true_edges(points) <= named


def test_cut_after_cut_it_is_the_intersection_of_half_spaces() -> None:
    random = np.random.default_rng(2)
    compared = 0
    for _ in range(25):
        cell = random_polytope(random)
        center, points, edges = cell.corners.mean(axis=0), cell.corners, cell.edges
        rows = [np.column_stack([cell.planes[:, :3], -cell.planes[:, 3]])]
        for _ in range(5):
            n, _ = random_plane(random, cell)
            offset = float(n @ center + random.uniform(0.01, 0.3))
            rows.append(np.array([[*n, -offset]]))
            points, edges = cut_cell(points, edges, n, offset)
        expected = HalfspaceIntersection(np.vstack(rows), center).intersections
        assert volume_of_hull(points) == pytest.approx(volume_of_hull(expected))
        assert is_a_cell(points, edges)
        # Each corner of the one is a corner of the other.
        gaps = np.linalg.norm(points[:, None] - expected[None], axis=2)
        assert gaps.min(axis=0).max() < 1e-7
        assert gaps.min(axis=1).max() < 1e-7
        compared += 1
    assert compared == 25


@pytest.mark.parametrize("offset", [0.0, 1.0])
def test_a_plane_in_a_face_keeps_the_face_or_the_cell(offset: float) -> None:
    """Corners in the plane belong to the part: nothing is computed anew."""
    kept, edges = cut_cell(CUBE.corners, CUBE.edges, np.array([0.0, 0.0, 1.0]), offset)
    expected = CUBE.corners[CUBE.corners[:, 2] <= offset]
    assert {tuple(p) for p in kept} == {tuple(p) for p in expected}
    assert len(edges) >= (4 if offset == 0.0 else 12)


def by_program(p: Array, corners: Array) -> Array:
    """The nearest point to p of the hull of some corners, by non-negative least squares."""
    heavy = 1e6
    A = np.vstack([corners.T, np.full(len(corners), heavy)])
    weights, _ = nnls(A, np.append(p, heavy))
    return np.asarray(weights @ corners / weights.sum())


def test_points_of_triangles_are_those_of_a_quadratic_program() -> None:
    random = np.random.default_rng(1)
    for _ in range(200):
        corners, p = random.normal(size=(3, 3)), random.normal(size=3) * 2.0
        nearest = nearest_on_triangle(tuple(p), *(tuple(corner) for corner in corners))
        expected = by_program(p, corners)
        assert np.linalg.norm(p - nearest) == pytest.approx(np.linalg.norm(p - expected), abs=1e-6)
        np.testing.assert_allclose(nearest, expected, atol=1e-4)


def test_distances_of_meshes_and_hulls_are_the_least_of_their_triangles() -> None:
    random = np.random.default_rng(2)
    hull = convex_hull(random.normal(size=(20, 3)))
    points = random.normal(size=(50, 3)) * 2.0
    each = [
        min(
            np.linalg.norm(
                p - nearest_on_triangle(tuple(p), *(tuple(hull.vertices[k]) for k in face))
            )
            for face in hull.triangles
        )
        for p in points
    ]
    distances = np.empty(len(points))
    mesh_distances(points, hull.vertices, hull.triangles, distances)
    np.testing.assert_allclose(distances, each, atol=1e-12)
    hull_distances(points, hull.vertices, hull.triangles, hull.planes, True, distances)
    inside = (points @ hull.planes[:, :3].T - hull.planes[:, 3]).max(axis=1) < 0.0
    np.testing.assert_allclose(distances, np.where(inside, -1.0, 1.0) * each, atol=1e-9)
