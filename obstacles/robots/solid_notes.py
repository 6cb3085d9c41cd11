"""Notes on the solids of a robot's links, a sentence for each that is odd."""

from collections.abc import Iterable

import numpy as np

from kinematics.arrays import Array
from kinematics.model.chain import Link
from kinematics.tree.description import CollisionElement, MeshGeometry
from obstacles.convex.hull import convex_hull
from obstacles.convex.piece import Piece

#: No link that a joint moves is that long; one in millimetres is, from a centimetre on [m].
_LONG = 10.0


def solid_notes(link: Link, element: CollisionElement, pieces: list[Piece]) -> list[str]:
    """Tell a mesh that is empty, open or cut, and a solid that may be in millimetres.

    Args:
        link: The link.
        element: One of its solids.
        pieces: The convex pieces that make it up.
    """
    geometry = element.geometry
    if isinstance(geometry, MeshGeometry) and not pieces:
        name = f"mesh {geometry.uri!r} of link {link.name!r}"
        return [f"{name} is the header of an STL file without a triangle: it is left out"]
    notes = _length_note(link, element, pieces) if pieces and link.joint >= 0 else []
    count = sum(len(piece.surface.triangles) for piece in pieces if piece.surface is not None)
    if isinstance(geometry, MeshGeometry) and (len(pieces) > 1 or count):
        what = f"link {link.name!r}: mesh {geometry.uri!r} is not convex"
        told = f", where they touch {count} triangles decide" if count else ""
        notes.append(f"{what}: {len(pieces)} convex pieces make it up{told}")
    if isinstance(geometry, MeshGeometry) and any(map(_is_open, pieces)):
        what = f"link {link.name!r}: mesh {geometry.uri!r} is open"
        notes.append(f"{what}: what lies inside of it without touching it is not seen there")
    return notes


def _is_open(piece: Piece) -> bool:
    """Whether a piece is of a body of a mesh that bounds no solid."""
    if piece.surface is not None:
        return piece.surface.count == 0
    return not convex_hull(piece.vertices).solid


def _length_note(link: Link, element: CollisionElement, pieces: Iterable[Piece]) -> list[str]:
    corners = np.vstack([_corners(piece) for piece in pieces])
    length = float(np.max(np.ptp(corners, axis=0)))
    if length < _LONG:
        return []
    geometry = element.geometry
    if isinstance(geometry, MeshGeometry):
        what, cure = f"mesh {geometry.uri!r}", 'it needs scale="0.001 0.001 0.001"'
    else:
        what, cure = "solid", "URDF has metres"
    return [
        f"link {link.name!r}: its {what} is {length:.4g} m long: if that is in millimetres, {cure}"
    ]


def _corners(piece: Piece) -> Array:
    """Points that a piece extends to along the axes of what owns it, shape (k, 3) [m]."""
    R, center = piece.T_owner_piece[:3, :3], piece.T_owner_piece[:3, 3]
    points = piece.vertices @ R.T if len(piece.vertices) else np.zeros((1, 3))
    z = R[:, 2]
    # A disc of a radius about z extends along an axis by the radius times the sine of their angle.
    reach = piece.half_height * np.abs(z) + piece.radius * np.sqrt(np.maximum(0.0, 1.0 - z * z))
    reach += piece.offset_radius
    return center + np.vstack([points - reach, points + reach])
