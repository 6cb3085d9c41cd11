"""Outer spheres cover a piece on every way down to the finest, and inner ones lie in it."""

import itertools

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from kinematics.arrays import Array
from kinematics.errors import InvalidScene
from obstacles.convex.piece import Piece, PieceKind
from obstacles.convex.sphere_set import SphereSet, sphere_set
from tests.obstacles.solids import KINDS, NO_VERTICES, random_solid, random_transform


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
