"""Robots for tests of collisions: the built-in ones, and a gantry that carries one solid."""

from collections.abc import Mapping
from functools import cache

import numpy as np
import trimesh
from numpy.typing import NDArray

from kinematics.arrays import Array
from kinematics.model.chain import Chain, Limits, Link
from kinematics.pose import transform
from kinematics.robots import builtin_srdf, builtin_urdf
from kinematics.tree.serial_chain import serial_chain
from kinematics.tree.srdf import parse_srdf
from kinematics.urdf.urdf import parse_urdf
from obstacles.convex.piece import Piece, PieceKind
from obstacles.robots.robot_geometry import RobotGeometry, robot_geometry
from obstacles.scenes.scene import Obstacle
from obstacles.shapes.shape import Mesh, Shape

_GANTRY = """<robot name="gantry"><link name="base"/><link name="x"/><link name="y"/>
<link name="tool"><collision><geometry>{geometry}</geometry></collision></link>
{joints}</robot>"""
_SLIDE = """<joint name="j{axis}" type="prismatic"><parent link="{parent}"/><child link="{child}"/>
<axis xyz="{direction}"/><limit lower="-3" upper="3" velocity="1" effort="1"/></joint>"""
_SLIDES = (("x", "base", "x", "1 0 0"), ("y", "x", "y", "0 1 0"), ("z", "y", "tool", "0 0 1"))


@cache
def builtin(name: str) -> RobotGeometry:
    """A built-in robot with its solids."""
    description, semantics = parse_urdf(builtin_urdf(name)), parse_srdf(builtin_srdf(name))
    chain = serial_chain(description, semantics=semantics)
    return robot_geometry(chain, description, {}, semantics)


@cache
def cut_arm() -> RobotGeometry:
    """Three links and a base of many small pieces: more than 256 pairs of two bodies."""
    random, count, n = np.random.default_rng(3), 18, 3
    offsets = np.tile(np.eye(4), (n, 1, 1))
    offsets[1:, 0, 3] = 0.5
    offsets[1, :3, :3] = [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]
    names = ("base", "one", "two", "three")
    links = tuple(Link(name, k - 1, np.eye(4)) for k, name in enumerate(names))
    chain = Chain(
        "cut", tuple(f"joint_{k}" for k in range(n)), np.zeros(n, dtype=np.int64), offsets, links,
        "base", "three", Limits.unlimited(n), np.ones(n, dtype=np.bool_),
    )  # fmt: skip
    pieces = []
    for _ in names:
        for k in range(count):
            T = transform(None, [0.5 * k / count, *random.normal(0.0, 0.04, 2)])
            pieces.append(Piece(PieceKind.POLYTOPE, T, 0.015 * random.normal(size=(9, 3))))
    joints = np.repeat(np.arange(-1, n), count)
    allowed = {("base", "one"): "adjacent", ("one", "two"): "adjacent"}
    owners = tuple(names[joint + 1] for joint in joints)
    return RobotGeometry(chain, tuple(pieces), owners, joints, np.arange(len(joints)), allowed)


def gantry(geometry: str, meshes: Mapping[str, bytes] | None = None) -> RobotGeometry:
    """Three slides that carry one solid, which stands at q = (x, y, z) [m].

    Args:
        geometry: The solid as a geometry element of URDF.
        meshes: Mesh files by their URI.
    """
    joints = "".join(
        _SLIDE.format(axis=axis, parent=parent, child=child, direction=direction)
        for axis, parent, child, direction in _SLIDES
    )
    description = parse_urdf(_GANTRY.format(geometry=geometry, joints=joints))
    return robot_geometry(serial_chain(description), description, meshes or {})


def obstacle(name: str, shape: Shape, at: Array | list[float], margin: float = 0.0) -> Obstacle:
    """An obstacle that is not turned, at a position [m]."""
    return Obstacle(name, shape, transform(None, at), margin)


def off_file(mesh: trimesh.Trimesh) -> bytes:
    """A mesh as the bytes of an OFF file."""
    text = trimesh.exchange.off.export_off(mesh, digits=17)
    return str(text).encode()


def mesh_shape(mesh: trimesh.Trimesh) -> Mesh:
    """A mesh of trimesh as an obstacle's shape."""
    return Mesh(np.array(mesh.vertices), np.array(mesh.faces))


def cup(bottom: float = -0.2) -> trimesh.Trimesh:
    """A cup, open at the top: a block with a hole of 0.3 m from z = -0.15 up to its rim at 0.2 m.

    Args:
        bottom: Where the block of 0.4 m across begins [m].
    """
    outer, inner = 0.2, 0.15
    ring = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    levels = [(outer, bottom), (outer, 0.2), (inner, 0.2), (inner, -0.15)]
    corners = np.vstack([np.column_stack([side * ring, np.full(4, z)]) for side, z in levels])
    faces = [[2, 1, 0], [3, 2, 0]]
    for level in range(3):
        for k in range(4):
            a, b = 4 * level + k, 4 * level + (k + 1) % 4
            faces += [[a, b, b + 4], [a, b + 4, a + 4]]
    faces += [[12, 13, 14], [12, 14, 15]]
    mesh = trimesh.Trimesh(corners, np.array(faces), process=False)
    assert mesh.is_watertight
    assert mesh.volume > 0.0
    return mesh


def in_cup(points: Array, bottom: float = -0.2) -> NDArray[np.bool_]:
    """Which of points (m, 3) are inside the cup, shape (m,)."""
    across, z = np.abs(points[:, :2]).max(axis=1), points[:, 2]
    hollow = (across < 0.15) & (z > -0.15)
    return np.asarray((across < 0.2) & (z > bottom) & (z < 0.2) & ~hollow)
