"""URDF of robots that came as Denavit-Hartenberg tables."""

import numpy as np

from kinematics.pose import align_z, inverse, transform
from kinematics.tree.description import (
    CapsuleGeometry,
    CollisionElement,
    CylinderGeometry,
    SphereGeometry,
)
from kinematics.urdf.writer import urdf_text
from obstacles.convex.piece import Piece, PieceKind
from obstacles.robots.robot_geometry import RobotGeometry


def table_urdf(robot: RobotGeometry) -> str:
    """The URDF of a robot that came as a table.

    Spheres, capsules and cylinders are written; comments name the links whose other solids are
    not, since URDF has only meshes for them.

    Args:
        robot: The robot with its solids.
    """
    solids: dict[str, list[CollisionElement]] = {}
    notes = []
    for piece, name in zip(robot.pieces, robot.links, strict=True):
        element = _element(piece)
        if element is None:
            notes.append(f"a solid of {name} is left out: it is no sphere, capsule or cylinder")
            continue
        T = inverse(robot.chain.link(name).T_joint_link) @ element.T_link_element
        solids.setdefault(name, []).append(CollisionElement(T, element.geometry))
    return urdf_text(robot.chain, solids, notes)


def _element(piece: Piece) -> CollisionElement | None:
    """A piece as URDF has it, in its owner's frame; None where URDF has no such shape."""
    T, corners = piece.T_owner_piece, piece.vertices
    if piece.kind == PieceKind.CYLINDER and piece.offset_radius == 0.0:
        return CollisionElement(T, CylinderGeometry(piece.radius, 2.0 * piece.half_height))
    if piece.kind != PieceKind.POLYTOPE or piece.offset_radius <= 0.0 or len(corners) > 2:
        return None
    center = transform(position=corners.mean(axis=0))
    if len(corners) == 1:
        return CollisionElement(T @ center, SphereGeometry(piece.offset_radius))
    axis = corners[1] - corners[0]
    shape = CapsuleGeometry(piece.offset_radius, float(np.linalg.norm(axis)))
    return CollisionElement(T @ center @ transform(align_z(axis)), shape)
