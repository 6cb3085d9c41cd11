"""Orthogonal projection of points onto obstacles.

For a closed convex solid O and a point p outside there is exactly one nearest point pi(p) in O, and
p - pi(p) is orthogonal to O's boundary there. Inside, pi(p) is taken to be the nearest point of the
boundary, and the distance is negative. Everything is computed in closed form: to 1e-9 m on
primitives and hulls alike. On a mesh that is not convex pi(p) is a nearest point of its triangles
(there may be several), and inside is what they enclose.

Obstacles packed for projections: their convex cores, and the triangles of meshes.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from compiled.kernel import kernel
from compiled.vec3 import Vector, rotate, turned_back
from kinematics.arrays import Array, Indices
from kinematics.caches.bounded_cache import array_bytes, bounded_cache
from kinematics.errors import InvalidScene
from obstacles.convex.closest_point import (
    Nearest,
    nearest_on_box,
    nearest_on_cone,
    nearest_on_cylinder,
    nearest_on_hull,
)
from obstacles.convex.piece import (
    Hull,
    Piece,
    PieceArrays,
    PieceKind,
    convex_hull,
    core_of,
    principal_axes,
)
from obstacles.meshes.winding import winding_numbers
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Mesh, PointCloud

HULL = int(PieceKind.POLYTOPE)
CYLINDER = int(PieceKind.CYLINDER)
CONE = int(PieceKind.CONE)
HALFSPACE = int(PieceKind.HALFSPACE)
#: Boxes about their frame have a shorter way than other hulls.
BOX = 4
#: Winding number beyond which a point is inside.
INSIDE = 0.5


class ProjectionArrays(NamedTuple):
    """Pieces packed for ``project_kernel``: p of them, of o obstacles.

    Args:
        kinds: Kinds of each piece, shape (p,).
        poses: T_world_piece, shape (p, 4, 4).
        sizes: Radius, half height, rounding (of a box: half sizes, 0); shape (p, 4).
        balls: Centre and radius of a ball about the piece in the world, shape (p, 4).
        across: A direction across a core without inside, in the piece's frame, shape (p, 3).
        solid: Whether a hull has an inside, shape (p,).
        corners: Corners of all hulls, shape (c, 3).
        corner_starts: Shape (p + 1,).
        triangles: Triangles of all hulls, shape (f, 3).
        planes: Planes of all hulls, shape (f, 4).
        triangle_starts: Shape (p + 1,).
        owners: Index of the obstacle of each piece, in ascending order, shape (p,).
        enclosing: First of the pieces whose triangles together enclose an obstacle's inside, and
            one behind the last; equal where there are none; shape (o, 2).
        around: Centre and radius of a ball about these in the world, shape (o, 4).
    """

    kinds: NDArray[np.int64]
    poses: Array
    sizes: Array
    balls: Array
    across: Array
    solid: NDArray[np.bool_]
    corners: Array
    corner_starts: NDArray[np.int64]
    triangles: NDArray[np.int64]
    planes: Array
    triangle_starts: NDArray[np.int64]
    owners: NDArray[np.int64] = np.zeros(0, dtype=np.int64)
    enclosing: NDArray[np.int64] = np.zeros((0, 2), dtype=np.int64)
    around: Array = np.zeros((0, 4))


def pack_obstacles(obstacles: Sequence[Obstacle]) -> ProjectionArrays:
    """Pack obstacles, in their order, for ``projection.project_kernel``."""
    # Those that are packed alike together: a call for each of many small ones costs the most.
    blocks, counts, filled = [_EMPTY], list[int](), list[int]()
    for is_cloud, run in groupby(obstacles, lambda obstacle: obstacle.is_cloud):
        if is_cloud:
            own = [_cloud(obstacle.balls()) for obstacle in run]
            counts += [len(block.kinds) for block in own]
            filled += [0] * len(own)
            blocks += own
        else:
            parts, enclosing = zip(*map(convex_parts, run), strict=True)
            counts += [len(pieces) for pieces in parts]
            filled += enclosing
            blocks.append(_solids([piece for pieces in parts for piece in pieces]))
    # Most scenes are one block.
    joined = (
        blocks[1]
        if len(blocks) == 2
        else ProjectionArrays(*map(np.concatenate, zip(*blocks, strict=True)))
    )
    starts = _starts(_indices(counts))
    ends = np.empty((len(counts), 2), dtype=np.int64)
    ends[:, 0], ends[:, 1] = starts[:-1], starts[:-1] + _indices(filled)
    return joined._replace(
        corner_starts=_starts(joined.corner_starts),
        triangle_starts=_starts(joined.triangle_starts),
        owners=np.repeat(np.arange(len(counts)), counts),
        enclosing=ends,
        around=_all_around(joined.balls, ends),
    )


def _starts(counts: Indices) -> Indices:
    starts = np.zeros(len(counts) + 1, dtype=np.int64)
    counts.cumsum(out=starts[1:])
    return starts


def _all_around(balls: Array, ends: Indices) -> Array:
    """``_around`` of the balls from one number to before another (o, 2), shape (o, 4)."""
    around = np.zeros((len(ends), 4))
    for k in np.flatnonzero(ends[:, 0] < ends[:, 1]).tolist():
        around[k] = _around(balls[ends[k, 0] : ends[k, 1]])
    return around


def _around(balls: Array) -> Array:
    """A ball about others (k, 4), shape (4,)."""
    center = balls[:, :3].mean(axis=0)
    reach = np.linalg.norm(balls[:, :3] - center, axis=1) + balls[:, 3]
    return np.array([*center, reach.max()])


def convex_parts(obstacle: Obstacle) -> tuple[tuple[Piece, ...], int]:
    """An obstacle's pieces, and how many of them, the first ones, have its enclosing triangles."""
    pieces = obstacle.pieces()
    filled = tuple(piece for piece in pieces if piece.surface and piece.surface.count)
    if filled and isinstance(obstacle.shape, Mesh):
        rest = (piece for piece in pieces if piece not in filled)
        pieces = (*filled, *(piece for piece in rest if not _is_enclosed(piece, filled)))
    return pieces, len(filled)


def _is_enclosed(piece: Piece, filled: Sequence[Piece]) -> bool:
    """Whether a solid is what the triangles of others of the same mesh enclose."""
    if piece.surface is not None:
        return False
    corners = np.vstack([p.surface.triangles.reshape(-1, 3) for p in filled if p.surface])
    number, faces = np.empty(1), np.arange(len(corners)).reshape(-1, 3)
    winding_numbers(piece.vertices.mean(axis=0)[None], corners, faces, number)
    return bool(number[0] > INSIDE)


def _cloud(cloud: PieceArrays) -> ProjectionArrays:
    """Balls of one obstacle, with counts in place of starts and no owners yet."""
    p = len(cloud)
    one = np.ones(p, dtype=np.int64)
    return ProjectionArrays(
        kinds=cloud.kinds,
        poses=cloud.poses,
        sizes=np.hstack([cloud.sizes, np.zeros((p, 1))]),
        balls=np.column_stack([cloud.centers, cloud.radii]),
        across=np.tile([1.0, 0.0, 0.0], (p, 1)),
        solid=np.zeros(p, dtype=np.bool_),
        corners=cloud.vertices,
        corner_starts=one,
        triangles=np.zeros((p, 3), dtype=np.int64),
        planes=np.zeros((p, 4)),
        triangle_starts=one,
    )


def _solids(pieces: Sequence[Piece]) -> ProjectionArrays:
    """Pieces with counts in place of starts and no owners yet."""
    p, cores = len(pieces), [_core(piece) for piece in pieces]
    hulls = [core.hull for core in cores]
    filled = [_NO_HULL, *(hull for hull in hulls if hull is not _NO_HULL)]
    poses = np.array([piece.T_owner_piece for piece in pieces]).reshape(p, 4, 4)
    balls = np.array([core.ball for core in cores]).reshape(p, 4)
    middles = balls[:, :3, None]
    middles[:] = poses[:, :3, :3] @ middles + poses[:, :3, 3:]
    return ProjectionArrays(
        kinds=_indices([core.kind for core in cores]),
        poses=poses,
        sizes=np.array([core.size for core in cores]).reshape(p, 4),
        balls=balls,
        across=np.array([core.across for core in cores]).reshape(p, 3),
        solid=np.array([hull.solid for hull in hulls], dtype=np.bool_),
        corners=np.vstack([hull.vertices for hull in filled]),
        corner_starts=_indices([len(hull.vertices) for hull in hulls]),
        triangles=np.vstack([hull.triangles for hull in filled]),
        planes=np.vstack([hull.planes for hull in filled]),
        triangle_starts=_indices([len(hull.triangles) for hull in hulls]),
    )


def _indices(values: ArrayLike) -> Indices:
    return np.array(values, dtype=np.int64)


_NO_HULL = Hull(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64), np.zeros((0, 4)), solid=False)


class _Core(NamedTuple):
    """A piece in its own frame: what its columns of ``ProjectionArrays`` are made of."""

    kind: int
    size: Array
    ball: Array
    across: Array
    hull: Hull


def _core(piece: Piece) -> _Core:
    if piece.surface is None:
        return _plain(
            piece.kind,
            piece.vertices.tobytes(),
            piece.radius,
            piece.half_height,
            piece.offset_radius,
        )
    # Its own triangles, and the ball that holds its cover.
    corners = piece.surface.triangles.reshape(-1, 3)
    faces = np.arange(len(corners)).reshape(-1, 3)
    hull = Hull(corners, faces, np.zeros((len(faces), 4)), solid=False)
    return _cornered(replace(piece, T_owner_piece=np.eye(4)), hull, 0.0)


#: Obstacles that only move from request to request keep their cores.
@bounded_cache(maxsize=4096, weigh=array_bytes)
def _plain(
    kind: PieceKind, corners: bytes, radius: float, half_height: float, rounding: float
) -> _Core:
    core = core_of(int(kind), corners, radius, half_height)
    half = core.half if rounding == 0.0 else None
    if kind == PieceKind.POLYTOPE and half is None:
        vertices = np.frombuffer(corners).reshape(-1, 3)
        piece = Piece(kind, np.eye(4), vertices, radius, half_height, rounding)
        return _cornered(piece, convex_hull(vertices), rounding)
    ball, size = np.array([*core.center, core.radius + rounding]), np.zeros(4)
    if half is None:
        size[:3] = radius, half_height, rounding
        return _Core(int(kind), size, ball, _ALONG_X, _NO_HULL)
    size[:] = half[0], half[1], 0.0, half[2]
    return _Core(BOX, size, ball, _ALONG_X, _NO_HULL)


def _cornered(piece: Piece, hull: Hull, rounding: float) -> _Core:
    size = np.array([piece.radius, piece.half_height, rounding, 0.0])
    center, radius = piece.bounding_sphere()
    is_flat = len(hull.vertices) > 1 and not hull.solid
    across = principal_axes(hull.vertices)[2] if is_flat else _ALONG_X
    return _Core(HULL, size, np.array([*center, radius]), across, hull)


_ALONG_X = np.array([1.0, 0.0, 0.0])


_EMPTY = _solids(())


#: Distances from a core below this part of its size leave no direction to round it along.
_ON_CORE = 1e-14


class Projector:
    """Projects points onto the same obstacles again and again.

    Args:
        obstacles: A scene, or obstacles; their margins are no part of them.
    """

    def __init__(self, obstacles: Scene | Sequence[Obstacle]) -> None:
        found = obstacles.obstacles if isinstance(obstacles, Scene) else tuple(obstacles)
        self.ids = tuple(obstacle.id for obstacle in found)
        self.arrays = pack_obstacles(found)

    def __call__(self, points: ArrayLike, within: Array | None = None) -> tuple[Array, Array]:
        """Project ``points`` onto every obstacle.

        A union of several solids (a point cloud, a mesh of several bodies) is answered by the one
        of the smallest signed distance. Outside of all of them that is exact; inside, the distance
        is a bound: the way out of the union is at least as long as out of that one.

        Args:
            points: Shape (m, 3) [m].
            within: Distance from a point beyond which obstacles may be left out: their distance is
                infinite, their projection NaN; shape (m,) [m]. None for everything.

        Returns:
            pi(p) for each point and obstacle, shape (m, o, 3) [m]; the signed distance, negative
            inside, shape (m, o) [m].

        Raises:
            InvalidScene: Wrong shape or not finite.
        """
        checked = checked_points(points)
        projection = np.full((len(checked), len(self.ids), 3), np.nan)
        distance = np.empty((len(checked), len(self.ids)))
        reach = np.full(len(checked), np.inf) if within is None else within
        project_kernel(checked, self.arrays, reach, projection, distance)
        return projection, distance


def project(points: ArrayLike, obstacles: Scene | Sequence[Obstacle]) -> tuple[Array, Array]:
    """Project ``points`` (m, 3) onto every obstacle, as ``Projector`` does.

    Raises:
        InvalidScene: Wrong shape or not finite.
    """
    return Projector(obstacles)(points)


def without_points(scene: Scene, cloud: str, name: str, margin: float) -> Scene:
    """The scene with a cloud that has no points on or in another obstacle.

    Args:
        scene: The obstacles.
        cloud: Name of the point cloud; it is left out where none of its points are left.
        name: Name of the other obstacle.
        margin: Points nearer to it than this are left out [m].

    Raises:
        InvalidObjectName: There is no such obstacle.
        InvalidScene: The two stand in different frames.
    """
    whole, other = scene.obstacle(cloud), scene.obstacle(name)
    if whole.frame != other.frame or not isinstance(whole.shape, PointCloud):
        raise InvalidScene(
            f"cloud {cloud!r} and {name!r}, whose points it leaves out, are in different frames",
            hint="Give both in one frame.",
        )
    T = whole.T_world_obstacle
    points = whole.shape.points
    distance = project(points @ T[:3, :3].T + T[:3, 3], (other,))[1][:, 0]
    kept = points[distance > margin]
    shape = replace(whole, shape=PointCloud(kept, whole.shape.radius)) if len(kept) else None
    changed = (shape if item.id == cloud else item for item in scene.obstacles)
    return replace(scene, obstacles=tuple(item for item in changed if item is not None))


@kernel
def project_kernel(
    points: Array, arrays: ProjectionArrays, within: Array, projection: Array, distance: Array
) -> None:
    """Write pi(p) (m, o, 3) and the signed distance (m, o) of ``points`` (m, 3).

    What is farther from a point than ``within`` (m,) may be left out: its distance is infinite.
    """
    enclosing = arrays.enclosing
    for m in range(points.shape[0]):
        p = (points[m, 0], points[m, 1], points[m, 2])
        distance[m] = np.inf
        for i in range(arrays.kinds.shape[0]):
            owner = arrays.owners[i]
            ball = arrays.balls[i]
            x, y, z = p[0] - ball[0], p[1] - ball[1], p[2] - ball[2]
            # Outside of the ball, the piece is at least as far as it; inside it may be anything.
            least = np.sqrt(x * x + y * y + z * z) - ball[3]
            if least >= max(distance[m, owner], 0.0):
                continue
            # From deep inside of a mesh its triangles may all be far away.
            empty = enclosing[owner, 0] == enclosing[owner, 1]
            if least > within[m] and (empty or not _holds(arrays.around[owner], p)):
                continue
            nearest = _on_piece(arrays, i, p)
            if nearest[3] < distance[m, owner]:
                projection[m, owner, 0] = nearest[0]
                projection[m, owner, 1] = nearest[1]
                projection[m, owner, 2] = nearest[2]
                distance[m, owner] = nearest[3]
        for owner in range(distance.shape[1]):
            if enclosing[owner, 0] == enclosing[owner, 1] or not distance[m, owner] > 0.0:
                continue
            if _holds(arrays.around[owner], p) and _winding(arrays, owner, p) > INSIDE:
                distance[m, owner] = -distance[m, owner]


@kernel(inline="always")
def _holds(ball: Array, p: Vector) -> bool:
    x, y, z = p[0] - ball[0], p[1] - ball[1], p[2] - ball[2]
    return bool(x * x + y * y + z * z <= ball[3] * ball[3])


@kernel(inline="always")
def _winding(arrays: ProjectionArrays, owner: int, p: Vector) -> float:
    """How often the triangles that enclose an obstacle wind around p."""
    total, number, point = 0.0, np.empty(1), np.empty((1, 3))
    for i in range(arrays.enclosing[owner, 0], arrays.enclosing[owner, 1]):
        point[0, 0], point[0, 1], point[0, 2] = _to_local(arrays.poses[i], p)
        corners = arrays.corners[arrays.corner_starts[i] : arrays.corner_starts[i + 1]]
        faces = arrays.triangles[arrays.triangle_starts[i] : arrays.triangle_starts[i + 1]]
        winding_numbers(point, corners, faces, number)
        total += number[0]
    return total


@kernel(inline="always")
def _to_local(T: Array, p: Vector) -> Vector:
    return turned_back(T, (p[0] - T[0, 3], p[1] - T[1, 3], p[2] - T[2, 3]))


@kernel(inline="always")
def _on_piece(arrays: ProjectionArrays, i: int, p: Vector) -> Nearest:
    """Nearest point of the boundary of piece i, in the world."""
    T = arrays.poses[i]
    local = _to_local(T, p)
    size = arrays.sizes[i]
    kind = arrays.kinds[i]
    q = (0.0, 0.0, 0.0, 0.0)
    if kind == HALFSPACE:
        q = (local[0], local[1], 0.0, local[2])
    elif kind == BOX:
        q = nearest_on_box(local, (size[0], size[1], size[3]))
    elif kind == CYLINDER:
        q = nearest_on_cylinder(local, size[0], size[1])
    elif kind == CONE:
        q = nearest_on_cone(local, size[0], size[1])
    else:
        c0, c1 = arrays.corner_starts[i], arrays.corner_starts[i + 1]
        f0, f1 = arrays.triangle_starts[i], arrays.triangle_starts[i + 1]
        planes = arrays.planes[f0:f1]
        q = nearest_on_hull(
            local, arrays.corners[c0:c1], arrays.triangles[f0:f1], planes, arrays.solid[i]
        )
    if size[2] > 0.0:
        q = _rounded(arrays, i, local, q)
    x, y, z = rotate(T, (q[0], q[1], q[2]))
    return x + T[0, 3], y + T[1, 3], z + T[2, 3], q[3]


@kernel(inline="always")
def _rounded(arrays: ProjectionArrays, i: int, p: Vector, q: Nearest) -> Nearest:
    """Nearest point of the boundary of a rounded core, from that of the core itself."""
    rounding, distance = arrays.sizes[i, 2], q[3]
    if abs(distance) > _ON_CORE * arrays.balls[i, 3]:
        x, y, z = (p[0] - q[0]) / distance, (p[1] - q[1]) / distance, (p[2] - q[2]) / distance
    else:
        x, y, z = arrays.across[i, 0], arrays.across[i, 1], arrays.across[i, 2]
        if arrays.solid[i]:
            highest = -np.inf
            for f in range(arrays.triangle_starts[i], arrays.triangle_starts[i + 1]):
                n = arrays.planes[f]
                height = n[0] * p[0] + n[1] * p[1] + n[2] * p[2] - n[3]
                if height > highest:
                    highest = height
                    x, y, z = n[0], n[1], n[2]
    return q[0] + rounding * x, q[1] + rounding * y, q[2] + rounding * z, distance - rounding


def checked_points(points: ArrayLike) -> Array:
    """Points as an array of shape (m, 3).

    Raises:
        InvalidScene: Wrong shape or not finite.
    """
    try:
        array = np.array(points, dtype=np.float64, order="C")
    except (TypeError, ValueError):
        raise InvalidScene("points: not an array of numbers") from None
    if array.ndim != 2 or array.shape[1] != 3:
        raise InvalidScene(f"points: shape {array.shape}, needed are rows [x, y, z]")
    if not np.isfinite(array).all():
        raise InvalidScene("points: not finite")
    return array
