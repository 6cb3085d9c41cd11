"""Random convex solids, as pieces and as the same solid in coal."""

from typing import Any

import coal
import numpy as np
from scipy.spatial import ConvexHull

from kinematics.arrays import Array
from kinematics.pose import from_axis_angle, transform
from obstacles.convex.piece import Piece, PieceKind

KINDS = ("box", "sphere", "capsule", "cylinder", "cone", "hull")
NO_VERTICES = np.zeros((0, 3))


def random_transform(random: np.random.Generator, spread: float = 1.0) -> Array:
    """A rotation of any angle and a normally distributed position."""
    rotation = from_axis_angle(random.normal(size=3), random.uniform(0.0, np.pi))
    return transform(rotation, random.normal(size=3) * spread)


def random_solid(random: np.random.Generator, kind: str, T: Array) -> tuple[Piece, Any]:
    """A solid of 2 cm to half a metre at T, and coal's own of the same measures."""
    size = random.uniform(0.02, 0.5, 3)
    if kind == "box":
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        return Piece(PieceKind.POLYTOPE, T, signs * size), coal.Box(*(2.0 * size))
    if kind == "sphere":
        ball = Piece(PieceKind.POLYTOPE, T, np.zeros((1, 3)), offset_radius=size[0])
        return ball, coal.Sphere(size[0])
    if kind == "capsule":
        ends = np.array([[0.0, 0.0, -size[1]], [0.0, 0.0, size[1]]])
        capsule = Piece(PieceKind.POLYTOPE, T, ends, offset_radius=size[0])
        return capsule, coal.Capsule(size[0], 2.0 * size[1])
    if kind == "cylinder":
        piece = Piece(PieceKind.CYLINDER, T, NO_VERTICES, size[0], size[1])
        return piece, coal.Cylinder(size[0], 2.0 * size[1])
    if kind == "cone":
        piece = Piece(PieceKind.CONE, T, NO_VERTICES, size[0], size[1])
        return piece, coal.Cone(size[0], 2.0 * size[1])
    points = random.normal(size=(60, 3))
    points *= size[0] / np.linalg.norm(points, axis=1, keepdims=True)
    return Piece(PieceKind.POLYTOPE, T, points), _coal_hull(points)


def _coal_hull(points: Array) -> Any:
    vertices, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for point in points:
        vertices.append(point)
    for face in ConvexHull(points).simplices:
        faces.append(coal.Triangle(*map(int, face)))
    return coal.Convex(vertices, faces)


def coal_distance(a: Any, T_a: Array, b: Any, T_b: Array) -> float:
    """Distance by coal, to about 1e-8 m; not positive where they overlap."""
    request = coal.DistanceRequest()
    request.gjk_tolerance = 1e-9
    places = [coal.Transform3s(T[:3, :3], T[:3, 3]) for T in (T_a, T_b)]
    return float(coal.distance(a, places[0], b, places[1], request, coal.DistanceResult()))
