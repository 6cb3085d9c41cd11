"""Convex pieces: the one form in which every kernel sees every shape.

A piece is the Minkowski sum of a convex core and a ball (``offset_radius``): a sphere is a rounded
point, a capsule a rounded segment, a box or hull a polytope, cylinders, cones and half-spaces
are kept as they are. All are exact: nothing is tessellated. A piece of a mesh that is not convex
covers a part of it, and carries the triangles that decide where the cover does not do.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import kernel
from kinematics.arrays import Array, frozen
from kinematics.caches.bounded_cache import array_bytes, bounded_cache


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
