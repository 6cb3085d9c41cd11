"""Solids of robots that come as Denavit-Hartenberg tables: given shapes, and capsules along links.

A row moves its frame along the joint's axis z by d and along the common normal x by a (standard
rows in this order, modified rows in the other). Both segments are the link's kinematic skeleton;
a capsule about each of them covers it. A revolute joint carries the segment along its own axis. A
prismatic joint changes its length, d + q: a capsule on the link before it covers what is always
there, and one on its own link, as long as the stroke, covers the rest.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidRobotDescription, InvalidScene
from kinematics.model.chain import Chain, Link
from kinematics.model.dh import Convention, DhRow, DhTable, chain_from_dh
from kinematics.pose import align_z, rotation_x, rotation_y, transform
from obstacles.convex.piece import Piece
from obstacles.robots.robot_geometry import RobotGeometry, geometry_of_solids
from obstacles.shapes.shape import Capsule, HalfSpace, Shape

#: Segments shorter than this are no part of a skeleton [m].
_SHORTEST = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class LinkSolid:
    """A shape that a link carries.

    Args:
        shape: The shape.
        T_link_solid: Pose in the link's frame, which is frame i of row i, shape (4, 4).
    """

    shape: Shape
    T_link_solid: Array = field(default_factory=lambda: np.eye(4))

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_link_solid", frozen(self.T_link_solid))


def dh_robot_geometry(
    name: str,
    table: DhTable,
    solids: Sequence[Sequence[LinkSolid]] = (),
    capsule_radius: float | None = None,
) -> RobotGeometry:
    """The robot of a table with its solids.

    Pairs of links next to each other may touch, and those that touch in every configuration.

    Args:
        name: The robot's name.
        table: Table of the robot, with n rows.
        solids: Solids of each row's link, n of them; empty for nothing.
        capsule_radius: Radius of capsules along the links [m]; None for none.

    Raises:
        InvalidRobotDescription: The table is not valid, ``solids`` has another number of rows, a
            link can't carry a shape, the radius is not valid, or a prismatic joint that needs a
            capsule has no limits. The message names the row.
    """
    chain = chain_from_dh(name, table)
    links = [chain.link(f"link_{i}") for i in range(1, chain.n + 1)]
    if len(solids) not in (0, chain.n):
        raise InvalidRobotDescription(
            f"geometry is given for {len(solids)} rows, the DH table has {chain.n}",
            hint="Give one list of solids for each row, an empty one for a link without any.",
        )
    parts = [
        (link, _pieces(link, solid, f"row {i} of the DH table, geometry {k}"))
        for i, (link, row) in enumerate(zip(links, solids, strict=False), start=1)
        for k, solid in enumerate(row, start=1)
    ]
    if capsule_radius is not None:
        parts += _capsules(chain, table, links, capsule_radius)
    names = [chain.links[0].name, *(link.name for link in links)]
    parents = dict(zip(names[1:], names[:-1], strict=True))
    # In the order of the links, as the pieces of other robots are.
    order = {link: i for i, link in enumerate(names)}
    return geometry_of_solids(chain, sorted(parts, key=lambda part: order[part[0].name]), parents)


def _pieces(link: Link, solid: LinkSolid, where: str) -> list[Piece]:
    if isinstance(solid.shape, HalfSpace):
        raise InvalidRobotDescription(
            f"{where}: a half-space can't be part of a link", hint="Give a shape of finite size."
        )
    T = link.T_joint_link @ solid.T_link_solid
    return [piece.placed(T) for piece in solid.shape.pieces()]


def _capsules(
    chain: Chain, table: DhTable, links: Sequence[Link], radius: float
) -> list[tuple[Link, list[Piece]]]:
    """Capsules about both segments of every row."""
    try:
        Capsule(radius, 1.0)
    except InvalidScene as error:
        raise InvalidRobotDescription(
            f"geometry.capsules of the DH table: {error.message}", hint=error.hint
        ) from None
    base = chain.links[0]
    solids: list[tuple[Link, list[Piece]]] = []
    for i, row in enumerate(table.rows):
        before, T_before = (links[i - 1], np.eye(4)) if i else (base, table.base)
        where = f"row {i + 1} of the DH table"
        for segment in _segments(row, table.convention, where):
            carrier, T = (links[i], np.eye(4)) if segment.is_behind else (before, T_before)
            T_segment = T @ segment.T_link_segment
            capsule = _capsule(T_segment, segment.start, segment.end, radius, where)
            if capsule is not None:
                solids.append((carrier, _pieces(carrier, capsule, where)))
    return solids


class _Segment(NamedTuple):
    """Part of the skeleton of a row.

    Args:
        is_behind: Whether the joint moves it; the link before the joint carries it otherwise.
        T_link_segment: The frame of its ends in that link's frame, shape (4, 4).
        start: One end, shape (3,) [m].
        end: The other, shape (3,) [m].
    """

    is_behind: bool
    T_link_segment: Array
    start: Array
    end: Array


def _segments(row: DhRow, convention: Convention, where: str) -> list[_Segment]:
    """The segments of a row along a and along d."""
    R = rotation_x(row.alpha) @ rotation_y(row.beta)
    normal, zero = np.array([row.a, 0.0, 0.0]), np.zeros(3)
    if convention == "standard":
        # The joint's axis is z of frame i - 1; behind it come a and the turn to frame i.
        before, axis, behind = np.eye(4), R.T[:, 2], R.T @ -normal
        along = _Segment(True, np.eye(4), behind, zero)
    else:
        before, axis, behind = transform(R, normal), np.array([0.0, 0.0, 1.0]), zero
        along = _Segment(False, np.eye(4), zero, normal)
    if row.type == "revolute":
        return [along, _Segment(True, np.eye(4), behind - row.d * axis, behind)]
    lower, upper = row.lower, row.upper
    if lower is None or upper is None or not np.isfinite([lower, upper]).all():
        raise InvalidRobotDescription(
            f"{where}: a prismatic joint without lower and upper can't get a capsule",
            hint="Give both limits, or the link's solids as shapes.",
        )
    shortest, longest = row.d + lower, row.d + upper
    always = min(max(0.0, shortest), longest)
    return [
        along,
        _Segment(False, before, zero, np.array([0.0, 0.0, always])),
        _Segment(
            True,
            np.eye(4),
            behind + (always - longest) * axis,
            behind + (always - shortest) * axis,
        ),
    ]


def _capsule(T: Array, start: Array, end: Array, radius: float, where: str) -> LinkSolid | None:
    """A capsule about a segment given in a frame T (4, 4) of a link; None about a point."""
    length = float(np.linalg.norm(end - start))
    if length < _SHORTEST:
        return None
    try:
        shape = Capsule(radius, length)
    except InvalidScene as error:
        raise InvalidRobotDescription(f"{where}: {error.message}", hint=error.hint) from None
    return LinkSolid(shape, T @ transform(align_z(end - start), 0.5 * (start + end)))
