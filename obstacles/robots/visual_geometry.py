"""Visual geometry of a robot: how its links look, as triangles, for display only.

The built-in arms have looks of a table: each solid is the hull of discs with rounded rims, as a
turned or moulded shell is. No proof and no plan reads them; they are no part of a robot's hash.
"""

import itertools
from collections.abc import Callable, Iterable
from functools import cache, partial
from importlib.resources import files
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import ArmwrightError, InvalidScene
from kinematics.model.chain import Chain
from kinematics.model.robot_names import builtin_names
from kinematics.robots import builtin_chain
from kinematics.tree.description import Geometry, MeshGeometry
from kinematics.urdf.visuals import Color, UrdfVisuals, VisualElement
from obstacles.convex.piece import convex_hull
from obstacles.convex.triangles import Triangles, join, piece_triangles
from obstacles.meshes.mesh import load_painted, scaled
from obstacles.robots.robot_geometry import plain_shape

#: Triangles of a whole robot: with their corners about 3 MB.
MAX_TRIANGLES = 120_000
#: Triangles that are read before they are thinned out.
_MOST_READ = 4_000_000
#: Cells along the longest side of a surface: the first try, and the coarsest.
_FINEST, _COARSEST = 512, 4


class VisualBody(NamedTuple):
    """A part of a link in one colour.

    Args:
        link: Name of the link.
        color: Red, green, blue, opacity, 0 to 1; None where the description gives none.
        surface: Surface in the frame of the link.
        simplified: Whether the surface is thinned out.
    """

    link: str
    color: Color | None
    surface: Triangles
    simplified: bool


class VisualGeometry(NamedTuple):
    """Visual geometry of a robot.

    Args:
        bodies: Bodies of links whose visual elements can all be drawn.
        missing: Links that have visual elements which can't be drawn, and why.
    """

    bodies: tuple[VisualBody, ...] = ()
    missing: tuple[tuple[str, str], ...] = ()


def visual_geometry(
    visuals: UrdfVisuals,
    links: Iterable[str],
    meshes: Callable[[str], bytes],
    most: int = MAX_TRIANGLES,
) -> VisualGeometry:
    """The visual geometry of some links; fine meshes are thinned out.

    Args:
        visuals: Visual elements of the URDF.
        links: Names of the links.
        meshes: Finds the bytes of a mesh file by its URI; raises where there are none.
        most: Triangles of all together.
    """
    bodies: list[VisualBody] = []
    missing: dict[str, str] = {}
    # One file may stand for many elements: it is read once, and counted each time.
    surfaces, left = cache(partial(_surfaces, meshes=meshes)), _MOST_READ
    for link in links:
        if link in visuals.faults:
            missing[link] = visuals.faults[link]
            continue
        try:
            own = _link_bodies(link, visuals.links.get(link, ()), surfaces, left)
            left -= sum(len(body.surface.faces) for body in own)
            bodies += own
        except ArmwrightError as error:
            missing[link] = error.message
    return VisualGeometry(_within(bodies, most), tuple(missing.items()))


def _link_bodies(
    link: str,
    elements: Iterable[VisualElement],
    surfaces: Callable[[Geometry], list[tuple[Color | None, Triangles]]],
    most: int,
) -> list[VisualBody]:
    """One body for each colour of a link.

    Raises:
        InvalidScene: There are more triangles than ``most``.
    """
    by_color: dict[Color | None, list[Triangles]] = {}
    for element in elements:
        T = element.T_link_element
        for own, (vertices, faces) in surfaces(element.geometry):
            most -= len(faces)
            if most < 0:
                raise InvalidScene(f"with the links before it more than {_MOST_READ} triangles")
            placed = Triangles(vertices @ T[:3, :3].T + T[:3, 3], faces)
            by_color.setdefault(element.color or own, []).append(placed)
    return [VisualBody(link, color, join(parts), False) for color, parts in by_color.items()]


def _surfaces(
    geometry: Geometry, meshes: Callable[[str], bytes]
) -> list[tuple[Color | None, Triangles]]:
    if isinstance(geometry, MeshGeometry):
        data, kind = meshes(geometry.uri), geometry.uri.rpartition(".")[2]
        parts = load_painted(data, kind)
        return [(color, Triangles(*scaled(v, f, geometry.scale))) for color, v, f in parts]
    shape = plain_shape(geometry)
    assert shape is not None
    return [(None, join(piece_triangles(piece) for piece in shape.pieces()))]


def _within(bodies: list[VisualBody], most: int) -> tuple[VisualBody, ...]:
    """Bodies with at most so many triangles together: large ones are thinned out."""
    counts = sorted(len(body.surface.faces) for body in bodies)
    if sum(counts) <= most:
        return tuple(bodies)
    left, share = most, most
    for number, count in enumerate(counts):
        share = left // (len(counts) - number)
        if count > share:
            break
        left -= count
    coarse = [body.surface if len(body.surface.faces) <= share else thin_out(body.surface, share)
              for body in bodies]  # fmt: skip
    return tuple(
        body if surface is body.surface else body._replace(surface=surface, simplified=True)
        for body, surface in zip(bodies, coarse, strict=True)
    )


def thin_out(surface: Triangles, most: int) -> Triangles:
    """A surface with at most so many triangles, unless its coarsest form has more.

    All corners in a cell of a grid become their mean, and triangles that collapse go (vertex
    clustering of Rossignac and Borrel). Nothing is known of what it covers: for display only.

    Args:
        surface: The surface.
        most: Triangles at most.
    """
    if len(surface.faces) <= most:
        return surface
    cells = _FINEST
    coarse = _clustered(surface, cells)
    while len(coarse.faces) > most and cells > _COARSEST:
        cells = max(_COARSEST, int(0.8 * cells))
        coarse = _clustered(surface, cells)
    return coarse


def _clustered(surface: Triangles, cells: int) -> Triangles:
    low = surface.vertices.min(axis=0)
    side = max(float((surface.vertices.max(axis=0) - low).max()), 1e-9) / cells
    places = np.floor((surface.vertices - low) / side).astype(np.int64)
    _, cell = np.unique(places @ [1 << 40, 1 << 20, 1], return_inverse=True)
    cell = cell.reshape(-1)
    counts = np.bincount(cell)
    vertices = np.column_stack(
        [np.bincount(cell, surface.vertices[:, i]) / counts for i in range(3)]
    )
    faces = cell[surface.faces]
    kept = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    return Triangles(vertices, np.unique(faces[kept], axis=0))


#: Corners of a drawn circle, and circles from the edge of a rounded rim to its middle.
_CIRCLE, _RIM = 40, 3


def built_in_looks(chain: Chain) -> VisualGeometry:
    """The looks of a built-in arm, with a tool or without; none of any other robot.

    Args:
        chain: The robot; one of the same name with other joints or links is another one.
    """
    if chain.name not in builtin_names():
        return VisualGeometry()
    looks, own = _looks(chain.name)
    present = _frames(chain)
    same = all(name in present and np.array_equal(T, present[name]) for name, T in own.items())
    return looks if same else VisualGeometry()


def _frames(chain: Chain) -> dict[str, Array]:
    """Frames of joints and links, each in the one before."""
    joints = dict(zip(chain.joint_names, chain.offsets, strict=True))
    return joints | {link.name: link.T_joint_link for link in chain.links}


@cache
def _looks(name: str) -> tuple[VisualGeometry, dict[str, Array]]:
    """The looks of the arm of a name, one body for each link and colour, and its frames."""
    colors: dict[str, Color] = {}
    bodies: dict[tuple[str, str], list[Triangles]] = {}
    here = ""
    for line in files("kinematics.robots").joinpath("looks.txt").read_text("utf-8").splitlines():
        head, *words = line.partition("#")[0].split(maxsplit=2) or ("",)
        if head == "color":
            red, green, blue = (float(value) for value in words[1].split())
            colors[words[0]] = (red, green, blue, 1.0)
        elif head == "robot":
            here = words[0]
        elif head and here == name:
            bodies.setdefault((head, words[0]), []).append(_solid(words[1]))
    made = [
        VisualBody(link, colors[color], join(parts), simplified=False)
        for (link, color), parts in bodies.items()
    ]
    return VisualGeometry(tuple(made)), _frames(builtin_chain(name))


def _solid(text: str) -> Triangles:
    """The hull of discs, each "x y z axis radius rim"; "+-" before a number stands for both."""
    hull = convex_hull(np.vstack([_disc(words.split()) for words in text.split("|")]))
    return Triangles(hull.vertices, hull.triangles)


def _disc(words: list[str]) -> Array:
    """Points of a disc whose rim is half a circle; one of radius and rim alike is a ball."""
    *place, axis, radius, rim = words
    ends = [(float(v[2:]), -float(v[2:])) if v.startswith("+-") else (float(v),) for v in place]
    turn = np.linspace(0.0, 2.0 * np.pi, _CIRCLE, endpoint=False)
    bend = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 2 * _RIM + 1)[:, None]
    wide = float(radius) - float(rim) * (1.0 - np.cos(bend))
    rows = [wide * np.cos(turn), wide * np.sin(turn), float(rim) * np.sin(bend) + 0.0 * turn]
    # Its own z becomes the axis: x, y and z in turn.
    points = np.roll(np.stack(rows, axis=-1).reshape(-1, 3), "zxy".index(axis), axis=1)
    return np.vstack([points + center for center in itertools.product(*ends)])
