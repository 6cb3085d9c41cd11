"""Triangles cut by planes across an axis, and what a cut leaves of the hulls' volume."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from kinematics.arrays import Array, Indices
from kinematics.compiled.kernel import kernel
from kinematics.preparation_limit import check_preparation_time


def _spread(count: int) -> Array:
    """Directions all over the sphere, (count, 3), along a spiral of equal areas."""
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(count)
    flat = np.sqrt(1.0 - z * z)
    return np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z])


#: Where to look for the corners of a hull when only its volume is of interest.
_DIRECTIONS = np.vstack([_spread(200), np.eye(3), -np.eye(3)])


def triangle_areas(corners: Array) -> Array:
    """Areas of triangles (t, 3, 3)."""
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.asarray(0.5 * np.linalg.norm(cross, axis=1))


def cheapest_cut(edges: Array, points: Array, axis: int, places: Array) -> tuple[float, float]:
    """The cut across an axis that leaves the hulls of both sides least volume.

    Args:
        edges: Of the triangles, shape (e, 2, 3) [m].
        points: Their corners, shape (p, 3) [m].
        axis: 0, 1 or 2.
        places: Where a cut may be, ascending, shape (k,) [m].

    Returns:
        Where it is [m], and the volume that it leaves [m^3].
    """
    place = np.searchsorted(places, points[:, axis])
    order = np.argsort(place, kind="stable")
    slabs = np.split(points[order], np.searchsorted(place[order], np.arange(1, len(places) + 1)))
    ends = edges[:, :, axis]
    for k, at in enumerate(places):
        across = edges[(ends[:, 0] < at) != (ends[:, 1] < at)]
        cuts = _crossings(across[:, 0], across[:, 1], axis, at)
        slabs[k], slabs[k + 1] = np.vstack([slabs[k], cuts]), np.vstack([slabs[k + 1], cuts])
    slabs = [_farthest(slab) for slab in slabs]
    below = growing_volumes(slabs)[:-1]
    above = growing_volumes(slabs[::-1])[-2::-1]
    both = np.array(below) + np.array(above)
    return float(places[both.argmin()]), float(both.min())


def growing_volumes(slabs: list[Array]) -> list[float]:
    """Volumes of the hulls of the first one, two, ... slabs of points (k, 3) [m^3]."""
    corners, volumes = np.zeros((0, 3)), []
    for points in slabs:
        check_preparation_time()
        corners = _farthest(np.vstack([corners, points]))
        volumes.append(hull_volume(corners))
    return volumes


def hull_volume(points: Array) -> float:
    """Volume of the hull of points (k, 3), 0 where they are flat [m^3]."""
    try:
        return float(ConvexHull(points).volume)
    except (QhullError, ValueError):
        return 0.0


def _farthest(points: Array) -> Array:
    """The points that are the farthest ones along some direction: their hull is nearly the hull."""
    if len(points) <= len(_DIRECTIONS):
        return points
    indices = np.empty(len(_DIRECTIONS), dtype=np.int64)
    _extreme_points(np.ascontiguousarray(points.T), _DIRECTIONS, indices)
    return np.asarray(points[np.unique(indices)])


@kernel
def _extreme_points(columns: Array, directions: Array, indices: Indices) -> None:
    """Write which of the points (3, m) is the farthest along each of ``directions`` (d, 3)."""
    for k in range(directions.shape[0]):
        x, y, z = directions[k, 0], directions[k, 1], directions[k, 2]
        best, at = -np.inf, 0
        for i in range(columns.shape[1]):
            value = x * columns[0, i] + y * columns[1, i] + z * columns[2, i]
            if value > best:
                best, at = value, i
        indices[k] = at


def _crossings(a: Array, b: Array, axis: int, at: float) -> Array:
    """Where segments from ``a`` to ``b``, both (m, 3), meet a plane across an axis.

    Ends are taken in the same order whichever way an edge runs: neighbours agree to the last bit.
    """
    turned = (a[:, axis] > b[:, axis])[:, None]
    low, high = np.where(turned, b, a), np.where(turned, a, b)
    share = (at - low[:, axis]) / (high[:, axis] - low[:, axis])
    points = low + share[:, None] * (high - low)
    points[:, axis] = at
    return np.asarray(points)


def cut_triangles(
    triangles: Array, bodies: NDArray[np.int64], axis: int, at: float
) -> tuple[tuple[Array, NDArray[np.int64]], tuple[Array, NDArray[np.int64]]]:
    """Triangles and their bodies below a plane and above it; those that cross it are cut."""
    heights = triangles[:, :, axis] - at
    under, over = heights.max(axis=1) <= 0.0, heights.min(axis=1) >= 0.0
    below, above = [(triangles[under], bodies[under])], []
    above.append((triangles[over & ~under], bodies[over & ~under]))
    across = np.flatnonzero(~under & ~over)
    # The corner that is alone on its side comes first.
    signs = np.sign(heights[across])
    alone = np.where((signs > 0.0).sum(axis=1) == 1, (signs > 0.0).argmax(axis=1),
                     (signs < 0.0).argmax(axis=1))  # fmt: skip
    order = (alone[:, None] + np.arange(3)) % 3
    corners = np.take_along_axis(triangles[across], order[:, :, None], axis=1)
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, ac = _crossing_or_end(a, b, axis, at), _crossing_or_end(a, c, axis, at)
    lower = (a[:, axis] < at)[:, None, None]
    tips = np.stack([a, ab, ac], axis=1)
    for own, number in (
        (tips, 0),
        (np.stack([ab, b, c], axis=1), 1),
        (np.stack([ab, c, ac], axis=1), 1),
    ):
        is_low = lower[:, 0, 0] if number == 0 else ~lower[:, 0, 0]
        real = triangle_areas(own) > 0.0
        below.append((own[is_low & real], bodies[across][is_low & real]))
        above.append((own[~is_low & real], bodies[across][~is_low & real]))
    joined = [
        (np.concatenate([own for own, _ in side]), np.concatenate([name for _, name in side]))
        for side in (below, above)
    ]
    return joined[0], joined[1]


def _crossing_or_end(a: Array, b: Array, axis: int, at: float) -> Array:
    on = (b[:, axis] == at)[:, None]
    return np.where(on, b, _crossings(a, b, axis, at))
