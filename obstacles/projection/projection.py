"""Orthogonal projection of points onto obstacles.

For a closed convex solid O and a point p outside there is exactly one nearest point pi(p) in O, and
p - pi(p) is orthogonal to O's boundary there. Inside, pi(p) is taken to be the nearest point of the
boundary, and the distance is negative. Everything is computed in closed form: to 1e-9 m on
primitives and hulls alike. On a mesh that is not convex pi(p) is a nearest point of its triangles
(there may be several), and inside is what they enclose.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from compiled.kernel import kernel
from compiled.vec3 import Vector
from kinematics.arrays import Array
from kinematics.errors import InvalidScene
from obstacles.convex.closest_point import (
    Nearest,
    nearest_on_box,
    nearest_on_cone,
    nearest_on_cylinder,
    nearest_on_hull,
)
from obstacles.meshes.winding import winding_numbers
from obstacles.projection.projection_arrays import (
    BOX,
    CONE,
    CYLINDER,
    HALFSPACE,
    INSIDE,
    ProjectionArrays,
    pack_obstacles,
)
from obstacles.scenes.scene import Obstacle, Scene

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

    def __call__(self, points: ArrayLike) -> tuple[Array, Array]:
        """Project ``points`` onto every obstacle.

        A union of several solids (a point cloud, a mesh of several bodies) is answered by the one
        of the smallest signed distance. Outside of all of them that is exact; inside, the distance
        is a bound: the way out of the union is at least as long as out of that one.

        Args:
            points: Shape (m, 3) [m].

        Returns:
            pi(p) for each point and obstacle, shape (m, o, 3) [m]; the signed distance, negative
            inside, shape (m, o) [m].

        Raises:
            InvalidScene: Wrong shape or not finite.
        """
        checked = checked_points(points)
        projection = np.empty((len(checked), len(self.ids), 3))
        distance = np.empty((len(checked), len(self.ids)))
        everything = np.full(len(checked), np.inf)
        project_kernel(checked, self.arrays, everything, projection, distance)
        return projection, distance


def project(points: ArrayLike, obstacles: Scene | Sequence[Obstacle]) -> tuple[Array, Array]:
    """Project ``points`` (m, 3) onto every obstacle, as ``Projector`` does.

    Raises:
        InvalidScene: Wrong shape or not finite.
    """
    return Projector(obstacles)(points)


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
    x, y, z = p[0] - T[0, 3], p[1] - T[1, 3], p[2] - T[2, 3]
    return (
        T[0, 0] * x + T[1, 0] * y + T[2, 0] * z,
        T[0, 1] * x + T[1, 1] * y + T[2, 1] * z,
        T[0, 2] * x + T[1, 2] * y + T[2, 2] * z,
    )


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
    return (
        T[0, 0] * q[0] + T[0, 1] * q[1] + T[0, 2] * q[2] + T[0, 3],
        T[1, 0] * q[0] + T[1, 1] * q[1] + T[1, 2] * q[2] + T[1, 3],
        T[2, 0] * q[0] + T[2, 1] * q[1] + T[2, 2] * q[2] + T[2, 3],
        q[3],
    )


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
