"""Convex pieces: the one form in which every kernel sees every shape.

A piece is the Minkowski sum of a convex core and a ball (``offset_radius``): a sphere is a rounded
point, a capsule a rounded segment, a box or hull a polytope, cylinders, cones and half-spaces
are kept as they are. All are exact: nothing is tessellated. A piece of a mesh that is not convex
covers a part of it, and carries the triangles that decide where the cover does not do.

Convex hulls of point sets, flat and segment-like ones included.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from compiled.kernel import kernel
from kinematics.arrays import Array, frozen
from kinematics.caches.bounded_cache import array_bytes, bounded_cache

#: Of more points than this, those that are surely inside of the hull are looked for first.
_MANY = 1000
#: Points or planes that are looked at together: with as many sides they take some megabytes.
_AT_ONCE = 4096
#: How deep such a point lies at least, as a part of the points' extent.
_INSIDE = 1e-9
#: Extents below this part of the largest one are rounding errors of the coordinates, no thickness.
_FLATNESS = 1e-9


def _directions(count: int) -> Array:
    """Both ways along the axes, then others along a spiral of equal areas, (3, count + 6).

    Those follow each other in leaps: hulls that grow evenly make fewer faces that do not last.
    """
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(count)
    flat = np.sqrt(1.0 - z * z)
    spiral = np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z])
    leaps = np.arange(count) * 77 % count
    return np.ascontiguousarray(np.vstack([np.eye(3), -np.eye(3), spiral[leaps]]).T)


#: Directions all over the sphere, (3, d): points that are the farthest along one are corners.
DIRECTIONS = _directions(200)


@dataclass(frozen=True, slots=True, eq=False)
class Hull:
    """The convex hull of a point set.

    Args:
        vertices: Corners of the hull, shape (k, 3) [m].
        triangles: Surface of the hull, counter-clockwise seen from outside where it has an inside,
            shape (f, 3) of indices into ``vertices``; corners repeat where it is a segment or a
            point.
        planes: Unit normal and offset of each triangle, n.x <= o inside, shape (f, 4).
        solid: Whether the hull has an inside; a polygon, a segment and a point have none.
    """

    vertices: Array
    triangles: NDArray[np.int64]
    planes: Array
    solid: bool

    def __post_init__(self) -> None:
        for item in fields(self):
            if item.name != "solid":
                getattr(self, item.name).setflags(write=False)

    @property
    def volume(self) -> float:
        """Enclosed volume, one sixth of the sum of a.(b x c) over the triangles [m^3]."""
        if not self.solid:
            return 0.0
        corners = (self.vertices - self.vertices.mean(axis=0))[self.triangles]
        a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def principal_axes(points: Array) -> Array:
    """Principal axes of ``points`` (m, 3) about their mean, the widest first; rows, shape (3, 3).

    The singular vectors of the m x 3 matrix; those of its other side, m x m, are never made.
    """
    # Fewer points than axes leave axes that only the full decomposition has.
    full = len(points) < 3
    _, _, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=full)
    return np.asarray(axes)


def corners_and_volume(points: Array) -> tuple[Array, float]:
    """Corners of the hull of ``points`` (m, 3), m >= 1, and its volume [m^3].

    As those of `convex_hull`, whose planes cost more than both where corners are many.
    """
    points = _without_inner(points)
    try:
        hull = scipy.spatial.ConvexHull(points)
    except (scipy.spatial.QhullError, ValueError):
        return convex_hull(points).vertices, 0.0
    return np.ascontiguousarray(points[hull.vertices]), float(hull.volume)


def farthest_points(points: Array) -> Array:
    """Those of ``points`` (m, 3) that are the farthest ones along some of ``DIRECTIONS``."""
    while len(points):
        blocks = np.array_split(points, len(points) // _AT_ONCE + 1)
        kept = [block[np.unique((block @ DIRECTIONS).argmax(axis=0))] for block in blocks]
        points = np.concatenate(kept)
        if len(blocks) == 1:
            break
    return points


def _without_inner(points: Array) -> Array:
    """Points without most of those that are inside of the hull."""
    if len(points) <= _MANY:
        return points
    inner = convex_hull(farthest_points(points))
    if not inner.solid:
        return points
    depth = _INSIDE * float(np.ptp(inner.vertices, axis=0).max())
    blocks = np.array_split(points, len(points) // _AT_ONCE + 1)
    heights = (block @ inner.planes[:, :3].T - inner.planes[:, 3] for block in blocks)
    outer = np.concatenate([(above > -depth).any(axis=1) for above in heights])
    return np.asarray(points[outer])


def convex_hull(points: Array) -> Hull:
    """The convex hull of ``points``, shape (m, 3) with m >= 1, all finite."""
    points = _without_inner(np.asarray(points, dtype=np.float64).reshape(-1, 3))
    points = np.unique(points, axis=0)
    center = points.mean(axis=0)
    _, extents, axes = np.linalg.svd(points - center, full_matrices=False)
    rank = int(np.count_nonzero(extents > _FLATNESS * extents[0])) if extents[0] > 0.0 else 0
    if rank == 3:
        try:
            return _solid(points)
        except scipy.spatial.QhullError:
            rank = 2  # thinner than qhull can tell from flat
    if rank == 2:
        flat = (points - center) @ axes[:2].T
        return _polygon(points[scipy.spatial.ConvexHull(flat).vertices])
    if rank == 1:
        along = (points - center) @ axes[0]
        points = points[[int(np.argmin(along)), int(np.argmax(along))]]
    else:
        points = points[:1]
    last = len(points) - 1
    return Hull(points, np.array([[0, last, last]]), np.zeros((1, 4)), solid=False)


def _solid(points: Array) -> Hull:
    hull = scipy.spatial.ConvexHull(points)
    corners = hull.vertices
    number = np.full(len(points), -1)
    number[corners] = np.arange(len(corners))
    triangles = number[hull.simplices]
    vertices = np.ascontiguousarray(points[corners])
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    outward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3])
    triangles[outward < 0.0] = triangles[outward < 0.0][:, ::-1]
    planes = np.array(hull.equations)
    # Qhull joins nearly coplanar facets: no corner may lie outside of a plane that is trusted.
    blocks = np.array_split(planes[:, :3], len(planes) // _AT_ONCE + 1)
    planes[:, 3] = np.concatenate([(block @ vertices.T).max(axis=1) for block in blocks])
    return Hull(vertices, triangles.astype(np.int64), planes, solid=True)


def _polygon(corners: Array) -> Hull:
    k = len(corners)
    fan = np.array([[0, i, i + 1] for i in range(1, k - 1)], dtype=np.int64)
    return Hull(np.ascontiguousarray(corners), fan, np.zeros((k - 2, 4)), solid=False)


class PieceKind(IntEnum):
    """The core of a piece."""

    POLYTOPE = 0
    CYLINDER = 1
    CONE = 2
    HALFSPACE = 3


_POLYTOPE = int(PieceKind.POLYTOPE)


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """The triangles of a mesh that one convex piece covers, in the piece's frame.

    Args:
        triangles: Corners of the triangles, shape (t, 3, 3) [m].
        anchors: A point on each of the bodies they belong to, shape (r, 3) [m].
        mesh: Triangles of the whole mesh, as they were given, shape (f, 3, 3) [m].
        place: Number of the piece among those whose triangles together bound a solid.
        count: How many these are, one behind the other; 0 where nothing is enclosed.
    """

    triangles: Array
    anchors: Array
    mesh: Array
    place: int = 0
    count: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """One convex solid in the frame of what owns it.

    Args:
        kind: Kind of the core. Cylinder and cone are centred, along z (a cone's apex is at
            +half_height); a half-space is z <= 0 of its frame.
        T_owner_piece: Frame of the piece in its owner's frame, shape (4, 4).
        vertices: Vertices of a polytope, in the piece's frame, shape (k, 3) [m]; empty otherwise.
        radius: Radius of a cylinder or a cone's base [m].
        half_height: Half the height of a cylinder or cone [m].
        offset_radius: Radius of the ball added to the core [m].
        surface: The part of a mesh it stands for, None where it is the solid itself.
    """

    kind: PieceKind
    T_owner_piece: Array
    vertices: Array
    radius: float = 0.0
    half_height: float = 0.0
    offset_radius: float = 0.0
    surface: Surface | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_owner_piece", frozen(self.T_owner_piece))
        corners = self.vertices
        if getattr(corners, "ndim", 0) != 2:
            corners = np.reshape(corners, (-1, 3))
        object.__setattr__(self, "vertices", frozen(corners))

    def placed(self, T: Array) -> "Piece":
        """The piece moved by ``T`` (4, 4): from its owner's frame into the one T maps into."""
        pose = T @ self.T_owner_piece
        pose.setflags(write=False)
        moved = object.__new__(Piece)
        # What was checked once: a scene has many pieces, and is placed for every request.
        for name in _SAME_WHEREVER:
            object.__setattr__(moved, name, getattr(self, name))
        object.__setattr__(moved, "T_owner_piece", pose)
        return moved

    def bounding_sphere(self) -> tuple[Array, float]:
        """A ball that holds the whole piece: centre in the owner's frame (3,) [m], radius [m]."""
        T, core = self.T_owner_piece, self._core()
        return T[:3, :3] @ core.center + T[:3, 3], core.radius + self.offset_radius

    def local_box(self) -> Array:
        """A box that holds the piece: centre and half sizes in the piece's frame, shape (6,)."""
        box = self._core().box.copy()
        box[3:] += self.offset_radius
        return box

    def box_half_sizes(self) -> Array | None:
        """Half the sizes of a box about the piece's frame, shape (3,); None for any other piece."""
        return None if self.offset_radius > 0.0 else self._core().half

    def _core(self) -> "Core":
        return core_of(int(self.kind), self.vertices.tobytes(), self.radius, self.half_height)


_SAME_WHEREVER = tuple(f.name for f in fields(Piece) if f.name != "T_owner_piece")


class Core(NamedTuple):
    """Bounding ball and box of a core in its frame, with half the box's size.

    Args:
        center: Centre of the ball, shape (3,) [m].
        radius: Radius of the ball [m].
        box: Middle and half sizes, shape (6,) [m].
        half: Half the sizes of a core that is a box about its frame, shape (3,); else None [m].
    """

    center: Array
    radius: float
    box: Array
    half: Array | None


#: Obstacles that move from request to request keep their cores.
@bounded_cache(maxsize=4096, weigh=array_bytes)
def core_of(kind: int, vertices: bytes, radius: float, half_height: float) -> Core:
    """The core of a piece by what it is made of; the bytes are those of its corners (k, 3)."""
    zero = np.zeros(3)
    if kind == PieceKind.HALFSPACE:
        return Core(zero, np.inf, np.array([0.0, 0.0, 0.0, np.inf, np.inf, np.inf]), None)
    if kind == PieceKind.POLYTOPE:
        corners = np.frombuffer(vertices).reshape(-1, 3)
        low, high = corners.min(axis=0), corners.max(axis=0)
        box = np.concatenate([(low + high) / 2.0, (high - low) / 2.0])
        reach = math.sqrt(((corners - box[:3]) ** 2).sum(axis=1).max())
        octants = set(map(tuple, (corners > 0.0).tolist()))
        is_box = len(corners) == len(octants) == 8 and bool((abs(corners) == abs(corners[0])).all())
        return Core(box[:3], reach, box, box[3:] if is_box else None)
    box = np.array([0.0, 0.0, 0.0, radius, radius, half_height])
    if kind == PieceKind.CYLINDER:
        return Core(zero, float(np.hypot(radius, half_height)), box, None)
    height, reach = cone_ball(radius, half_height)
    return Core(np.array([0.0, 0.0, height]), reach, box, None)


@kernel(allocates=False, unlocks=False)
def cone_ball(radius: float, half_height: float) -> tuple[float, float]:
    """How far up a cone's axis the middle of the ball that holds it is, and its radius [m]."""
    height = 2.0 * half_height
    if radius >= height:
        return -half_height, radius
    # The circle through the apex and the rim of the base.
    ball = (height * height + radius * radius) / (2.0 * height)
    return half_height - ball, ball


@dataclass(frozen=True, slots=True, eq=False)
class PieceArrays:
    """Pieces packed for the kernels (p pieces, v vertices in all).

    Args:
        kinds: Shape (p,).
        starts: Vertices of piece i are ``vertices[starts[i]:starts[i + 1]]``, shape (p + 1,).
        vertices: Vertices in the piece's frame, shape (v, 3).
        sizes: Radius, half height, rounding; shape (p, 3).
        poses: T_owner_piece, shape (p, 4, 4).
        centers: Centres of the bounding balls in the owner's frame, shape (p, 3).
        radii: Radii of the bounding balls, shape (p,).
        boxes: ``local_box`` of each, shape (p, 6).
    """

    kinds: NDArray[np.int64]
    starts: NDArray[np.int64]
    vertices: Array
    sizes: Array
    poses: Array
    centers: Array
    radii: Array
    boxes: Array

    def __post_init__(self) -> None:
        for item in fields(self):
            getattr(self, item.name).setflags(write=False)

    def __len__(self) -> int:
        return len(self.kinds)

    @classmethod
    def balls(cls, points: Array, radius: float, T: Array) -> "PieceArrays":
        """Balls about ``points`` (k, 3), which ``T`` (4, 4) maps into their owner's frame."""
        k = len(points)
        return cls(
            kinds=np.full(k, int(PieceKind.POLYTOPE), dtype=np.int64),
            starts=np.arange(k + 1),
            vertices=points,
            sizes=np.tile([0.0, 0.0, radius], (k, 1)),
            poses=np.tile(T, (k, 1, 1)),
            centers=points @ T[:3, :3].T + T[:3, 3],
            radii=np.full(k, radius),
            boxes=np.hstack([points, np.full((k, 3), radius)]),
        )

    @classmethod
    def joined(cls, blocks: Sequence["PieceArrays"]) -> "PieceArrays":
        """Rows of several sets one behind the other."""
        if len(blocks) == 1:
            return blocks[0]
        columns = {
            item.name: np.concatenate([getattr(block, item.name) for block in blocks])
            for item in fields(cls)
            if item.name != "starts"
        }
        counts = np.concatenate([np.diff(block.starts) for block in blocks])
        starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        return cls(starts=starts, **columns)

    @classmethod
    def pack(cls, pieces: Sequence[Piece]) -> "PieceArrays":
        """Put ``pieces`` side by side, in their order."""
        p = len(pieces)
        starts = np.zeros(p + 1, dtype=np.int64)
        np.cumsum([len(piece.vertices) for piece in pieces], out=starts[1:])
        vertices = np.concatenate([piece.vertices for piece in pieces] or [np.zeros((0, 3))])
        sizes = [(piece.radius, piece.half_height, piece.offset_radius) for piece in pieces]
        all_sizes = np.array(sizes, dtype=np.float64).reshape(p, 3)
        poses = np.array([piece.T_owner_piece for piece in pieces]).reshape(p, 4, 4)
        kinds = np.array([piece.kind for piece in pieces], dtype=np.int64)
        centers, radii, boxes = np.zeros((p, 3)), np.empty(p), np.empty((p, 6))
        for i, piece in enumerate(pieces):
            if piece.kind is not PieceKind.POLYTOPE:
                centers[i], radii[i] = piece.bounding_sphere()
                boxes[i] = piece.local_box()
        # All at once: a scene has many small ones.
        bound_polytopes(kinds, starts, vertices, all_sizes, poses, centers, radii, boxes)
        return cls(
            kinds=kinds,
            starts=starts,
            vertices=vertices,
            sizes=all_sizes,
            poses=poses,
            centers=centers,
            radii=radii,
            boxes=boxes,
        )


@kernel(allocates=False, unlocks=False)
def bound_polytopes(
    kinds: NDArray[np.int64], starts: NDArray[np.int64], vertices: Array, sizes: Array,
    poses: Array, centers: Array, radii: Array, boxes: Array,
) -> None:  # fmt: skip
    """Write ``centers``, ``radii`` and ``boxes`` of the pieces with corners, as ``PieceArrays``."""
    for k in range(kinds.shape[0]):
        if kinds[k] != _POLYTOPE or starts[k] == starts[k + 1]:
            continue
        rounding, farthest = sizes[k, 2], 0.0
        for axis in range(3):
            low, high = np.inf, -np.inf
            for v in range(starts[k], starts[k + 1]):
                low, high = min(low, vertices[v, axis]), max(high, vertices[v, axis])
            boxes[k, axis], boxes[k, 3 + axis] = (low + high) / 2.0, (high - low) / 2.0 + rounding
        for v in range(starts[k], starts[k + 1]):
            away = 0.0
            for axis in range(3):
                away += (vertices[v, axis] - boxes[k, axis]) ** 2
            farthest = max(farthest, away)
        radii[k] = np.sqrt(farthest) + rounding
        for row in range(3):
            center = poses[k, row, 3]
            for axis in range(3):
                center += poses[k, row, axis] * boxes[k, axis]
            centers[k, row] = center
