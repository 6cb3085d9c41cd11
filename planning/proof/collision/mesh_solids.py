"""Solids that the triangles of a mesh bound, and which points lie in them, for the proof alone.

Triangles that share corners are one body. It is closed where its triangles, turned alike, have no
rim, small holes aside: cones over the rims are added to it, so that its winding number

    sum of 2 atan2(det(a, b, c), |a||b||c| + (a.b)|c| + (b.c)|a| + (c.a)|b|) / (4 pi)

is whole everywhere, and 0 outside of its box. Triangles that leave a rim wherever they end, as fins
and inner walls do, are left out of it where the others are closed without them. A closed body that
is turned unlike the solid it lies within is a cavity of it and counts against it.

Boxes over the pieces of each link, for robots that are cut into many.

A humanoid with hands has some five hundred pieces, and tens of thousands of pairs of them: nearly
all are settled at once where boxes about their links are.
"""

import math
from itertools import combinations
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from kinematics.caches.bounded_cache import bounded_cache
from obstacles.convex.piece import PieceArrays
from obstacles.robots.robot_geometry import RobotGeometry
from planning.proof.collision.elements import Elements, boxes_over

#: Pieces of a robot up to which each stands for itself: opening boxes would cost more.
_FEW = 64


@bounded_cache(maxsize=64)
def link_parts(robot: RobotGeometry) -> Indices:
    """Starts of the parts that own pairs are of, and the end of the last one, shape (l + 1,).

    A part is a piece, or all pieces of a link that follow each other.
    """
    p = len(robot.pieces)
    if p <= _FEW:
        return np.arange(p + 1)
    same = [
        (robot.links[k], robot.joints[k]) == (robot.links[k - 1], robot.joints[k - 1])
        for k in range(1, p)
    ]
    return np.array([0, *(k for k, as_before in enumerate(same, 1) if not as_before), p])


@bounded_cache(maxsize=64)
def part_pairs(robot: RobotGeometry) -> tuple[Indices, frozenset[tuple[str, str]]]:
    """Pairs of parts that must not touch, shape (k, 2), and names of their links, sorted.

    All that move against each other and that the robot does not allow to touch; chosen here as well
    as by the planner, on purpose. The second of a pair moves against the first.
    """
    allowed, first = {frozenset(pair) for pair in robot.allowed}, link_parts(robot)[:-1]
    joints, links = robot.joints[first].tolist(), [robot.links[k] for k in first]
    pairs = [
        (a, b) if joints[a] <= joints[b] else (b, a)
        for a, b in combinations(range(len(first)), 2)
        if joints[a] != joints[b] and frozenset((links[a], links[b])) not in allowed
    ]
    names = ((links[a], links[b]) for a, b in pairs)
    rows = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    return rows, frozenset((min(pair), max(pair)) for pair in names)


def with_link_boxes(robot: RobotGeometry, own: Elements) -> tuple[Elements, Indices]:
    """A robot's elements with trees of boxes over its parts behind them, and the tops of the parts.

    Args:
        robot: The robot.
        own: Elements of the robot, pieces first.

    Returns:
        The elements, and the one that holds all of each part, shape (l,).
    """
    starts = link_parts(robot)
    tops, blocks, base = starts[:-1].copy(), [own], len(own.kinds)
    for part, (begin, end) in enumerate(
        zip(starts[:-1].tolist(), starts[1:].tolist(), strict=True)
    ):
        if end - begin == 1:
            continue
        pieces = PieceArrays.pack(robot.pieces[begin:end])
        grown = boxes_over(pieces, np.zeros(end - begin), begin, base)
        count = len(grown.kinds)
        blocks.append(
            grown._replace(
                joints=np.full(count, robot.joints[begin]),
                parts=np.full(count, begin),
                row=np.full(count, -1),
            )
        )
        tops[part], base = base, base + count
    return _behind_each_other(blocks), tops


def _behind_each_other(blocks: list[Elements]) -> Elements:
    """Elements one behind the other, of which all but the first have no corners."""
    if len(blocks) == 1:
        return blocks[0]
    joined = {
        name: np.concatenate([getattr(block, name) for block in blocks])
        for name in Elements._fields
    }
    below = [blocks[0].below]
    for block in blocks[1:]:
        below.append(block.below[1:] + below[-1][-1])
    own = blocks[0]
    joined["below"] = np.concatenate(below)
    joined["starts"] = np.append(
        own.starts, np.full(len(joined["kinds"]) - len(own.kinds), own.starts[-1])
    )
    return Elements(**joined)


#: Corners nearer to each other than this part of the diagonal are one.
_ONE_PLACE = 1e-6
#: Part of a body's area that cones over its rims may have.
_SMALL_HOLES = 0.03
#: Where cones have more, though less than the body, they may cancel each other, as over cracks they
#: do: points in its box, at so many of which they must wind so little around it.
_POINTS, _MOST, _LITTLE = 128, 0.95, 0.05
#: Powers of the root of x^4 = x + 1: multiples of these, less whole numbers, fill a box evenly.
_STEPS = 0.8191725133961645 ** np.arange(1, 4)
#: Volume, as a part of the area to the power of 3/2, below which a body is flat.
_NO_VOLUME = 1e-12
#: Winding number beyond which a point is inside.
_INSIDE = 0.5
#: Points that are compared with boxes at once.
_COMPARED = 1_000_000
#: Corners of a body that tell whether it lies within another one.
_CORNERS = 256


class MeshSolids(NamedTuple):
    """Solid of a mesh (b bodies, c of them closed).

    Args:
        points: A corner of each body, shape (b, 3) [m].
        triangles: Triangles of the closed bodies, solids turned outward, cavities inward, each
            body's one behind the other, shape (t, 3, 3) [m].
        starts: First triangle of closed body k is ``starts[k]``, shape (c + 1,).
        low: Lowest corner of a box about each closed body, shape (c, 3) [m].
        high: Highest corner, shape (c, 3) [m].
        opened: How many bodies bound nothing.
    """

    points: Array
    triangles: Array
    starts: Indices
    low: Array
    high: Array
    opened: int

    def hold(self, points: Array) -> NDArray[np.bool_]:
        """Whether ``points`` (m, 3) lie inside, shape (m,)."""
        numbers = np.zeros(len(points))
        at_once = _COMPARED // max(len(self.low), 1) + 1
        for begin in range(0, len(points), at_once):
            block = points[begin : begin + at_once]
            near = np.ones((len(block), len(self.low)), dtype=np.bool_)
            for axis in range(3):
                x = block[:, axis, None]
                near &= (x >= self.low[:, axis]) & (x <= self.high[:, axis])
            for k in np.flatnonzero(near.any(axis=0)):
                own = begin + np.flatnonzero(near[:, k])
                of_body = self.triangles[self.starts[k] : self.starts[k + 1]]
                numbers[own] += _windings(np.ascontiguousarray(points[own]), of_body)
        return np.asarray(np.abs(numbers) > _INSIDE)


class _Mesh(NamedTuple):
    """Triangles with the numbers of their corners, alike in one place, and of their bodies.

    Args:
        triangles: Shape (f, 3, 3) [m].
        corners: Shape (f, 3).
        body: Shape (f,).
    """

    triangles: Array
    corners: Indices
    body: Indices


class _Shell(NamedTuple):
    """Triangles that may close their bodies.

    Args:
        rows: Numbers of the triangles, shape (s,).
        signs: -1 for those that are turned round, shape (s,).
    """

    rows: Indices
    signs: Array


def mesh_solids(triangles: Array) -> MeshSolids:
    """The solids of a mesh.

    Args:
        triangles: Corners of each, shape (f, 3, 3) [m].
    """
    corners = _corner_numbers(triangles.reshape(-1, 3)).reshape(-1, 3)
    body = _component_numbers(np.vstack([corners[:, :2], corners[:, 1:]]), int(corners.max()) + 1)
    _, first, body = np.unique(body[corners[:, 0]], return_index=True, return_inverse=True)
    count, body = len(first), body.reshape(-1)
    real = np.flatnonzero((corners != np.roll(corners, 1, axis=1)).all(axis=1))
    mesh, left = _Mesh(triangles, corners, body), np.ones(count, dtype=np.bool_)
    opened, bodies = 0, list[Array]()
    # As written, where two bodies may share a wall; then each triangle once; then without fins.
    for step in (None, _turned_alike, _without_fins):
        rows = real[left[body[real]]]
        shell = step(mesh, rows) if step else _Shell(rows, np.ones(len(rows)))
        faces = _turned(triangles[shell.rows], shell.signs)
        cones, owner = _cones(mesh, shell)
        shut = left & _is_closed(faces, body[shell.rows], cones, body[owner], count)
        if step is None:
            shut[body[owner]] = False
        parts = np.concatenate([faces, cones])
        own = np.concatenate([body[shell.rows], body[owner]])
        order = np.flatnonzero(shut[own])
        order = order[np.argsort(own[order], kind="stable")]
        cuts = np.flatnonzero(np.diff(own[order])) + 1
        bodies += np.split(parts[order], cuts) if len(order) else []
        opened += int(shut.sum()) if step is _without_fins else 0
        left &= ~shut
    return _packed(triangles[first, 0], _with_cavities(bodies), opened + int(left.sum()))


def _packed(points: Array, bodies: list[Array], opened: int) -> MeshSolids:
    counts, room = [len(own) for own in bodies], np.zeros((0, 3))
    return MeshSolids(
        points,
        np.concatenate([np.zeros((0, 3, 3)), *bodies]),
        np.cumsum([0, *counts]),
        np.vstack([room, *(own.min(axis=(0, 1)) for own in bodies)]),
        np.vstack([room, *(own.max(axis=(0, 1)) for own in bodies)]),
        opened,
    )


def _corner_numbers(points: Array) -> Indices:
    """Numbers of corners, (k,), alike for those that are in one place."""
    places, number = np.unique(points, axis=0, return_inverse=True)
    reach = _ONE_PLACE * float(np.linalg.norm(np.ptp(places, axis=0)))
    near = scipy.spatial.cKDTree(places).query_pairs(reach, output_type="ndarray")
    return _component_numbers(near, len(places))[number.reshape(-1)]


def _component_numbers(links: Indices, size: int) -> Indices:
    """Number of the connected part of each of ``size`` nodes, by the links (k, 2) between them."""
    ones = np.ones(len(links), dtype=np.int8)
    graph = scipy.sparse.coo_array((ones, (links[:, 0], links[:, 1])), shape=(size, size))
    return np.asarray(
        scipy.sparse.csgraph.connected_components(graph, directed=False)[1], dtype=np.int64
    )


def _sides(corners: Indices) -> tuple[Indices, Array, Indices]:
    """Edges by their lower and higher corner, (e, 2), the edge of each side, and whether up."""
    sides = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2)
    size = int(corners.max(initial=0)) + 1
    keys, of = np.unique(sides.min(axis=1) * size + sides.max(axis=1), return_inverse=True)
    up = np.where(sides[:, 0] < sides[:, 1], 1.0, -1.0)
    return np.column_stack(np.divmod(keys, size)), up, of.reshape(-1)


def _turned_alike(mesh: _Mesh, rows: Indices) -> _Shell:
    """Each triangle once, all turned as most of those are that hang together by edges of two.

    Every triangle stands for two nodes, itself and itself turned round; across an edge of two the
    nodes that run against each other are linked, so that a component is a surface turned alike.
    """
    low, middle, high = np.sort(mesh.corners[rows], axis=1).T
    size = int(mesh.corners.max(initial=0)) + 1
    # Meshes have less than 2**20 corners.
    single = np.unique((low * size + middle) * size + high, return_index=True)[1]
    rows = rows[np.sort(single)]
    _, up, of = _sides(mesh.corners[rows])
    f = len(rows)
    order = np.argsort(of, kind="stable")
    twice = order[np.bincount(of)[of[order]] == 2].reshape(-1, 2)
    a, b = twice[:, 0] // 3, twice[:, 1] // 3
    turn = np.where(up[twice[:, 0]] == up[twice[:, 1]], f, 0)
    links = np.vstack([np.column_stack([a, b + turn]), np.column_stack([a + f, b + f - turn])])
    part = _component_numbers(links, 2 * f)
    as_is, round_ = part[:f], part[f:]
    # A surface and the same turned round: the one in which more triangles are as they are.
    votes = np.bincount(as_is, minlength=int(part.max(initial=-1)) + 1)
    keep = (votes[as_is] > votes[round_]) | ((votes[as_is] == votes[round_]) & (as_is <= round_))
    return _Shell(rows, np.where(keep, 1.0, -1.0))


def _without_fins(mesh: _Mesh, rows: Indices) -> _Shell:
    """Bodies without surfaces that end at an odd edge, small ones taken off first.

    Surfaces end where three triangles or more meet. Those that have an edge to themselves go first.
    """
    rows = _turned_alike(mesh, rows).rows
    _, _, of = _sides(mesh.corners[rows])
    order = np.argsort(of, kind="stable")
    twice = order[np.bincount(of)[of[order]] == 2].reshape(-1, 2) // 3
    surface = _component_numbers(twice, len(rows))
    area = np.bincount(surface, _areas(mesh.triangles[rows]))
    of_body = np.zeros(len(area), dtype=np.int64)
    of_body[surface] = mesh.body[rows]
    there = np.ones(len(rows), dtype=np.bool_)
    while there.any():
        use = np.bincount(of, np.repeat(there, 3))[of].reshape(-1, 3)
        odd = np.unique(surface[there & (use % 2 == 1).any(axis=1)])
        free = np.unique(surface[there & (use == 1).any(axis=1)])
        if not len(odd):
            break
        odd = odd[np.lexsort([area[odd], of_body[odd]])]
        smallest = odd[np.unique(of_body[odd], return_index=True)[1]]
        there &= ~np.isin(surface, free if len(free) else smallest)
    return _turned_alike(mesh, rows[there])


def _turned(triangles: Array, signs: Array | Indices) -> Array:
    return np.where(signs[:, None, None] > 0, triangles, triangles[:, ::-1])


def _cones(mesh: _Mesh, shell: _Shell) -> tuple[Array, Indices]:
    """Triangles (k, 3, 3) that close the rims of a shell, and a triangle of the body of each."""
    edges, up, of = _sides(mesh.corners[shell.rows])
    net = np.bincount(of, up * np.repeat(shell.signs, 3), len(edges))
    rim = np.flatnonzero(np.abs(net) > 0.5)
    if not len(rim):
        return np.zeros((0, 3, 3)), np.zeros(0, dtype=np.int64)
    places = np.zeros((int(mesh.corners.max()) + 1, 3))
    places[mesh.corners] = mesh.triangles
    loop = _component_numbers(edges[rim], len(places))[edges[rim, 0]]
    begin, end = places[edges[rim, 1]], places[edges[rim, 0]]
    weight = np.bincount(loop)[loop]
    apex = [np.bincount(loop, 0.5 * (begin + end)[:, k])[loop] / weight for k in range(3)]
    cones = _turned(np.stack([np.column_stack(apex), begin, end], axis=1), net[rim])
    owner = np.zeros(len(edges), dtype=np.int64)
    owner[of] = np.repeat(shell.rows, 3)
    times = np.abs(np.rint(net[rim])).astype(np.int64)
    return np.repeat(cones, times, axis=0), np.repeat(owner[rim], times)


def _areas(triangles: Array) -> Array:
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    return np.asarray(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))


def _is_closed(
    faces: Array, of_face: Indices, cones: Array, of_cone: Indices, count: int
) -> NDArray[np.bool_]:
    """Whether bodies have a volume and cones that are small beside their faces, shape (count,)."""
    area = np.bincount(of_face, _areas(faces), count)
    covers = np.bincount(of_cone, _areas(cones), count)
    about = np.zeros((count, 3))
    about[of_face] = faces[:, 0]
    a, b, c = ((faces - about[of_face, None])[:, k] for k in range(3))
    volume = np.bincount(of_face, np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0, count)
    is_solid = np.abs(volume) > _NO_VOLUME * area**1.5
    closed = is_solid & (covers <= _SMALL_HOLES * area)
    for k in np.flatnonzero(is_solid & ~closed & (covers < area)):
        own, lid = faces[of_face == k], np.ascontiguousarray(cones[of_cone == k])
        low, high = own.min(axis=(0, 1)), own.max(axis=(0, 1))
        places = np.outer(np.arange(1, _POINTS + 1), _STEPS) % 1.0
        turns = _windings(low + places * (high - low), lid)
        closed[k] = (np.abs(turns) <= _LITTLE).mean() >= _MOST
    return np.asarray(closed)


def _volume(body: Array) -> float:
    a, b, c = ((body - body[0, 0])[:, k] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def _with_cavities(bodies: list[Array]) -> list[Array]:
    """Closed bodies turned outward, and inward where they are cavities of others."""
    signs = np.array([np.sign(_volume(body)) for body in bodies])
    hollow = np.zeros(len(bodies), dtype=np.bool_)
    if len(np.unique(signs)) > 1:
        low = np.array([body.min(axis=(0, 1)) for body in bodies])
        high = np.array([body.max(axis=(0, 1)) for body in bodies])
        size = np.linalg.norm(high - low, axis=1)
        for k in np.argsort(-size, kind="stable"):
            holds = (low <= low[k]).all(axis=1) & (high >= high[k]).all(axis=1) & (size > size[k])
            for outer in sorted(np.flatnonzero(holds), key=lambda n: size[n]):
                points = bodies[k].reshape(-1, 3)
                points = np.ascontiguousarray(points[:: len(points) // _CORNERS + 1])
                if (np.abs(_windings(points, bodies[outer])) > _INSIDE).all():
                    hollow[k] = signs[k] != signs[outer] and not hollow[outer]
                    break
    wanted = np.where(hollow, -1.0, 1.0)
    return [
        np.ascontiguousarray(body if sign == good else body[:, ::-1])
        for body, sign, good in zip(bodies, signs, wanted, strict=True)
    ]


@kernel
def _windings(points: Array, triangles: Array) -> Array:
    """How often triangles (t, 3, 3) wind around each of points (m, 3), shape (m,)."""
    numbers = np.zeros(points.shape[0])
    for m in range(points.shape[0]):
        for t in range(triangles.shape[0]):
            ax, ay = triangles[t, 0, 0] - points[m, 0], triangles[t, 0, 1] - points[m, 1]
            az = triangles[t, 0, 2] - points[m, 2]
            bx, by = triangles[t, 1, 0] - points[m, 0], triangles[t, 1, 1] - points[m, 1]
            bz = triangles[t, 1, 2] - points[m, 2]
            cx, cy = triangles[t, 2, 0] - points[m, 0], triangles[t, 2, 1] - points[m, 1]
            cz = triangles[t, 2, 2] - points[m, 2]
            a, b = math.sqrt(ax * ax + ay * ay + az * az), math.sqrt(bx * bx + by * by + bz * bz)
            c = math.sqrt(cx * cx + cy * cy + cz * cz)
            det = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
            ab, bc = ax * bx + ay * by + az * bz, bx * cx + by * cy + bz * cz
            ca = cx * ax + cy * ay + cz * az
            numbers[m] += math.atan2(det, a * b * c + ab * c + bc * a + ca * b)
        numbers[m] /= 2.0 * math.pi
    return numbers
