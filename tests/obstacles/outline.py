"""Convex pieces by closed forms of their own: support functions and points that span them."""

import numpy as np

from kinematics.arrays import Array
from obstacles.convex.piece import Piece, PieceArrays, PieceKind
from obstacles.shapes.shape import Box, Capsule, Cone, Convex, Cylinder, Shape, Sphere
from tests.obstacles.solids import random_transform

_RIM = 720


def rim(piece: Piece) -> Array:
    """Points in the piece's frame whose hull is its core, circles by points on them, (k, 3)."""
    if piece.kind == PieceKind.POLYTOPE:
        return piece.vertices
    angles = np.linspace(0.0, 2.0 * np.pi, _RIM, endpoint=False)
    circle = piece.radius * np.column_stack([np.cos(angles), np.sin(angles)])
    low = np.column_stack([circle, np.full(_RIM, -piece.half_height)])
    if piece.kind == PieceKind.CONE:
        return np.vstack([low, [[0.0, 0.0, piece.half_height]]])
    return np.vstack([low, low * [1.0, 1.0, -1.0]])


def offset(piece: Piece) -> float:
    """Radius of the ball that is added to the core of a piece [m]."""
    return float(PieceArrays.pack([piece]).sizes[0, 2])


def owned(piece: Piece, points: Array) -> Array:
    """Points (k, 3) of the piece's frame in its owner's."""
    T = piece.T_owner_piece
    return np.asarray(points @ T[:3, :3].T + T[:3, 3])


def points_inside(piece: Piece, random: np.random.Generator, count: int = 300) -> Array:
    """Points of a piece in its owner's frame, some on its surface, shape (count, 3)."""
    outline = rim(piece)
    few = outline[random.integers(len(outline), size=(count, 4))]
    weights = random.dirichlet([0.3] * 4, count)[:, :, None]
    directions = random.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    around = offset(piece) * directions * random.choice([0.5, 1.0], (count, 1))
    return owned(piece, (few * weights).sum(axis=1) + around)


def convex_shapes(random: np.random.Generator) -> list[Shape]:
    """One of each convex shape, sizes from 5 cm to half a metre."""
    a, b = random.uniform(0.05, 0.5, 2)
    return [
        Box(random.uniform(0.05, 0.5, 3)),
        Sphere(a),
        Cylinder(a, b),
        Capsule(a, b),
        Cone(a, b),
        Convex(random.normal(size=(8, 3)) * a),
        Convex(random.normal(size=(40, 3)) * a),
    ]


def convex_pieces(random: np.random.Generator) -> list[Piece]:
    """The piece of one of each convex shape, anywhere."""
    return [
        piece.placed(random_transform(random, 0.5))
        for shape in convex_shapes(random)
        for piece in shape.pieces()
    ]
