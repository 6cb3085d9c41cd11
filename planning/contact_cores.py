"""Cores of obstacles that may be touched, but only so deep: what planners keep out of.

Planners do not look at pairs that may touch. Where the proof finds a motion deeper in an obstacle
than it may be, they plan again with the obstacle's core beside it, smaller all around by the depth
allowed: whoever overlaps two convex solids by no more than that stays clear of the core. So no path
is lost that could be proved; whether one can is still for the proof to say.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import scipy

from kinematics.arrays import Array
from obstacles.convex.piece import Piece, PieceKind, convex_hull
from obstacles.robots.allowed_pairs import allowed_pairs
from obstacles.robots.robot_geometry import sorted_pair
from obstacles.scenes.scene import AllowedContact, Obstacle
from obstacles.shapes.shape import Box, Capsule, Convex, Cylinder, HalfSpace, Shape, Sphere
from planning.problem import Problem

#: A core is this much smaller than it need be [m]: a contact as deep as allowed is not in it.
_ROOM = 1e-5


def with_cores(problem: Problem) -> Problem | None:
    """The problem with cores of the obstacles that are touched, each for one partner alone.

    Only pairs with obstacles have any: others, and what is thinner than the depth allowed, are left
    to the proof.

    Args:
        problem: What is to be planned.

    Returns:
        None where there is no core.
    """
    robot, scene = problem.robot, problem.scene
    cores, contacts = list[Obstacle](), dict(scene.contacts)
    for item in allowed_pairs(robot, scene):
        names = [name for name in item.pair if name in scene.ids]
        if not (item.limited and names):
            continue
        partner = next(name for name in item.pair if name != names[0])
        depth = item.touch_depth + problem.margin + _ROOM
        for core in _cores(scene.obstacle(names[0]), depth, partner):
            cores.append(core)
            others = (name for name in robot.names if name != partner)
            contacts |= {sorted_pair(name, core.id): AllowedContact() for name in others}
    if not cores:
        return None
    around = replace(scene, obstacles=(*scene.obstacles, *cores), contacts=contacts)
    return replace(problem, scene=around)


def _cores(obstacle: Obstacle, depth: float, partner: str) -> Iterator[Obstacle]:
    """Obstacles that are smaller than one all around by a depth [m], none where it is too thin."""
    shrunk = _shrunk(obstacle.shape, depth)
    shapes = [(shrunk, obstacle.T_world_obstacle)] if shrunk is not None else []
    if shrunk is None:
        for piece in obstacle.pieces():
            corners = _inner_corners(piece, depth)
            if corners is not None:
                shapes.append((Convex(corners), piece.T_owner_piece))
    for k, (shape, T) in enumerate(shapes):
        yield Obstacle(f"{obstacle.id}, core {k} for {partner}"[:256], shape, T)


def _shrunk(shape: Shape, depth: float) -> Shape | None:
    """A simple shape that is smaller all around; None of others, and where nothing is left."""
    match shape:
        case Box() if (shape.size > 2.0 * depth).all():
            return Box(shape.size - 2.0 * depth)
        case Sphere() if shape.radius > depth:
            return Sphere(shape.radius - depth)
        case Cylinder() if min(shape.radius, 0.5 * shape.height) > depth:
            return Cylinder(shape.radius - depth, shape.height - 2.0 * depth)
        case Capsule() if shape.radius > depth:
            return Capsule(shape.radius - depth, shape.height)
        case HalfSpace():
            return HalfSpace(shape.normal, shape.offset - depth)
    return None


def _inner_corners(piece: Piece, depth: float) -> Array | None:
    """Corners of what lies deeper than a depth [m] in a polytope, (k, 3); None where nothing does.

    The farthest point from all faces, by a linear program, tells the faces' intersection where to
    begin.
    """
    if piece.kind != PieceKind.POLYTOPE:
        return None
    planes = convex_hull(piece.vertices).planes
    normals, offsets = planes[:, :3], planes[:, 3] - max(depth - piece.offset_radius, 0.0)
    rows = np.column_stack([normals, np.ones(len(normals))])
    found = scipy.optimize.linprog(
        [0.0, 0.0, 0.0, -1.0], rows, offsets, bounds=[(None, None)] * 3 + [(0.0, None)]
    )
    if found.x is None or found.x[3] <= _ROOM:
        return None
    try:
        inner = scipy.spatial.HalfspaceIntersection(
            np.column_stack([normals, -offsets]), found.x[:3]
        )
    except scipy.spatial.QhullError:
        return None
    return np.unique(inner.intersections.round(12), axis=0)
