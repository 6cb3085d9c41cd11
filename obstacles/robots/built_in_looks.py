"""Looks of the built-in arms: shells, caps and fingers of a table, as triangles for display only.

Each solid of the table is the hull of discs with rounded rims, as a turned or moulded shell is. No
proof and no plan reads them, and they are no part of a robot's hash.
"""

import itertools
from functools import cache
from importlib.resources import files

import numpy as np

from kinematics.arrays import Array
from kinematics.model.chain import Chain
from kinematics.model.robot_names import builtin_names
from kinematics.robots import builtin_chain
from kinematics.urdf.visuals import Color
from obstacles.convex.piece import convex_hull
from obstacles.convex.triangles import Triangles, join
from obstacles.robots.visual_geometry import VisualBody, VisualGeometry

#: Corners of a drawn circle, and circles from the edge of a rounded rim to its middle.
_CIRCLE, _RIM = 40, 3
_NOTHING = VisualGeometry()


def built_in_looks(chain: Chain) -> VisualGeometry:
    """The looks of a built-in arm, with a tool or without; none of any other robot.

    Args:
        chain: The robot; one of the same name with other joints or links is another one.
    """
    if chain.name not in builtin_names():
        return _NOTHING
    looks, own = _looks(chain.name)
    present = _frames(chain)
    same = all(name in present and np.array_equal(T, present[name]) for name, T in own.items())
    return looks if same else _NOTHING


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
