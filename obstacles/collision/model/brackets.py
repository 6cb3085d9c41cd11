"""A robot's sphere brackets: outer ones that are clear are free, inner ones that meet collide.

Each convex piece has a ``SphereSet``; between the two radii the exact test decides (`verdict`).
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array, Indices
from kinematics.caches.bounded_cache import bounded_cache
from kinematics.caches.preparation_limit import check_preparation_time
from obstacles.convex.closest_point import hull_distances
from obstacles.convex.hull import convex_hull
from obstacles.convex.piece import Piece, PieceKind
from obstacles.convex.sphere_set import MOST, SphereSet, round_depths, sphere_set
from obstacles.robots.robot_geometry import RobotGeometry

#: What stands in which columns of a sphere: its centre in the frame of the joint that carries it,
#: the radii, and the sphere after all below it.
OUTER, INNER, AFTER = 3, 4, 5
#: Finest spheres of a robot's pieces together, a second's work, and of each of very many pieces.
_TOGETHER, _LEAST = 2400, 8
#: Points along each side of a link's box at which volumes are counted.
_ALONG = 24


class Tightness(NamedTuple):
    """How closely the finest spheres of a link bracket it.

    Args:
        link: Name of the link.
        pieces: How many convex pieces it has.
        spheres: How many outer spheres cover them, and as many lie inside.
        excess: Proved: no outer sphere reaches farther beyond its piece than this, and no point of
            a piece is farther from its inner spheres [m].
        outer_volume: Volume of all outer spheres together, the link's own volume being 1, counted
            on a grid of points; infinite for a link without volume.
        inner_volume: Volume of all inner spheres together, likewise.
    """

    link: str
    pieces: int
    spheres: int
    excess: float
    outer_volume: float
    inner_volume: float


@dataclass(frozen=True, slots=True, eq=False)
class Brackets:
    """The sphere sets of a robot's pieces.

    Args:
        robot: The robot.
        sets: Sphere sets of the pieces, in their order, each in the frame of the joint that carries
            it.
        spheres: Spheres of all pieces for the kernels, columns as named above, shape (s, 6).
        starts: The spheres of piece i are ``spheres[starts[i]:starts[i + 1]]``, shape (p + 1,).
    """

    robot: RobotGeometry
    sets: tuple[SphereSet, ...]
    spheres: Array = field(init=False, repr=False)
    starts: Indices = field(init=False, repr=False)

    def __post_init__(self) -> None:
        starts = np.cumsum([0, *(len(own.outer) for own in self.sets)])
        blocks = [np.zeros((0, 6))]
        for own, start in zip(self.sets, starts, strict=False):
            blocks.append(np.column_stack([own.centers, own.outer, own.inner, own.skips + start]))
        spheres = np.vstack(blocks)
        for name, values in (("spheres", spheres), ("starts", starts.astype(np.int64))):
            values.setflags(write=False)
            object.__setattr__(self, name, values)

    @classmethod
    def of(cls, robot: RobotGeometry) -> "Brackets":
        """The brackets of a robot, made once for each piece."""
        return brackets(robot)

    def tightness(self) -> tuple[Tightness, ...]:
        """How tight the brackets are, link by link."""
        return tuple(self._tightness(name) for name in self.robot.names)

    def _tightness(self, link: str) -> Tightness:
        own = [i for i, name in enumerate(self.robot.links) if name == link]
        sets = [self.sets[i] for i in own]
        balls = [(s.centers[s.finest], s.outer[s.finest], s.inner[s.finest]) for s in sets]
        centers, outer, inner = (np.concatenate(part) for part in zip(*balls, strict=True))
        points = _grid(centers, outer)
        solid = np.zeros(len(points), dtype=np.bool_)
        for i in own:
            solid |= _inside(self.robot.pieces[i], points)
        held = np.zeros((2, len(points)), dtype=np.bool_)
        for center, *radii in zip(centers, outer, inner, strict=True):
            away = np.linalg.norm(points - center, axis=1)
            held |= away <= np.array(radii)[:, None]
        count = int(solid.sum())
        volumes = (held.sum(axis=1) / count).tolist() if count else [np.inf, np.inf]
        return Tightness(link, len(own), len(outer), max(s.excess for s in sets), *volumes)


@bounded_cache(maxsize=64)
def brackets(robot: RobotGeometry) -> Brackets:
    """``Brackets.of``, kept by the robot's content."""
    return Brackets(robot, sphere_sets(robot))


def sphere_sets(robot: RobotGeometry) -> tuple[SphereSet, ...]:
    """The spheres of each of a robot's pieces."""
    most = max(min(MOST, _TOGETHER // max(len(robot.pieces), 1)), _LEAST)
    sets = []
    for piece in robot.pieces:
        check_preparation_time()
        sets.append(sphere_set(piece, most))
    return tuple(sets)


def _inside(piece: Piece, points: Array) -> NDArray[np.bool_]:
    """Whether points (m, 3), in the frame of what owns it, lie in a bounded piece, (m,)."""
    T = piece.T_owner_piece
    local = np.ascontiguousarray((points - T[:3, 3]) @ T[:3, :3])
    if piece.kind != PieceKind.POLYTOPE:
        cone = piece.kind == PieceKind.CONE
        depths = round_depths(cone, piece.radius, piece.half_height, local)
        return np.asarray(depths + piece.offset_radius >= 0.0)
    hull = convex_hull(piece.vertices)
    if hull.solid and piece.offset_radius == 0.0:
        highest = (local @ hull.planes[:, :3].T - hull.planes[:, 3]).max(axis=1)
        return np.asarray(highest <= 0.0)
    found = np.empty(len(local))
    hull_distances(local, hull.vertices, hull.triangles, hull.planes, hull.solid, found)
    return np.asarray(found <= piece.offset_radius)


def _grid(centers: Array, radii: Array) -> Array:
    """Points of a grid over the box of balls, shape (m, 3)."""
    low = (centers - radii[:, None]).min(axis=0)
    high = (centers + radii[:, None]).max(axis=0)
    at = (np.arange(_ALONG) + 0.5) / _ALONG
    sides = [a + at * (b - a) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3)
