"""Two spheres about each of a few centres bracket a convex piece.

The larger ones together cover it (`sphere_cover`), each of the smaller ones lies inside. With s(c)
the signed distance of a centre c from the piece, negative inside, that is the ball of radius -s(c);
so one number, the excess r + s(c) of the outer radius r, tells how far the outer ball reaches too
far and at once how much the inner one lacks of it.
"""

import hashlib
import math
from dataclasses import dataclass, fields
from functools import partial

import numpy as np

from kinematics.arrays import Array, Indices
from kinematics.caches.bounded_cache import bounded_cache
from kinematics.errors import InvalidScene
from obstacles.convex.closest_point import nearest_on_cone, nearest_on_cylinder
from obstacles.convex.piece import Piece, PieceKind, convex_hull
from obstacles.convex.sphere_cover import cover
from obstacles.kept_files import is_written, keep_file, kept_array

#: Spheres of a piece on the finest level, and the excess [m] below which there are no more.
MOST, ENOUGH = 48, 5e-3
#: What rounding may have cost a radius [m], with room to spare.
_ROUNDING = 1e-9
#: A cylinder or cone is cut as the prism or pyramid around it with this many sides.
_SIDES = 24


@dataclass(frozen=True, slots=True, eq=False)
class SphereSet:
    """Spheres from one about the whole piece down to the finest, each before those below it.

    Args:
        centers: Centres in the frame of what owns the piece, shape (s, 3) [m].
        outer: Radii; a ball holds what those below it hold, the finest ones cover the piece, (s,).
        inner: Radii of balls about the same centres inside the piece; 0 or below where a centre
            is not inside, which then tells how far out it is, shape (s,).
        skips: The number of the sphere after all those below each, shape (s,).
    """

    centers: Array
    outer: Array
    inner: Array
    skips: Indices

    def __post_init__(self) -> None:
        for item in fields(self):
            getattr(self, item.name).setflags(write=False)

    @property
    def finest(self) -> Indices:
        """Numbers of the spheres with none below them."""
        return np.flatnonzero(self.skips == np.arange(1, len(self.skips) + 1))

    @property
    def excess(self) -> float:
        """How far the finest outer spheres reach beyond the piece at most [m].

        No point of the piece is farther than this from one of the finest inner spheres.
        """
        return float((self.outer - self.inner)[self.finest].max())


def sphere_set(piece: Piece, most: int = MOST, enough: float = ENOUGH) -> SphereSet:
    """The spheres of a piece.

    Args:
        piece: Any but a half-space.
        most: Spheres on the finest level, if it takes that many.
        enough: Excess at which fewer will do [m].

    Raises:
        InvalidScene: No finite number of spheres covers a half-space.
    """
    if piece.kind == PieceKind.HALFSPACE:
        raise InvalidScene(
            "a half-space has no sphere set", hint="Ask for those of bounded pieces only."
        )
    size = piece.radius, piece.half_height, piece.offset_radius
    made_from = (piece.kind, piece.vertices.tobytes(), *size, most, enough)
    centers, outer, inner, skips = _spheres(*made_from)
    if is_written():  # what is in memory as well
        rows = np.column_stack([centers, outer, inner, skips])
        keep_file(f"{_digest(*made_from)}.npy", partial(np.save, arr=rows, allow_pickle=False))
    if piece.surface is not None:
        # What covers a part of a mesh may hold more than it: no ball is known to be inside.
        inner = np.full(len(inner), -np.inf)
    T = piece.T_owner_piece
    return SphereSet(centers @ T[:3, :3].T + T[:3, 3], outer, inner, skips)


# By content: a robot that holds something, or arrives anew, has the pieces it had.
@bounded_cache(maxsize=1024)
def _spheres(
    kind: PieceKind, corners: bytes, radius: float, half: float, rounding: float, most: int,
    enough: float,
) -> tuple[Array, Array, Array, Indices]:  # fmt: skip
    """``SphereSet`` in the frame of the piece."""
    digest = _digest(kind, corners, radius, half, rounding, most, enough)
    rows = kept_array(
        digest, (-1, 6), lambda: _sphere_rows(kind, corners, (radius, half, rounding), most, enough)
    )
    outer, inner = (np.ascontiguousarray(rows[:, column]) for column in (3, 4))
    return rows[:, :3], outer, inner, rows[:, 5].astype(np.int64)


def _digest(
    kind: PieceKind, corners: bytes, radius: float, half: float, rounding: float, most: int,
    enough: float,
) -> str:  # fmt: skip
    size = np.array([kind, radius, half, rounding, most, enough], dtype=np.float64)
    # The number goes up when the same piece gets other spheres.
    return hashlib.sha256(b"spheres 1" + size.tobytes() + corners).hexdigest()


def _sphere_rows(
    kind: PieceKind, corners: bytes, size: tuple[float, float, float], most: int, enough: float
) -> Array:
    """Rows of centre, outer and inner radius, and the number of the sphere after those below."""
    radius, half, rounding = size
    core = np.frombuffer(corners).reshape(-1, 3)
    if kind != PieceKind.POLYTOPE:
        core = _around(kind, radius, half)
        # A ball reaches so much farther beyond the round piece than beyond what is about it.
        enough -= radius / math.cos(math.pi / _SIDES) - radius
    hull = convex_hull(core)
    if len(hull.vertices) <= 2 and (rounding > 0.0 or len(hull.vertices) == 1):
        row = _along(hull.vertices[0], hull.vertices[-1], rounding, most, enough)
        return np.column_stack(row)
    sides = hull.triangles
    edges = np.vstack([sides[:, [0, 1]], sides[:, [1, 2]], sides[:, [2, 0]]])
    edges = np.unique(np.sort(edges, axis=1), axis=0)
    planes = hull.planes.copy() if hull.solid else np.zeros((0, 4))
    found = cover(hull.vertices.copy(), edges, planes, most, enough)
    centers, outer, depths = found[:, :3], found[:, 3], found[:, 4]
    if kind != PieceKind.POLYTOPE:
        nearest = nearest_on_cone if kind == PieceKind.CONE else nearest_on_cylinder
        depths = np.array([-nearest(tuple(p), radius, half)[3] for p in centers.tolist()])
    return np.column_stack(
        [centers, outer + rounding + _ROUNDING, depths + rounding - _ROUNDING, found[:, 5]]
    )


def _along(
    a: Array, b: Array, rounding: float, most: int, enough: float
) -> tuple[Array, Array, Array, Indices]:
    """Of a rounded segment, or point: balls of radius R + t whose rims meet on its side.

    With k balls 2 h apart, h^2 = (R + t)^2 - R^2, and the first and last one t from the ends, the
    length is 2 t + 2 (k - 1) h.
    """
    length = float(np.linalg.norm(b - a))
    count, excess = 1, 0.5 * length
    while count < most and excess > enough:
        count += 1
        low, high = 0.0, 0.5 * length
        for _ in range(60):
            excess = 0.5 * (low + high)
            h = math.sqrt(excess * (excess + 2.0 * rounding))
            longer = 2.0 * excess + 2.0 * (count - 1) * h > length
            low, high = (low, excess) if longer else (excess, high)
        excess = high
    at = np.linspace(excess, length - excess, count) / length if length > 0.0 else np.zeros(1)
    rows: list[tuple[Array, float, int]] = []
    _halve(a + at[:, None] * (b - a), rounding + excess, rows)
    found = np.array([[*center, radius, after] for center, radius, after in rows])
    outer, skips = found[:, 3] + _ROUNDING, found[:, 4].astype(np.int64)
    return found[:, :3], outer, np.full(len(found), rounding - _ROUNDING), skips


def _halve(centers: Array, radius: float, rows: list[tuple[Array, float, int]]) -> None:
    """Append the ball about equal balls in a row, and those below it."""
    number = len(rows)
    middle = 0.5 * (centers[0] + centers[-1])
    reach = radius + 0.5 * float(np.linalg.norm(centers[-1] - centers[0]))
    rows.append((middle, reach, 0))
    if len(centers) > 1:
        half = len(centers) // 2
        _halve(centers[:half], radius, rows)
        _halve(centers[half:], radius, rows)
    rows[number] = (middle, reach, len(rows))


def _around(kind: PieceKind, radius: float, half: float) -> Array:
    """Corners of the prism about a cylinder, or the pyramid about a cone."""
    turn = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
    rim = (
        radius / np.cos(np.pi / _SIDES) * np.column_stack([np.cos(turn), np.sin(turn), 0.0 * turn])
    )
    top = rim if kind == PieceKind.CYLINDER else np.zeros((1, 3))
    up = np.array([0.0, 0.0, half])
    return np.vstack([rim - up, top + up])
